"""Media that take time, in runs: from the scenario's radio to the record, an effect at a time.

Nodes stand; what is expected is reckoned here from lengths, rates and places.
"""

from __future__ import annotations

import hashlib
import itertools
import json
import re
from collections.abc import Callable
from itertools import pairwise
from math import erfc, sqrt
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import pandas as pd
import pytest
import yaml

from lostlink import Run, ScenarioError, redecide
from lostlink.compare.compare import compare
from sitl_configs.yaml_text import read_yaml
from tests import warm

CLASS = f"{Path(__file__).with_name('air_agents.py')}:Scripted"
LIGHT_MPS = 299_792_458.0
RADIO = {
    "frequency_hz": 915e6,
    "bandwidth_hz": 130e3,
    "bit_rate_bps": 64e3,
    "transmit_power_dbm": 20.0,
    "propagation": {"model": "free-space"},
    "noise": {"model": "thermal", "noise_figure_db": 6.0},
    "error": {"model": "threshold", "snr_min_db": 10.0},
}
"""Free space, and nothing drawn: what is heard with 10 dB over noise and interference is received."""
FLAT = {"phase_s": 0.0, "processing_s": 0.0, "processing_spread_s": 0.0, "every_ticks": 100_000}
"""Packets enter at ticks, and the data package is sent once, at the first tick."""
SCENARIO = {
    "schema": 1,
    "name": "air",
    "duration_s": 3.0,
    "figure": False,
    "origin": {"lat_deg": 37.0, "lon_deg": 127.0, "alt_amsl_m": 50.0},
    "fdm": {"standin_rate_hz": 100},
    "transmit": FLAT,
}
SLOW_BPS = 64e3
NUMBERS = itertools.count()


def node(number: int, north_m: float, height_m: float = 10.0, **options: Any) -> dict[str, Any]:
    agent = {"type": "own", "class": CLASS, "options": options}
    if number == 0:  # there has to be a UA
        return {"id": 0, "kind": "ua", "home": {"north_m": north_m}, "agent": agent}
    place = {"north_m": north_m, "height_m": height_m}
    return {"id": f"g{number}", "kind": "ground", "place": place, "agent": agent}


class Flown(Protocol):
    """Flies nodes on a medium; returns the run."""

    def __call__(
        self, nodes: list[dict[str, Any]], medium: dict[str, Any], *, radio: Any = RADIO, **more: Any
    ) -> Run: ...


@pytest.fixture
def flown(tmp_path: Path, free_slot: Callable[[int], int]) -> Flown:
    def flown(nodes: list[dict[str, Any]], medium: dict[str, Any], *, radio: Any = RADIO, **more: Any) -> Run:
        scenario = {
            **SCENARIO,
            "ports": {"first_slot": free_slot(1), "zenoh": 0},
            "radio": radio | {"medium": medium},
            "nodes": nodes,
        } | more
        return warm.flown(scenario, tmp_path / str(next(NUMBERS)))

    return flown


def rows(run: Run, tx: str, rx: str) -> pd.DataFrame:
    """Receptions of what a script sent, in the order of numbers."""
    found = run.packets
    chosen = found[(found.tx == tx) & (found.rx == rx) & (found.channel == "test")]
    return chosen.sort_values("seq").reset_index()


def told(run: Run, node_id: str, name: str) -> list[dict[str, Any]]:
    file = run.path / "agents" / node_id / f"{name}.jsonl"
    return [json.loads(line) for line in file.read_text().splitlines()] if file.exists() else []


def balances(run: Run) -> bool:
    """Each packet of each sender has one row for each receiver that it was for, and the ledger has these."""
    ledger = json.loads((run.path / "ledger.json").read_text())
    table = run.packets.groupby(["tx", "rx"], observed=True).packets.sum()
    return all(
        link["sent"] == link["delivered"] + sum(link["lost"].values()) == table[link["tx"], link["rx"]]
        for link in ledger["links"]
    )


