"""Packets for groups of nodes, from the scenario to the record: on the air once, fates at members alone."""

from __future__ import annotations

import asyncio
from collections import Counter
from typing import Any

import pandas as pd
import pytest

from bridge.agents import Reception, connect_ua
from bridge.agents.client import UaClient
from lostlink import Run, load_run, redecide
from lostlink.compare.compare import compare
from lostlink.replay.player import Player
from lostlink.report.content import content_of
from tests.integration.bridge.conftest import StartRun
from tests.integration.bridge.networks.test_networks import CSMA, MESH, TELEMETRY, WIFI, Flown, flown
from tests.integration.bridge.radio.test_air import FLAT, RADIO, node, rows, told
from tests.integration.bridge.radio.test_air_beside import scenario

__all__ = ["flown"]
SENDS = [
    (1.0, "scouts", 100),
    (1.2, "ears", 100),
    (1.4, "scouts", 100, *MESH),
    (1.6, "all", 100),
    (1.8, "g2", 100),
    (2.0, "scouts", 1473, *MESH),  # too long for any of them
    (2.0, "scouts", 1473),
]
EXPECTED = {
    ("main", "0"): ["delivered", "delivered", "too_long"],
    ("main", "g2"): ["delivered", "delivered", "delivered", "delivered", "too_long"],
    ("main", "g3"): ["delivered", "delivered"],
    ("mesh", "0"): ["delivered", "too_long"],
}
"""Of what g1 sends: the scouts are 0 and g2, the ears g2, g3 and g1 itself; g2 has no mesh."""


def five(sends: list[tuple[Any, ...]]) -> list[dict[str, Any]]:
    return [
        node(0, 0.0) | {"groups": ["scouts"]},
        node(1, 100.0, sends=sends) | {"groups": ["ears"]},
        node(2, 200.0) | {"groups": ["scouts", "ears"], "networks": ["main"]},
        node(3, 300.0) | {"groups": ["ears"]},
    ]


def fates(run: Run) -> dict[tuple[str, str], list[str]]:
    found = run.packets
    found = found[(found.tx == "g1") & (found.channel == "test")].sort_values("seq")
    parts = found.astype({"radio": str, "rx": str, "fate": str}).groupby(["radio", "rx"])
    return {key: part.fate.tolist() for key, part in parts}


@pytest.mark.parametrize(
    ("main", "mesh"),
    [(TELEMETRY, WIFI), pytest.param(WIFI | {"mtu_bytes": 200}, CSMA, marks=pytest.mark.slow)],
)
def test_members_get_it_and_nobody_else_has_a_fate(
    flown: Flown, main: dict[str, Any], mesh: dict[str, Any]
) -> None:
    shares = [  # of its data package, at the first tick, which is too long, and of what it sends by either radio
        {"type": "delivery", "from": "g1", "to": "g3", "at_least": 0.66, "at_most": 0.67},
        {"type": "delivery", "from": "g1", "to": "0", "at_least": 0.5, "at_most": 0.5},
    ]
    run = flown(five(SENDS), radio=main, networks={"mesh": mesh}, expectations=shares)
    assert fates(run) == EXPECTED
    heard = {
        n: [each["seq"] for each in told(run, n, "heard") if each["sender"] == "g1"]
        for n in ("0", "g2", "g3")
    }
    first = int(rows(run, "g1", "g2").seq.min())
    came = {n: [seq - first for seq in numbers if seq >= first] for n, numbers in heard.items()}
    assert came == {"0": [0, 2, 3], "g2": [0, 1, 3, 4], "g3": [1, 3]}
    assert [(row["passed"], row["found"]) for row in run.summary["expectations"]] == [
        (True, pytest.approx(2 / 3, abs=1e-6)),  # what is for the scouts is no loss of g3's
        (True, pytest.approx(3 / 6)),
    ]


