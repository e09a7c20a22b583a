"""Presets of real radios, in runs: what takes time takes that of its radio, and pairs hear nobody else.

Times are reckoned here from the lengths of frames and the rates of each standard or firmware.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from math import ceil
from pathlib import Path
from typing import Any

import pytest

from channel.presets import load_radio, preset_names
from lostlink import Run
from tests import warm
from tests.integration.bridge.radio.test_air import FLAT, balances, node

SIK = ("telemetry-915", "sik-433", "sik-868", "rfd900x")
PAIRS = (*SIK, "elrs-2.4-333full", "elrs-900-200")
NETWORKS = {"lte-uav": 0.015, "satellite": 0.25}
"""And the least that a packet takes, s."""
ALL_HEAR_ALL = ("wifi-2.4", "wifi-5.8", "xbee-900hp", *NETWORKS)
LENGTH_BYTES = 100
FAR_M = 400e3


def ofdm_us(mbps: int) -> int:
    """IEEE 802.11-2020, 17: 20 us, then symbols of 4 us; MAC, LLC and FCS are 36 bytes, IPv4 and UDP 28."""
    return 20 + 4 * ceil((16 + 8 * (LENGTH_BYTES + 36 + 28) + 6) / (4 * mbps))


SIK_US = 8 * (8 + 2 + 2 + 1 + LENGTH_BYTES + 2 + 2) / 0.064
"""Preamble, sync, NETID, length, data, trailer, CRC, at 64 kb/s."""
ON_AIR_US = {
    "wifi-2.4": ofdm_us(6) + 6,  # signal extension at 2.4 GHz
    "wifi-5.8": ofdm_us(12),
    "xbee-900hp": 640 + 8 * (LENGTH_BYTES + 24) / 0.2,
    **dict.fromkeys(SIK, SIK_US),
    "elrs-2.4-333full": 2374,  # of the fragment in which it ends
    "elrs-900-200": 4380,
    "lte-uav": 8 * (LENGTH_BYTES + 28) / 5.0,
    "satellite": 8 * (LENGTH_BYTES + 28) / 0.2,
}


@pytest.fixture
def flown(tmp_path: Path, free_slot: Callable[[int], int]) -> Callable[[str], Run]:
    def flown(preset: str) -> Run:
        """Pairs are 0 and g1, g2 and g3, g4 and far g5; packets are 150 ms apart, and none meets another."""
        tos = {1: ("0", "g2"), 2: ("g3", "0"), 3: ("g2", "g1"), 5: ("g4", "g1")}
        sends = {
            n: [(1.0 + 0.15 * n + k, to, LENGTH_BYTES) for k, to in enumerate(("all", *tos.get(n, ())))]
            for n in (1, 2, 3, 5)
        }
        north_m = {0: 0.0, 1: 100.0, 2: 200.0, 3: 300.0, 4: 400.0, 5: FAR_M}
        nodes = [node(n, away_m, sends=sends.get(n, [])) for n, away_m in north_m.items()]
        scenario: dict[str, Any] = {
            "schema": 1,
            "name": "presets",
            "duration_s": 6.0,
            "figure": False,
            "origin": {"lat_deg": 37.0, "lon_deg": 127.0, "alt_amsl_m": 50.0},
            "fdm": {"standin_rate_hz": 100},
            "transmit": FLAT,
            "ports": {"first_slot": free_slot(1), "zenoh": 0},
            "radio": {"preset": preset, "base_loss": 0.0, "bursts": {"model": "none"}}
            | ({"medium": {"bad_s": 0.0}} if preset in NETWORKS else {}),
            "nodes": nodes,
        }
        return warm.flown(scenario, tmp_path / "run")

    return flown


def test_each_preset_that_takes_time_is_here() -> None:
    takes_time = {name for name in preset_names() if load_radio(name).medium.takes_time}
    assert takes_time == {*PAIRS, *ALL_HEAR_ALL} == set(ON_AIR_US)


def fates(run: Run) -> dict[tuple[str, str], set[str]]:
    found = run.packets[run.packets.channel == "test"].astype(dict.fromkeys(("tx", "rx", "fate"), str))
    return {(str(tx), str(rx)): set(each.fate) for (tx, rx), each in found.groupby(["tx", "rx"])}


def expected(preset: str) -> dict[tuple[str, str], str]:
    """What becomes of all from one node to another; far g5 is beyond the horizon of all but networks."""
    found = {}
    for tx in ("g1", "g2", "g3", "g5"):
        for rx in {"0", "g1", "g2", "g3", "g4", "g5"} - {tx}:
            is_near = "g5" not in (tx, rx) or preset in NETWORKS
            is_heard = preset not in PAIRS or {tx, rx} in ({"0", "g1"}, {"g2", "g3"}, {"g4", "g5"})
            found[tx, rx] = "no_peer" if not is_heard else "delivered" if is_near else "lost"
    return found


SLOW, LONG = {"elrs-2.4-333full", "rfd900x", "sik-433", "satellite", "wifi-5.8"}, {"elrs-900-200", "sik-868"}
"""Their kind is flown quickly by another, or they have hundreds of slots a second."""


@pytest.mark.parametrize(
    "preset",
    [
        pytest.param(
            name, marks=pytest.mark.slow if name in SLOW else pytest.mark.long if name in LONG else ()
        )
        for name in sorted(ON_AIR_US)
    ],
)
def test_a_preset_flies(flown: Callable[[str], Run], preset: str) -> None:
    run = flown(preset)
    summary = json.loads((run.path / "summary.json").read_text())
    assert summary["outcome"] != "fail"
    assert all(check["passed"] for check in summary["checks"])
    assert balances(run)
    found = fates(run)
    for ends, fate in expected(preset).items():
        if fate == "lost":
            assert not found[ends] & {"delivered", "no_peer"}, ends
        else:  # SiK's pairs meet on a channel now and then
            assert found[ends] - ({"collided"} if preset in SIK else set()) == {fate}, ends
    packets = run.packets
    came = packets[(packets.channel == "test") & (packets.fate == "delivered")]
    lasted_us = (came.ended_ns - came.started_ns) / 1e3
    assert lasted_us.to_list() == pytest.approx([ON_AIR_US[preset]] * len(came), abs=0.001)
    least_s = NETWORKS.get(preset, ON_AIR_US[preset] / 1e6)
    assert ((came.arrived_ns - came.entered_ns) / 1e9 >= least_s).all()
