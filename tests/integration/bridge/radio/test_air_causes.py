"""What the record says why packets were lost on media that take time, and how often they were on the air."""

from __future__ import annotations

import json
import math
from typing import Any

import pytest

from lostlink import Run, redecide
from tests.integration.bridge.radio.test_air import LIGHT_MPS, RADIO, Flown, balances, flown, node, rows, told

__all__ = ["flown"]
FAINT = RADIO | {"error": {"model": "threshold", "snr_min_db": 40.0}}
"""45 dB over noise at 1 km, 36 at 3 km: what comes from there is locked on to, and lost."""


def test_a_frame_that_noise_takes_is_no_collision_whatever_it_meets(flown: Flown) -> None:
    """All at once: node 0 follows the nearest, and would have had that at 1 km alone, but not that at 3 km."""
    sends = [(1.0, "0", 100)]
    nodes = [
        node(0, 0.0),
        *(node(n, far_m, sends=sends) for n, far_m in ((1, 100.0), (2, 1000.0), (3, 3000.0))),
    ]
    run = flown(nodes, {"model": "airtime"}, radio=FAINT)
    found = {sender: rows(run, sender, "0").fate.tolist() for sender in ("g1", "g2", "g3")}
    assert found == {"g1": ["collided"], "g2": ["collided"], "g3": ["channel_erasure"]}
    assert balances(run)


def test_a_frame_that_another_displaces_is_no_collision_if_noise_takes_it(flown: Flown) -> None:
    """That from 3 km comes first; what takes the receiver over is 29.5 dB stronger, 40 have to be."""
    nodes = [
        node(0, 0.0),
        node(1, 100.0, sends=[(1.005, "0", 100)]),
        node(3, 3000.0, sends=[(1.0, "0", 100)]),
    ]
    run = flown(nodes, {"model": "airtime", "capture_db": 10.0}, radio=FAINT, tick_rate_hz=100)
    assert rows(run, "g3", "0").fate.tolist() == ["channel_erasure"]
    assert rows(run, "g1", "0").fate.tolist() == ["collided"]


def test_a_frame_that_an_emitter_takes_is_interfered_whatever_it_meets(flown: Flown) -> None:
    """-80 dBm from 9 km, against -72 dBm from 1 km: lost to that; noise alone would take what comes from 3 km."""
    jammer = {"id": "j", "kind": "emitter", "place": {"north_m": 9000.0, "height_m": 10.0}}
    jammer |= {"frequency_hz": 915e6, "power_dbm": 31.0}
    sends = [(1.0, "0", 100)]
    nodes = [
        node(0, 0.0),
        *(node(n, far_m, sends=sends) for n, far_m in ((1, 10.0), (2, 1000.0), (3, 3000.0))),
    ]
    run = flown([*nodes, jammer], {"model": "airtime"}, radio=FAINT)
    found = {sender: rows(run, sender, "0").fate.tolist() for sender in ("g1", "g2", "g3")}
    assert found == {"g1": ["collided"], "g2": ["interfered"], "g3": ["channel_erasure"]}


def fates(run: Run, tx: str, rx: str) -> list[tuple[str, int, bool]]:
    """Cause, how often on the air, and whether there is an instant of it, of each packet of a script."""
    found = rows(run, tx, rx)
    return list(zip(found.fate, found.attempts, found.started_ns >= 0, strict=True))


def replies(run: Run, node_id: str) -> list[tuple[bool, int]]:
    return [(each["acknowledged"], each["attempts"]) for each in told(run, node_id, "replies")]


@pytest.mark.parametrize("rts_from_bytes", [None, 0])
def test_what_a_radio_that_is_off_sends_or_should_get_by_802_11_is_lost_to_that(
    flown: Flown, rts_from_bytes: int | None
) -> None:
    """Who is on transmits seven times to one that is off, or announces it so often; who is off transmits nothing."""
    sends = [(1.0, "g2", 100), (1.2, "all", 100), (2.2, "g2", 100)]
    off = node(2, 150.0, sends=[(1.1, "g1", 100), (1.3, "all", 100), (2.3, "g1", 100)])
    off["radio_off"] = [{"from_s": 0.5, "to_s": 2.0}]
    medium = {"model": "csma", "standard": "11a", "rts_from_bytes": rts_from_bytes}
    run = flown([node(0, 0.0), node(1, 100.0, sends=sends), off], medium)
    tries = 7 if rts_from_bytes is None else 0
    came = ("delivered", 1, True)
    assert fates(run, "g1", "g2") == [("radio_off", tries, tries > 0), ("radio_off", 1, True), came]
    assert fates(run, "g2", "g1") == [("radio_off", 0, False), ("radio_off", 0, False), came]
    assert fates(run, "g2", "0") == [("radio_off", 0, False)]
    assert fates(run, "g1", "0") == [came]
    assert (replies(run, "g1"), replies(run, "g2")) == ([(False, tries), (True, 1)], [(False, 0), (True, 1)])
    assert balances(run)
    assert redecide(run.path).comparison.is_same


SIK, ELRS = {"model": "sik", "air_kbps": 64}, {"model": "elrs", "mode": "lora-333-full"}


@pytest.mark.slow
@pytest.mark.parametrize(
    "medium",
    [
        {"model": "airtime"},
        {"model": "tdma", "slot_s": 0.1, "guard_s": 0.0},
        SIK,
        ELRS,
        {"model": "delay", "least_s": 0.01, "median_s": 0.01, "most_s": 0.01, "rate_bps": 64e3},
    ],
    ids=lambda medium: medium["model"],
)
def test_what_a_radio_that_is_off_is_given_never_leaves_it(flown: Flown, medium: dict[str, Any]) -> None:
    never_leaves(flown, medium, {})