def test_a_group_is_heard_as_all_are_without_acknowledgement(flown: Flown) -> None:
    """802.11a at 6 Mb/s: to a group once, also out of range of a member; its sender waits for no answer."""
    radio = {"preset": "disk", "max_range_m": 500.0, "frequency_hz": 2.4e9, "medium": CSMA["medium"]}
    nodes = [
        node(0, 0.0) | {"groups": ["pair"]},
        node(1, 100.0, sends=[(1.0, "pair", 200), (1.5, "all", 200)]),
        node(2, 5000.0) | {"groups": ["pair"]},
        node(3, 150.0),
    ]
    run = flown(nodes, radio=radio)
    near, far, other = (rows(run, "g1", n) for n in ("0", "g2", "g3"))
    assert near.fate.tolist() == ["delivered", "delivered"]
    assert far.fate.tolist() == ["out_of_range", "out_of_range"]
    assert other.fate.tolist() == ["delivered"]
    on_air_ns = (near.ended_ns - near.started_ns).tolist()
    assert on_air_ns == [20_000 + 4_000 * -(-(22 + 8 * 236) // 24)] * 2
    assert {*near.attempts, *far.attempts} == {1}
    assert told(run, "g1", "replies") == []


@pytest.mark.parametrize("medium", [{"model": "ideal"}, CSMA["medium"]])
@pytest.mark.slow
def test_one_process_and_many_have_the_same_groups_and_what_reads_a_record_has_them(
    flown: Flown, medium: dict[str, Any]
) -> None:
    lossy = RADIO | {"base_loss": 0.3, "mtu_bytes": 200, "medium": medium}
    many_sends = SENDS + [(1.0 + 0.05 * k, "scouts", 100) for k in range(20)]
    nodes = five(sorted(many_sends, key=lambda send: send[0]))
    options = {"radio": lossy, "networks": {"mesh": CSMA | {"base_loss": 0.3}}}
    one, other = (flown(nodes, **options, processes=processes) for processes in ("one", "many"))
    assert compare(one.path, other.path) is None
    assert one.digest == other.digest
    was = one.table("deliveries").to_pandas()
    again = redecide(one.path)
    pd.testing.assert_frame_equal(again.table.to_pandas(), was, check_categorical=False)
    longer = redecide(one.path, radio=lossy | {"base_loss": 0.0, "mtu_bytes": 1500}).table.to_pandas()
    of_main = longer[(longer.tx == "g1") & (longer.radio == "main") & (longer.seq == longer.seq.max())]
    assert sorted(of_main.rx.astype(str)) == ["0", "g2"]  # what was too long for the group is for the group
    assert set(of_main.fate.astype(str)) == {"delivered"}
    player = Player.open(one.path)
    sent = Counter(player.record.sent[player.record.nodes.index("g1")].to.tolist())
    assert (sent[-3], sent[-2], sent[2]) == (22, 1, 1)  # ears and scouts, in the order of names
    totals = content_of(one)["totals"]
    assert totals["sent"] == (was.packets * was.rx.map(lambda rx: 3 if rx == "all" else 1).astype(int)).sum()


@pytest.mark.slow
@pytest.mark.parametrize("processes", ["one", pytest.param("many", marks=pytest.mark.long)])
def test_a_program_beside_the_run_sends_to_a_group_and_hears_what_is_for_its_own(
    start_run: StartRun, processes: str
) -> None:
    probe = {"id": "probe", "kind": "ground", "groups": ["ears"], "agent": {"type": "free"}}
    sends = [(0.5 + 0.1 * k, ("ears", "scouts")[k % 2], 100) for k in range(60)]
    text = scenario([*five(sends)[:3], probe], transmit=FLAT | {"phase_s": "drawn"})  # nobody meets the other
    run = start_run(scenario=text, duration_s=7.0, speed="2", processes=processes)
    run.wait_for("sim time")
    heard: list[int] = []

    async def talk(ua: UaClient) -> None:
        begun, enough = asyncio.Event(), asyncio.Event()

        def came(_sender: str, channel: str, _payload: bytes, reception: Reception) -> None:
            if channel == "test":
                heard.append(reception.seq)
                (enough if len(heard) > 5 else begun).set()

        ua.on_packet(came)
        await asyncio.wait_for(begun.wait(), 30.0)
        ua.transmit("test", bytes(10), to="scouts")
        with pytest.raises(
            ValueError, match=r"to='scoots': on radio main node probe reaches all, 0, g1, g2, ears, scouts$"
        ):
            ua.transmit("test", bytes(10), to="scoots")
        await asyncio.wait_for(enough.wait(), 30.0)

    async def join() -> None:
        async with connect_ua(run.directory, "probe", is_sender=True) as ua:
            await talk(ua)

    asyncio.run(join())
    assert run.finish() == 0, run.output.decode()
    found = load_run(run.directory)
    assert {n: rows(found, "probe", n).fate.tolist() for n in ("0", "g1", "g2")} == {
        "0": ["delivered"],
        "g1": [],
        "g2": ["delivered"],
    }
    for_ears = rows(found, "g1", "probe")
    assert len(for_ears) == 30
    assert set(heard) <= set(for_ears.seq)