def test_a_packet_takes_its_time_and_comes_with_the_first_tick_after_it(flown: Flown) -> None:
    medium = {"model": "airtime", "preamble_s": 0.002, "header_bytes": 14}
    run = flown([node(0, 0.0), node(1, 3000.0, sends=[(1.0, "0", 1000)])], medium)
    [row] = rows(run, "g1", "0").to_dict("records")
    air_ns = 2_000_000 + round(8 * 1014 / SLOW_BPS * 1e9)
    assert row["fate"] == "delivered"
    assert (row["entered_ns"], row["started_ns"]) == (1_000_000_000, 1_000_000_000)
    assert row["ended_ns"] == 1_000_000_000 + air_ns
    # truth stands still: the way is that of the record's distance, which is to 1 mm
    assert row["arrived_ns"] - row["ended_ns"] == round(row["distance_m"] / LIGHT_MPS * 1e9)
    assert row["received_ns"] == 1_150_000_000  # 128.75 ms later, at 20 ticks a second
    [heard] = [
        each for each in told(run, "0", "heard") if each["sender"] == "g1" and each["seq"] == row["seq"]
    ]
    instants = ("entered_ns", "started_ns", "ended_ns", "arrived_ns", "received_ns")
    assert {name: heard[name] for name in instants} == {name: row[name] for name in instants}
    assert heard["delay_s"] == pytest.approx((row["arrived_ns"] - 1_000_000_000) / 1e9, abs=1e-12)
    assert balances(run)


def test_frames_of_802_11b_last_whole_microseconds_behind_the_preamble_of_their_rate(flown: Flown) -> None:
    """536 bytes with MAC header, LLC and FCS: a unicast at 11 Mb/s with the short one, a broadcast at 1 Mb/s."""
    medium = {"model": "csma", "standard": "11b", "rate_mbps": 11.0, "short_preamble": True}
    sends = [(1.0, "0", 500), (2.0, "all", 500)]
    run = flown([node(0, 0.0), node(1, 300.0, sends=sends)], medium)
    found = rows(run, "g1", "0")
    assert found.fate.tolist() == ["delivered", "delivered"]
    lasted_ns = (found.ended_ns - found.started_ns).tolist()
    assert lasted_ns == [(96 + 390) * 1000, (192 + 8 * 536) * 1000]
    assert balances(run)


def test_two_at_once_collide_and_are_deaf_to_each_other(flown: Flown) -> None:
    sends = [(1.0, "all", 100)]
    nodes = [node(0, 0.0), node(1, 100.0, sends=sends), node(2, 150.0, sends=sends)]
    run = flown(nodes, {"model": "airtime"})
    fates = {
        ends: rows(run, *ends).fate.tolist()
        for ends in (("g1", "0"), ("g2", "0"), ("g1", "g2"), ("g2", "g1"))
    }
    assert fates == {
        ("g1", "0"): ["collided"],
        ("g2", "0"): ["collided"],
        ("g1", "g2"): ["half_duplex"],
        ("g2", "g1"): ["half_duplex"],
    }
    assert balances(run)


@pytest.mark.slow
def test_the_much_stronger_of_two_captures_the_receiver(flown: Flown) -> None:
    """At 100 m and 2 km: free space gives 26 dB, of which a threshold at 10 dB leaves 16."""
    sends = [(1.0, "0", 100)]
    near_first = [node(0, 0.0), node(1, 100.0, sends=sends), node(2, 2000.0, sends=[(1.0, "0", 100)])]
    run = flown(near_first, {"model": "airtime"})
    assert rows(run, "g1", "0").fate.tolist() == [
        "delivered"
    ]  # its signal is there first, and 26 dB stronger
    assert rows(run, "g2", "0").fate.tolist() == ["collided"]
    far_first = [node(0, 0.0), node(1, 100.0, sends=[(1.005, "0", 100)]), node(2, 2000.0, sends=sends)]
    fates = {}
    for capture_db in (None, 10.0, 40.0):
        medium = {"model": "airtime", "capture_db": capture_db}
        run = flown(far_first, medium, tick_rate_hz=100)
        fates[capture_db] = rows(run, "g1", "0").fate.tolist()
        assert rows(run, "g2", "0").fate.tolist() == ["collided"]
    assert fates == {None: ["collided"], 10.0: ["delivered"], 40.0: ["collided"]}


