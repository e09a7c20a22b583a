"""Several radios per node, from the scenario to the record: a telemetry radio and a Wi-Fi, on a UA and on the ground.

Nodes stand; what is expected is reckoned here from lengths, rates and who is on which network.
"""

from __future__ import annotations

import itertools
import json
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pandas as pd
import pytest

from lostlink import Run, redecide
from lostlink.compare.compare import compare
from tests import warm
from tests.integration.bridge.radio.test_air import FLAT, RADIO, node, rows, told

TELEMETRY = RADIO | {"mtu_bytes": 200, "medium": {"model": "airtime"}}
"""64 kb/s: 100 bytes take 12.5 ms."""
WIFI = RADIO | {"frequency_hz": 2.437e9, "bit_rate_bps": 6e6, "mtu_bytes": 1472}
"""Takes no time."""
CSMA = WIFI | {"medium": {"model": "csma", "standard": "11a", "rate_mbps": 6.0}}
MESH = (0, None, "", "mesh")
NUMBERS = itertools.count()
Flown = Callable[..., Run]


@pytest.fixture
def flown(tmp_path: Path, free_slot: Callable[[int], int]) -> Flown:
    def flown(nodes: list[dict[str, Any]], **more: Any) -> Run:
        scenario = {
            "schema": 1,
            "name": "networks",
            "duration_s": 2.5,
            "figure": False,
            "origin": {"lat_deg": 37.0, "lon_deg": 127.0, "alt_amsl_m": 50.0},
            "fdm": {"standin_rate_hz": 100},
            "transmit": FLAT,
            "ports": {"first_slot": free_slot(1), "zenoh": 0},
            "nodes": nodes,
        } | more
        return warm.flown(scenario, tmp_path / str(next(NUMBERS)))

    return flown


def four(sends: list[tuple[Any, ...]]) -> list[dict[str, Any]]:
    """UA 0, g1 that sends, g2 with a telemetry radio alone, and g3."""
    only_main = node(2, 200.0) | {"networks": ["main"]}
    return [node(0, 0.0), node(1, 100.0, sends=sends), only_main, node(3, 300.0)]


def sends_of(mtu_bytes: int) -> list[tuple[Any, ...]]:
    """To all, to one, and too long for either, by a main radio that takes so much and a mesh that takes 1472 bytes."""
    return [
        (1.0, "all", 100),
        (1.0, "all", 1000, *MESH),
        (1.2, "g2", 100),
        (1.2, "0", 1472, *MESH),
        (1.4, "all", mtu_bytes + 1),
        (1.4, "all", 1473, *MESH),
        (1.6, "0", mtu_bytes + 1),
        (1.6, "0", 300, *MESH),
    ]


FATES = {
    ("main", "0"): ["delivered", "too_long"],
    ("main", "g2"): ["delivered", "delivered"],
    ("main", "g3"): ["delivered"],
    ("main", "all"): ["too_long"],
    ("mesh", "0"): ["delivered", "delivered", "too_long", "delivered"],
    ("mesh", "g3"): ["delivered", "too_long"],
}
"""Of what g1 sends, by the network and the receiver; one row is for all where all nodes are on the network."""


def fates(run: Run) -> dict[tuple[str, str], list[str]]:
    found = run.packets
    found = found[(found.tx == "g1") & (found.channel == "test")].sort_values("seq")
    parts = found.astype({"radio": str, "rx": str, "fate": str}).groupby(["radio", "rx"])
    return {key: part.fate.tolist() for key, part in parts}


def balances(run: Run) -> None:
    """The ledger of each network has the rows of the record, link by link and fate by fate."""
    ledger = json.loads((run.path / "ledger.json").read_text())
    expected: Counter[tuple[str, ...]] = Counter()
    columns = (run.packets[name] for name in ("radio", "tx", "rx", "fate", "packets"))
    for radio, tx, rx, fate, packets in zip(*columns, strict=True):
        for receiver in {"0", "g1", "g2", "g3"} - {tx} if rx == "all" else {rx}:
            expected[radio, tx, receiver, fate] += packets
    found: Counter[tuple[str, ...]] = Counter()
    for link in ledger["links"]:
        assert link["sent"] == link["delivered"] + sum(link["lost"].values())
        ends = link["radio"], link["tx"], link["rx"]
        for fate, packets in {"delivered": link["delivered"], **link["lost"]}.items():
            found[*ends, fate] += packets
    assert found == expected
    assert {row["radio"] for row in ledger["bins"]} == {"main", "mesh"}