@pytest.mark.slow
@pytest.mark.parametrize("medium", [SIK, ELRS], ids=lambda medium: medium["model"])
def test_nor_does_it_leave_it_where_modems_look_on(flown: Flown, medium: dict[str, Any]) -> None:
    never_leaves(flown, medium, {"modems": {"main": {"serve": ["pty"]}}})


def never_leaves(flown: Flown, medium: dict[str, Any], at_g1: dict[str, Any]) -> None:
    sends = [(1.0, "g1", 20), (1.5, "all", 20), (1.9, "g1", 20), (3.5, "g1", 20)]
    off = node(0, 0.0, sends=sends) | {"radio_off": [{"from_s": 0.9, "to_s": 2.0}]}
    run = flown([off, node(1, 100.0) | at_g1], medium, duration_s=4.0)
    *lost, (last, _, _) = fates(run, "0", "g1")
    assert (lost, last) == ([("radio_off", 0, False)] * 3, "delivered")
    assert balances(run)
    assert redecide(run.path).comparison.is_same


def test_an_announcement_that_nobody_answers_is_no_transmission_of_its_packet(flown: Flown) -> None:
    """Node g2 is out of reach; node 0 is on again 1 ms after the first RTS to it, and gets the packet at once."""
    radio = {"preset": "disk", "max_range_m": 500.0, "frequency_hz": 2.4e9}
    sends = [(1.0, "g2", 300), (2.0, "0", 300)]
    late = node(0, 0.0)
    late["radio_off"] = [{"from_s": 1.5, "to_s": 2.001}]
    medium = {"model": "csma", "standard": "11a", "rts_from_bytes": 0, "attempts_max": 30}
    run = flown([late, node(1, 100.0, sends=sends), node(2, 5000.0)], medium, radio=radio)
    assert fates(run, "g1", "g2") == [("retries_exhausted", 0, False)]
    [row] = rows(run, "g1", "0").to_dict("records")
    assert (row["fate"], row["attempts"]) == ("delivered", 1)
    assert 2_001_000_000 < row["started_ns"] < 2_010_000_000
    assert replies(run, "g1") == [(False, 0), (True, 1)]
    # distance bins have the package's first transmission, and that of the packet to all at the start of the run
    duration_ns = 20_000 + 4_000 * math.ceil((22 + 8 * 336) / 24)
    assert row["ended_ns"] - row["started_ns"] == duration_ns
    bins = json.loads((run.path / "ledger.json").read_text())["bins"]
    assert [each["sent"] for each in bins if (each["tx"], each["rx"]) == ("g1", "0")] == [2]


WIFI = RADIO | {"earth_radius_factor": None}
CSMA = {"model": "csma", "standard": "11a", "queue": {"packets": 4}}


def emitter(north_m: float, **more: Any) -> dict[str, Any]:
    """On the carrier, with 20 dBm: free space leaves -62 dBm, from which on csma senses energy, at 328 m."""
    place = {"place": {"north_m": north_m, "height_m": 10.0}}
    return {"id": "j", "kind": "emitter", "frequency_hz": 915e6, "power_dbm": 20.0, **place, **more}


def heard_from_m(level_dbm: float) -> float:
    return 10.0 ** ((20.0 - level_dbm) / 20.0) * LIGHT_MPS / (4.0 * math.pi * 915e6)


@pytest.mark.parametrize(("beside_m", "waits"), [(-1.0, True), (1.0, False)])
def test_an_emitter_without_end_holds_stations_back_and_the_run_says_so(
    flown: Flown, beside_m: float, waits: bool
) -> None:
    """Ten packets from a station that is as far from it as its power is sensed, within a metre; a queue of four."""
    sends = [(1.0 + 0.1 * number, "0", 100) for number in range(10)]
    nodes = [node(0, -3000.0), node(1, 0.0, sends=sends), emitter(heard_from_m(-62.0) + beside_m)]
    run = flown(nodes, CSMA, radio=WIFI)
    found = rows(run, "g1", "0")
    warned = [text for text in run.summary["warnings"] if "interferers and emitters that never pause" in text]
    if waits:  # the packet to all of the first tick is at the transmitter, and four wait behind it
        assert found.fate.tolist() == ["run_ended"] * 4 + ["queue_full"] * 6
        assert (found.started_ns == -1).all()
        [warning] = warned
        assert warning.startswith("at the first place of node g1 (-61.97 dBm) ")
        assert "from -62 dBm on" in warning
        [air] = run.summary["air"]
        assert air["lost_waiting"] > air["waiting_at_end"] >= 4
    else:
        assert (found.started_ns > 0).all()
        assert not warned
    assert balances(run)
    assert redecide(run.path).comparison.is_same


def test_a_station_waits_until_an_emitter_has_gone(flown: Flown) -> None:
    """It flies off at 100 m/s from 1 s on; its place is told at ticks, of which there are 100 a second."""
    north_m = heard_from_m(-62.0) - 60.0
    track = [
        {"sim_time_s": at_s, "north_m": far_m, "height_m": 10.0}
        for at_s, far_m in ((1.0, north_m), (3.0, north_m + 200.0))
    ]
    jammer = {key: value for key, value in emitter(0.0).items() if key != "place"} | {"track": track}
    nodes = [node(0, -3000.0), node(1, 0.0, sends=[(1.0, "all", 100)]), jammer]
    run = flown(nodes, CSMA, radio=WIFI, tick_rate_hz=100)
    [started_ns] = rows(run, "g1", "0").started_ns
    gone_s = 1.0 + 60.0 / 100.0
    # a tick, 5 ms until it looks again, the frame before it, and twice DIFS and 15 slots of 9 us
    assert gone_s - 0.001 < started_ns / 1e9 < gone_s + 0.01 + 0.005 + 0.001 + 2 * 0.00017