def test_a_queue_has_an_end_and_what_waits_too_long_is_dropped(flown: Flown) -> None:
    """12.5 ms on the air each; ten at once into a queue of four: one on the air, four wait, five are lost."""
    sends = [(1.0, "0", 100)] * 10 + [(2.0, "0", 100, 0, 0.03)] * 5
    medium = {"model": "airtime", "queue": {"packets": 4}}
    run = flown([node(0, 0.0), node(1, 50.0, sends=sends)], medium)
    fates = rows(run, "g1", "0").fate.tolist()
    assert fates[:10] == ["delivered"] * 5 + ["queue_full"] * 5
    # life time 30 ms: the one on the air, those that start after 12.5 and 25 ms, not those after 37.5 and 50
    assert fates[10:] == ["delivered"] * 3 + ["expired"] * 2
    waited = [each["packets"] for each in told(run, "g1", "queue")]
    assert max(waited) == 1  # 50 ms after ten at once: 12.5, 25, 37.5 are done, at 50 the last begins
    assert balances(run)


def test_higher_priorities_go_first_and_the_newest_of_a_key_stays(flown: Flown) -> None:
    sends = [(1.0, "0", 100, 0), (1.0, "0", 100, 0), (1.0, "0", 100, 5), (1.0, "0", 100, 0, None, "state")]
    sends += [(1.0, "0", 100, 0, None, "state")] * 2
    run = flown([node(0, 0.0), node(1, 50.0, sends=sends)], {"model": "airtime"})
    found = rows(run, "g1", "0")
    assert found.fate.tolist() == ["delivered"] * 3 + ["replaced"] * 2 + ["delivered"]
    came = found[found.fate == "delivered"].sort_values("arrived_ns")
    assert (came.seq - found.seq.min()).tolist() == [0, 2, 1, 5]
    heard = [each["seq"] - int(found.seq.min()) for each in told(run, "0", "heard") if each["sender"] == "g1"]
    assert heard[-4:] == [0, 2, 1, 5]


def test_a_unicast_of_802_11_is_acknowledged_or_given_up_and_its_sender_learns_it(flown: Flown) -> None:
    """To a node in range at once; to one that nothing reaches seven times in vain."""
    radio = {"preset": "disk", "max_range_m": 500.0, "frequency_hz": 2.4e9}
    sends = [(1.0, "0", 200), (1.5, "g2", 200)]
    nodes = [node(0, 0.0), node(1, 100.0, sends=sends), node(2, 5000.0)]
    run = flown(nodes, {"model": "csma", "standard": "11a", "rate_mbps": 6.0}, radio=radio)
    near, far = rows(run, "g1", "0").to_dict("records"), rows(run, "g1", "g2").to_dict("records")
    assert [(row["fate"], row["attempts"]) for row in near] == [("delivered", 1)]
    assert [(row["fate"], row["attempts"]) for row in far] == [("retries_exhausted", 7)]
    assert near[0]["ended_ns"] - near[0]["started_ns"] == 20_000 + 4_000 * int(np.ceil((22 + 8 * 236) / 24))
    replies = [(each["seq"], each["acknowledged"], each["attempts"]) for each in told(run, "g1", "replies")]
    assert replies == [(near[0]["seq"], True, 1), (far[0]["seq"], False, 7)]
    assert balances(run)


@pytest.mark.slow
def test_six_on_a_telemetry_radio_get_what_the_air_carries(flown: Flown) -> None:
    """200 packets a second of 1400 B from each of six: 13.4 Mb/s offered to 64 kb/s, in turns."""
    nodes = [node(n, 20.0 * n, period_s=0.05, count=10, size=1400) for n in range(6)]
    medium = {"model": "tdma", "slot_s": 0.2, "guard_s": 0.001, "queue": {"packets": 20}}
    run = flown(nodes, medium, duration_s=6.0)
    found = run.packets[run.packets.channel == "test"]
    came = found[found.fate == "delivered"]
    per_receiver_bps = 8 * 1400 * len(came) / 5 / 6.0
    assert 0.5 * SLOW_BPS < per_receiver_bps <= SLOW_BPS
    assert ((came.arrived_ns - came.entered_ns) / 1e9 > 8 * 1400 / SLOW_BPS).all()
    lost = found[found.fate != "delivered"].groupby("fate", observed=True).packets.sum()
    assert lost["queue_full"] > 0.9 * lost.sum()
    assert balances(run)