@pytest.mark.parametrize(("main", "mesh"), [(TELEMETRY, WIFI), (TELEMETRY, CSMA), (WIFI, CSMA)])
def test_each_network_has_its_nodes_its_mtu_and_its_medium(
    flown: Flown, main: dict[str, Any], mesh: dict[str, Any]
) -> None:
    run = flown(four(sends_of(main["mtu_bytes"])), radio=main, networks={"mesh": mesh})
    assert fates(run) == FATES
    balances(run)
    heard = Counter((each["radio"], each["sender"]) for each in told(run, "0", "heard"))
    assert heard["mesh", "g1"] == 3  # all but what is too long
    assert {each["radio"] for each in told(run, "g2", "heard")} == {"main"}
    first = rows(run, "g1", "0")
    on_air = first[first.fate == "delivered"].groupby(first.radio.astype(str))
    longest_ns = {radio: (part.ended_ns - part.started_ns).max() for radio, part in on_air}
    # 802.11a at 6 Mb/s: 20 us, then symbols of 4 us with 24 bits, of service, tail, header, check sum and payload
    symbols = -(-(22 + 8 * (36 + 1472)) // 24)
    assert longest_ns["main"] == (12_500_000 if main is TELEMETRY else 0)
    assert longest_ns["mesh"] == (20_000 + 4_000 * symbols if mesh is CSMA else 0)
    replies = [(each["radio"], each["seq"], each["acknowledged"]) for each in told(run, "g1", "replies")]
    number = int(rows(run, "g1", "g3").seq.min())
    of_mesh = [("mesh", number + 3, True), ("mesh", number + 7, True)]
    assert replies == (of_mesh if mesh is CSMA else [])


def test_each_network_has_its_own_queue(flown: Flown) -> None:
    """Ten of 12.5 ms each: just before 50 ms three are over and one is on the air; the other radio has done all."""
    sends = [(1.0, "0", 100)] * 10 + [(1.0, "0", 100, *MESH)] * 10
    run = flown(four(sends), radio=TELEMETRY, networks={"mesh": CSMA})
    assert max(each["packets"] for each in told(run, "g1", "queue")) == 6
    assert max(each["packets"] for each in told(run, "g1", "queue-mesh")) == 0
    found = rows(run, "g1", "0")
    last_ns = found.groupby(found.radio.astype(str)).arrived_ns.max() - 1_000_000_000
    assert last_ns["mesh"] < 20_000_000 < 125_000_000 <= last_ns["main"] < 125_010_000


LOSSY = RADIO | {"base_loss": 0.5}
ONCE: list[tuple[Any, ...]] = [(1.0 + 0.05 * k, "all", 100) for k in range(20)]


def drawn(run: Run, radio: str) -> list[str]:
    found = run.packets
    chosen = found[(found.tx == "g1") & (found.channel == "test") & (found.radio == radio)]
    return chosen.sort_values(["seq", "rx"]).fate.astype(str).tolist()


@pytest.mark.slow
def test_a_further_network_draws_its_own_and_leaves_main_as_it_was(flown: Flown) -> None:
    """The same packets by the same radio on either network: 60 draws of one half each."""
    alike = [node(0, 0.0), node(1, 100.0), node(2, 200.0), node(3, 300.0)]
    by_mesh = [(*send, *MESH) for send in ONCE]
    alone = flown([*alike[:1], node(1, 100.0, sends=ONCE), *alike[2:]], radio=LOSSY)
    beside = flown(
        [*alike[:1], node(1, 100.0, sends=ONCE), *alike[2:]], radio=LOSSY, networks={"mesh": LOSSY}
    )
    other = flown(
        [*alike[:1], node(1, 100.0, sends=by_mesh), *alike[2:]], radio=LOSSY, networks={"mesh": LOSSY}
    )
    assert len(drawn(alone, "main")) == 60
    assert drawn(beside, "main") == drawn(alone, "main")
    assert len(drawn(other, "mesh")) == 60
    assert drawn(other, "mesh") != drawn(alone, "main")
    assert pd.Series(drawn(other, "mesh")).nunique() == 2


@pytest.mark.slow
def test_one_process_and_many_have_the_same_networks_and_redecide_has_them_again(flown: Flown) -> None:
    options = {"radio": TELEMETRY | {"base_loss": 0.3}, "networks": {"mesh": CSMA | {"base_loss": 0.3}}}
    sends = sends_of(200) + ONCE + [(*send, *MESH) for send in ONCE]
    nodes = four(sorted(sends, key=lambda send: send[0]))
    one, many = (flown(nodes, **options, processes=processes) for processes in ("one", "many"))
    assert compare(one.path, many.path) is None
    assert one.digest == many.digest
    again = redecide(one.path)
    assert again.comparison.is_same
    was = one.table("deliveries").to_pandas()
    pd.testing.assert_frame_equal(again.table.to_pandas(), was, check_categorical=False)
    assert [books.radio for books in again.books] == ["main", "mesh"]
    other = redecide(one.path, radio=TELEMETRY).table.to_pandas()
    of_mesh = (each[each.radio == "mesh"].reset_index(drop=True) for each in (other, was))
    pd.testing.assert_frame_equal(*of_mesh, check_categorical=False)
    assert not (other[other.radio == "main"].fate == "base_loss").any()
    assert (was[was.radio == "main"].fate == "base_loss").any()


APART_HZ = 2e6
"""Farther than 2.5 bandwidths of the emission and of the filter: 650 kHz."""
OVER_EACH_OTHER: list[tuple[Any, ...]] = [(1.0 + 0.05 * k, "0", 100) for k in range(10)]
"""12.5 ms each, at the same instants on either network."""


def in_one_band(apart_hz: float = 0.0, **more: Any) -> dict[str, Any]:
    """g1 sends to UA 0 over `main`, 100 m, and g2 to g3 over `mesh`, 200 m from UA 0; UA 0 sends on `mesh` later."""
    main = TELEMETRY | more
    mesh = TELEMETRY | {"frequency_hz": TELEMETRY["frequency_hz"] + apart_hz}
    over_mesh = [(at_s, "g3", size, *MESH) for at_s, _, size in OVER_EACH_OTHER]
    later = [(at_s + 1.0, "g3", size, *MESH) for at_s, _, size in OVER_EACH_OTHER[:5]]
    to_ua = OVER_EACH_OTHER + [(at_s + 1.0, "0", size) for at_s, _, size in OVER_EACH_OTHER[:5]]
    nodes = [
        node(0, 0.0, sends=later),
        node(1, 100.0, sends=to_ua) | {"networks": ["main"]},
        node(2, 200.0, sends=over_mesh),
        node(3, 250.0),
    ]
    return {"nodes": nodes, "radio": main, "networks": {"mesh": mesh}}


def fates_on(run: Run, radio: str, tx: str, rx: str) -> list[str]:
    found = rows(run, tx, rx)
    return found[found.radio == radio].fate.astype(str).tolist()


def test_networks_in_one_band_disturb_each_other_and_apart_they_do_not(flown: Flown) -> None:
    """10 dB over all else: UA 0 hears g1 from 100 m, 6 dB above g2 from 200 m, and its own other radio at -5 dBm."""
    together = flown(**in_one_band())
    assert fates_on(together, "main", "g1", "0") == ["interfered"] * 15
    # g3 hears g2 from 50 m, and g1 from 150 m, 9.5 dB below; UA 0 from 250 m where g1 transmits, too
    assert fates_on(together, "mesh", "g2", "g3") == ["interfered"] * 10
    assert fates_on(together, "mesh", "0", "g3") == ["interfered"] * 5
    balances(together)
    apart = flown(**in_one_band(APART_HZ))
    for radio, tx, rx, count in (("main", "g1", "0", 15), ("mesh", "g2", "g3", 10), ("mesh", "0", "g3", 5)):
        assert fates_on(apart, radio, tx, rx) == ["delivered"] * count
    balances(apart)
    taken = redecide(together.path, radio=in_one_band()["radio"] | {"frequency_hz": 917e6}).table.to_pandas()
    assert set(taken[(taken.channel == "test")].fate.astype(str)) == {"delivered"}


@pytest.mark.slow
def test_radios_of_one_ua_are_kept_apart_by_their_isolation(flown: Flown) -> None:
    """UA 0 hears g1 through 71.7 dB of free space: 82 dB of isolation leave 10 dB."""
    for isolation_db, fate in ((81.0, "interfered"), (83.0, "delivered")):
        run = flown(**in_one_band(interference={"isolation_db": isolation_db, "rejection": [[0.0, 0.0]]}))
        assert fates_on(run, "main", "g1", "0")[10:] == [fate] * 5
        assert fates_on(run, "main", "g1", "0")[:10] == ["interfered"] * 10


@pytest.mark.slow
def test_networks_in_one_band_are_the_same_in_one_process_and_many_and_decided_again(flown: Flown) -> None:
    options = in_one_band(error={"model": "noncoherent-fsk"})
    deaf = {"model": "csma", "standard": "11a", "energy_dbm": 0.0}
    options["networks"]["mesh"] |= {"medium": deaf, "base_loss": 0.2}
    one, many = (flown(**options, processes=processes) for processes in ("one", "many"))
    assert compare(one.path, many.path) is None
    assert one.digest == many.digest
    assert "interfered" in set(one.packets.fate.astype(str))
    again = redecide(one.path)
    assert again.comparison.is_same
    was = one.table("deliveries").to_pandas()
    pd.testing.assert_frame_equal(again.table.to_pandas(), was, check_categorical=False)