def scripted(flown: Flown, **more: Any) -> Run:
    """Transmissions at instants that ticks of 5, 20 and 50 Hz all have."""
    sends = {n: [(1.0 + 0.2 * k, "all" if k % 3 else "g2", 300 + n) for k in range(8)] for n in (1, 3, 4)}
    nodes = [
        node(0, 0.0),
        node(1, 200.0, sends=sends[1]),
        node(2, 400.0),
        node(3, 900.0, sends=sends[3]),
        node(4, 600.0, sends=sends[4]),
    ]
    nodes += more.pop("bystanders", [])
    radio = {"preset": "wifi-2.4", "bursts": {"model": "none"}}
    return flown(nodes, {"model": "csma", "standard": "11g"}, radio=radio, **more)


FATES = ["tx", "rx", "seq", "fate", "started_ns", "ended_ns", "arrived_ns", "attempts", "received_power_dbm"]


def fates(run: Run) -> pd.DataFrame:
    found = run.packets.astype(dict.fromkeys(("tx", "rx", "fate"), str))
    is_far = found.tx.str.startswith("far") | found.rx.str.startswith("far")
    return found[(found.channel == "test") & ~is_far][FATES].sort_values(
        ["tx", "rx", "seq"], ignore_index=True
    )


@pytest.mark.slow
def test_fates_do_not_depend_on_ticks_or_on_bystanders_out_of_range(flown: Flown) -> None:
    """The radio's own draws are by node and transmission; nodes stand, so that no truth differs."""
    first = fates(scripted(flown))
    to_all, to_one = 5, 3
    assert len(first) == 3 * (4 * to_all + to_one)
    assert len(set(first.fate)) > 1
    for rate_hz in (5, 50):
        again = fates(scripted(flown, tick_rate_hz=rate_hz))
        pd.testing.assert_frame_equal(first, again)
    far = [node(n, 400_000.0 + 80_000.0 * n, period_s=0.05, size=100) | {"id": f"far{n}"} for n in (5, 6, 7)]
    pd.testing.assert_frame_equal(first, fates(scripted(flown, bystanders=far)))


@pytest.mark.slow
@pytest.mark.parametrize("processes", ["many"])
def test_one_process_and_many_have_the_same_air(flown: Flown, processes: str) -> None:
    drawn = FLAT | {"phase_s": "drawn", "processing_s": 0.001, "processing_spread_s": 0.002}
    one = scripted(flown, transmit=drawn)
    other = scripted(flown, transmit=drawn, processes=processes)
    assert compare(one.path, other.path) is None
    assert one.digest == other.digest
    entered = one.packets[one.packets.channel == "test"]
    offsets = ((entered.entered_ns - entered.sim_time_ns) / 1e6).groupby(entered.tx.astype(str))
    assert offsets.max().nunique() == 3  # each node has a phase of its own within the tick
    assert (offsets.max() - offsets.min() < 2.0).all()
    assert offsets.max().max() < 50.0 + 3.0


@pytest.mark.slow
def test_decided_anew_the_same_radio_gives_the_same(flown: Flown) -> None:
    run = scripted(flown)
    again = redecide(run.path)
    assert again.table.equals(run.table("deliveries"))
    ideal = redecide(run.path, radio={"preset": "wifi-2.4", "medium": {"model": "ideal"}})
    assert set(ideal.table.column("attempts").to_pylist()) == {1}
    assert again.ledger.links == redecide(run.path).ledger.links


def test_a_jammer_spoils_what_meets_its_slots_also_in_part(flown: Flown) -> None:
    """Slots of 0.4 s, on or off. A short packet in each shows which; a long one goes from each slot into the next."""
    sends = [
        send for slot in range(2, 20) for send in ((0.4 * slot + 0.1, "0", 20), (0.4 * slot + 0.3, "0", 1200))
    ]
    jammer = {
        "id": "jammer",
        "kind": "emitter",
        "place": {"north_m": 50.0, "height_m": 10.0},
        "frequency_hz": 915e6,
        "power_dbm": 20.0,
        "duty": 0.5,
        "slot_s": 0.4,
    }
    run = flown(
        [node(0, 0.0), node(1, 200.0, sends=sends), jammer], {"model": "airtime"}, duration_s=9.0, seed=5
    )
    found = rows(run, "g1", "0")
    assert set(found.fate) == {"delivered", "interfered"}
    is_off = (found.fate[::2] == "delivered").tolist()
    came = (found.fate[1::2] == "delivered").tolist()
    assert came[:-1] == [here and there for here, there in pairwise(is_off)]
    assert any(
        here and not there for here, there in pairwise(is_off)
    )  # that slot's noise comes in the middle
    assert balances(run)


def test_an_emitter_that_moves_goes_on_between_ticks(flown: Flown) -> None:
    """At 100 m/s it is 5 m farther at the next tick: noise is by where it is when a frame starts, to 0.002 dB."""
    emitter = {
        "id": "truck",
        "kind": "emitter",
        "track": [
            {"sim_time_s": at_s, "north_m": 100.0 * at_s, "east_m": 30.0, "height_m": 10.0} for at_s in (0, 5)
        ],
        "frequency_hz": 915e6,
        "power_dbm": 10.0,
    }
    sends = [(1.0, "0", 20)] * 40
    run = flown([node(0, 0.0), node(1, 120.0, sends=sends), emitter], {"model": "airtime"})
    found = rows(run, "g1", "0")
    there = run.truth[(run.truth.node == "0") & (run.truth.tick_ns == 1_000_000_000)].iloc[0]
    east_m, down_m = 30.0 - there.position_east_m, -10.0 - there.position_down_m
    way_m = np.hypot(100e-9 * found.started_ns - there.position_north_m, np.hypot(east_m, down_m))
    power_dbm = 10.0 - 20.0 * np.log10(4.0 * np.pi * way_m * 915e6 / LIGHT_MPS)
    floor_dbm = 10.0 * np.log10(1.380649e-20 * 290.0 * 130e3) + 6.0
    noise_dbm = 10.0 * np.log10(10.0 ** (power_dbm / 10.0) + 10.0 ** (floor_dbm / 10.0))
    assert (found.received_power_dbm - found.snr_db).to_numpy() == pytest.approx(noise_dbm, abs=2e-3)
    assert set(found.started_ns // 50_000_000 - 20) == {0, 1}


def test_a_medium_of_ones_own(flown: Flown) -> None:
    own = {"class": f"{Path(__file__).with_name('own_medium.py')}:PatientMedium", "wait_s": 0.05}
    run = flown([node(0, 0.0), node(1, 50.0, sends=[(1.0, "0", 100)])], own)
    [row] = rows(run, "g1", "0").to_dict("records")
    assert (row["fate"], row["started_ns"] - row["entered_ns"]) == ("delivered", 50_000_000)


def test_a_burst_on_a_medium_of_ones_own_goes_out_one_by_one(flown: Flown) -> None:
    """Four of 100 B, 12.5 ms each at 64 kb/s, that enter together: each waits 50 ms once the one before has ended."""
    own = {"class": f"{Path(__file__).with_name('own_medium.py')}:PatientMedium", "wait_s": 0.05}
    run = flown([node(0, 0.0), node(1, 50.0, sends=[(1.0, "0", 100)] * 4)], own)
    found = rows(run, "g1", "0")
    assert list(found.fate) == ["delivered"] * 4
    waited_ns = found.started_ns - found.entered_ns
    assert list(waited_ns) == [50_000_000 + number * 62_500_000 for number in range(4)]


def test_radios_on_one_channel_share_its_medium(flown: Flown) -> None:
    other = node(1, 50.0) | {"radio": RADIO | {"medium": {"model": "tdma", "slot_s": 0.1}}}
    text = r"nodes.g1.radio: its medium is tdma, that of the run's radio airtime"
    with pytest.raises(ScenarioError, match=text):
        flown([node(0, 0.0), other], {"model": "airtime"})
    with pytest.raises(ScenarioError, match=r"node g7 is not there; there are 0, g1"):
        flown([node(0, 0.0), node(1, 5.0)], {"model": "tdma", "slot_s": 0.1, "slots": ["g7"]})


@pytest.mark.slow
def test_a_neighbour_channel_leaks_by_spectrum_and_filter(flown: Flown) -> None:
    """Node g3 is loud and near; on a channel beside, nobody hears it, and what is left of it decides.

    In free space g1, 100.5 m away, is 17 dB weaker than g3 at 14.1 m, and needs 10 dB over interference: the filter has
    to take 27 dB. Both masks (802.11's, of 20 MHz) leave -1.2 dB at 5 MHz, -16 at 20 and -32 at 30.
    """
    wide = RADIO | {"frequency_hz": 2.4e9, "bandwidth_hz": 20e6, "bit_rate_bps": 1e6}
    nodes = [
        node(0, 0.0),
        node(1, 100.0, sends=[(1.0, "0", 200), (2.0, "0", 200)]),
        node(3, 10.0, sends=[(1.0, "all", 400)]),
    ]
    fates = {}
    for channel in (0, 1, 4, 6):
        medium = {"model": "airtime", "channels": {"g3": channel}}
        run = flown(nodes, medium, radio=wide)
        fates[channel] = rows(run, "g1", "0").fate.tolist()
        assert rows(run, "g3", "0").fate.tolist() == ["no_lock" if channel else "delivered"]
    assert [first for first, _ in fates.values()] == ["collided", "collided", "collided", "delivered"]
    assert {second for _, second in fates.values()} == {"delivered"}


def test_sik_radios_are_pairs_by_id_and_what_does_not_fit_in_a_frame_takes_several(flown: Flown) -> None:
    """ECC: 11 bytes, then twice 6 and what is sent, in threes; at most 118 bytes of a packet in a frame."""
    sends = [(1.0, "g3", 100), (1.5, "0", 100), (2.0, "all", 300), (2.5, "g3", 1000), (2.5, "g3", 1000)]
    nodes = [node(0, 0.0), node(1, 100.0, sends=sends), node(2, 150.0), node(3, 200.0)]
    medium = {"model": "sik", "ecc": True, "pairs": [["g1", "g3"]], "netids": [42]}
    run = flown(nodes, medium, duration_s=4.0)
    one, parted, first, second = rows(run, "g1", "g3").to_dict("records")
    assert (one["fate"], one["attempts"]) == ("delivered", 1)
    assert one["ended_ns"] - one["started_ns"] == 8 * (11 + 2 * (6 + 102)) * 1_000_000 // 64
    assert parted["fate"] == "delivered"
    assert parted["attempts"] >= 3  # 118, 118, 64; more where a window ends
    assert (first["fate"], second["fate"]) == ("delivered", "queue_full")  # 1850 bytes from the host
    assert rows(run, "g1", "0").fate.tolist() == ["no_peer"] * 2
    assert rows(run, "g1", "g2").fate.tolist() == ["no_peer"]
    assert balances(run)


@pytest.mark.slow
def test_two_sik_radios_that_are_busy_share_the_time_as_their_firmware_reckons(flown: Flown) -> None:
    """64 kb/s and a stream of bytes: by simulating the firmware's arithmetic apart from this code 3240 B/s each."""
    nodes = [node(n, 50.0 * n, period_s=0.05, count=2, size=100) for n in range(2)]
    medium = {"model": "sik", "framing": False, "tick": "nominal"}
    run = flown(nodes, medium, duration_s=12.0)
    for tx, rx in (("0", "g1"), ("g1", "0")):
        found = rows(run, tx, rx)
        came = found[(found.fate == "delivered") & (found.arrived_ns > 2e9)]
        assert 100 * len(came) / 10.0 == pytest.approx(3240.0, rel=0.03)
        assert set(found.fate) == {"delivered", "queue_full", "run_ended"}
    assert balances(run)


@pytest.mark.parametrize(
    ("medium", "problem"),
    [
        ({"pairs": [["0", "g7"]]}, "g7"),
        ({"pairs": [["0", "g1"], ["g1", "g2"]]}, "at most once"),
        ({"pairs": [["0", "g1"]], "netids": [1, 2]}, "2 NETIDs for 1 pairs"),
        ({"air_kbps": 65}, "65"),
        ({"ecc": True, "max_window_ms": 1}, "no packet fits"),
    ],
)
def test_what_sik_radios_cannot_be_is_said(flown: Flown, medium: dict[str, Any], problem: str) -> None:
    with pytest.raises(ValueError, match=problem):
        flown([node(n, 50.0 * n) for n in range(3)], {"model": "sik"} | medium)


def test_a_fate_may_be_decided_long_after_its_frame(flown: Flown) -> None:
    """12 s on the way: longer than anybody would wait to forget a frame."""
    medium = {"model": "delay", "least_s": 12.0, "median_s": 12.0, "most_s": 12.0, "rate_bps": 1e6}
    run = flown(
        [node(0, 0.0), node(1, 50.0, sends=[(1.0, "0", 100)])], medium, duration_s=14.0, tick_rate_hz=5
    )
    [row] = rows(run, "g1", "0").to_dict("records")
    assert (row["fate"], row["arrived_ns"] - row["ended_ns"]) == ("delivered", 12_000_000_000)
    assert row["distance_m"] == pytest.approx(51.0, abs=0.5)


def test_a_radio_that_is_switched_off_ends_no_frame_that_is_on_the_air(flown: Flown) -> None:
    """Its start decides, and what pulses in the noise goes on: 150 ms from 1.9 s on, off from 2.0 s on."""
    jammer = {
        "id": "j",
        "kind": "emitter",
        "place": {"north_m": 9000.0, "height_m": 10.0},
        "frequency_hz": 915e6,
    }
    jammer |= {"power_dbm": -30.0, "duty": 0.5, "slot_s": 0.01}
    sender = node(1, 200.0, sends=[(1.9, "0", 1200), (2.2, "0", 1200)])
    sender |= {"radio_off": [{"from_s": 2.0, "to_s": 3.0}]}
    run = flown([node(0, 0.0), sender, jammer], {"model": "airtime"})
    assert rows(run, "g1", "0").fate.tolist() == ["delivered", "radio_off"]


def test_a_node_alone_keeps_nothing(flown: Flown) -> None:
    run = flown([node(0, 0.0, period_s=0.1)], {"model": "csma"}, radio=RADIO | {"frequency_hz": 2.4e9})
    assert not len(run.packets)
    assert run.ending == "duration"


def test_what_a_medium_of_a_further_network_cannot_be_is_told(flown: Flown) -> None:
    mesh = RADIO | {"medium": {"model": "tdma", "slot_s": 0.1, "slots": ["g7"]}}
    with pytest.raises(ScenarioError, match=r"networks.mesh.medium: .*node g7 is not there"):
        flown([node(0, 0.0), node(1, 5.0)], {"model": "airtime"}, networks={"mesh": mesh})


SLOTS_DOCS = (Path(__file__).parents[4] / "docs" / "reference" / "air.md").read_text()
MEDIUM_TEXT, SLOTS_TEXT = re.findall(r"```yaml\n(.*?)```", SLOTS_DOCS.partition("## Slots")[2], re.DOTALL)
"""The example of the docs: a radio, and its slots.yaml."""


@pytest.fixture
def slotted(tmp_path: Path, free_slot: Callable[[int], int]) -> Callable[..., Run]:
    """Flies the slots of the docs, from files, with a radio in free space."""

    def slotted(
        nodes: list[dict[str, Any]], slots: str = SLOTS_TEXT, spacing_hz: float = 500e3, **radio: Any
    ) -> Run:
        medium = yaml.safe_load(MEDIUM_TEXT)["radio"]["medium"] | {"channel_spacing_hz": spacing_hz}
        content = SCENARIO | {
            "ports": {"first_slot": free_slot(1), "zenoh": 0},
            "radio": RADIO | {"medium": medium} | radio,
            "nodes": nodes,
        }
        (tmp_path / "slots.yaml").write_text(slots)
        (tmp_path / "slotted.yaml").write_text(yaml.safe_dump(content))
        return warm.flown(tmp_path / "slotted.yaml", tmp_path / "run")

    return slotted


def test_slots_from_a_file_beside_the_scenario(slotted: Callable[..., Run]) -> None:
    """All enter at 1 s, 100 ms into a round of 150 that began at 0.9: the fast slot of class 5 is due at once.

    At 128 kb/s 100 bytes take 6.25 ms; at 64 kb/s 12.5, and 200 bytes 25. The next round begins at 1.05 s, and the two
    slots at once, of g1 and g2 on two channels, at 1.1 s.
    """
    sends = {
        0: [(1.0, "all", 100, 5), (1.0, "g1", 100)],
        1: [(1.0, "0", 200)],
        2: [(1.0, "g3", 200), (1.0, "0", 200)],
    }
    run = slotted([node(n, 50.0 * n, sends=sends.get(n, [])) for n in range(4)])
    found = {
        ends: [tuple(row) for row in rows(run, *ends)[["fate", "started_ns", "ended_ns"]].to_numpy()]
        for ends in (("0", "g1"), ("0", "g3"), ("g1", "0"), ("g2", "g3"), ("g2", "0"))
    }
    assert found == {
        ("0", "g1"): [
            ("delivered", 1_000_000_000, 1_006_250_000),
            ("delivered", 1_050_000_000, 1_062_500_000),
        ],
        ("0", "g3"): [("delivered", 1_000_000_000, 1_006_250_000)],
        ("g1", "0"): [("delivered", 1_100_000_000, 1_125_000_000)],
        ("g2", "g3"): [("delivered", 1_100_000_000, 1_125_000_000)],
        ("g2", "0"): [("no_lock", 1_250_000_000, 1_275_000_000)],
    }
    assert balances(run)
    kept = yaml.safe_load((run.path / "scenario.yaml").read_text())["radio"]["medium"]
    file = str(run.path.parents[1] / "slots.yaml")
    assert kept["schedule"] == {"read_from": file} | read_yaml(SLOTS_TEXT)
    digests = json.loads((run.path / "provenance.json").read_text())["files"]
    assert digests[file] == hashlib.sha256(Path(file).read_bytes()).hexdigest()
    [air] = json.loads((run.path / "summary.json").read_text())["air"]
    assert (air["medium"], air["is_shared"]) == ("tdma", False)


def test_slots_at_once_leak_into_each_other_by_their_spacing(slotted: Callable[..., Run]) -> None:
    """At 1 kHz a receiver of 130 kHz takes all of g2 in, 100 m away: 6 dB below g1 at 50 m, which needs 10.

    At 500 kHz (the test before) nothing is left of it.
    """
    sends = {1: [(1.0, "0", 200)], 2: [(1.0, "g3", 200)]}
    run = slotted([node(n, 50.0 * n, sends=sends.get(n, [])) for n in range(4)], spacing_hz=1e3)
    assert rows(run, "g1", "0").fate.tolist() == ["collided"]


def test_errors_of_a_slot_are_those_of_its_bit_rate(slotted: Callable[..., Run]) -> None:
    """QPSK: 1 - (1 - erfc(sqrt(Eb / N0)) / 2)^(8 * 100), Eb / N0 = SNR * 130 kHz / bit rate; some 6 dB at 286 m."""
    nodes = [
        node(0, 0.0, sends=[(1.0, "all", 100, 5), (1.0, "g1", 100)]),
        node(1, 286.0),
        node(2, 9.0),
        node(3, 9.0),
    ]
    run = slotted(nodes, transmit_power_dbm=-30.0, error={"model": "uncoded-awgn", "modulation": "qpsk"})
    fast, slow = rows(run, "0", "g1").to_dict("records")
    for row, bit_rate_bps in ((fast, 128e3), (slow, 64e3)):
        ebn0 = 10.0 ** (row["snr_db"] / 10.0) * 130e3 / bit_rate_bps
        expected = 1.0 - (1.0 - erfc(sqrt(ebn0)) / 2.0) ** 800
        assert row["per"] == pytest.approx(expected, rel=0.01)
    assert fast["per"] > 0.5 > 0.2 > slow["per"]


def test_mistakes_in_slots_are_told_by_their_file(slotted: Callable[..., Run]) -> None:
    nodes = [node(n, 5.0 * n) for n in range(3)]
    with pytest.raises(
        ScenarioError,
        match=r"slots\.yaml:4: slots\.0\.duration_s: has to be greater than 0 \(got -1\) \(named at ",
    ):
        slotted(nodes, SLOTS_TEXT.replace("duration_s: 0.05}", "duration_s: -1}", 1))
    with pytest.raises(
        ScenarioError, match=r"radio\.medium: .*/slots\.yaml: .*node g3 is not there; there are 0, g1, g2"
    ):
        slotted(nodes)
