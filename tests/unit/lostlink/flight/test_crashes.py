"""UA that hit the ground, or ended on their side or back."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import pytest

from bridge.bus.messages import Header, Quaternion, Truth, Vector3
from bridge.record.tables import reader
from bridge.record.tables.truth import TruthWriter
from bridge.run.directory import RunDirectory
from lostlink.flight.crashes import crashes
from tests.unit.lostlink.replay.flown import scenario_of

TICK_NS = 50_000_000
GRAVITY = 9.81
Track = Callable[[float], tuple[float, float, float]]
"""Height, m, sink, m/s, and roll, deg, at a sim time, s."""


def falls_from(height_m: float, rests_deg: float = 0.0) -> Track:
    """A free fall that ends on the ground within a tick."""

    def at(time_s: float) -> tuple[float, float, float]:
        left_m = height_m - 0.5 * GRAVITY * time_s**2
        return (left_m, GRAVITY * time_s, 0.0) if left_m > 0.0 else (0.15, 0.0, rests_deg)

    return at


def lands(time_s: float) -> tuple[float, float, float]:
    """At 2.5 m/s down to 3 m, at 1 m/s from there."""
    height_m = 10.0 - 2.5 * time_s
    sink_mps = 2.5
    if height_m < 3.0:
        height_m, sink_mps = 3.0 - (time_s - 2.8), 1.0
    return (height_m, sink_mps, 0.0) if height_m > 0.1 else (0.1, 0.0, 0.0)


def pulls_out(time_s: float) -> tuple[float, float, float]:
    """A dive at 15 m/s that ends within half a second, 2.5 m up, in a bank."""
    left_s = max(2.0 - time_s, 0.0)
    return 2.5 + 15.0 * left_s**2, 30.0 * left_s, 75.0


def test_of_a_fleet_the_hardest_impacts_are_told_first_and_who_lies_where_it_fell(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """From 5 and 20 m: sqrt(2 g h) is 9.9 and 19.8 m/s. The table is read in parts that end anywhere."""
    monkeypatch.setattr(reader, "READ_ROWS", 7)
    tracks: dict[str, Track] = {
        "0": lands,
        "1": falls_from(5.0, rests_deg=170.0),
        "2": falls_from(20.0, rests_deg=20.0),
        "3": pulls_out,
        "4": falls_from(0.3),
    }
    scenario = scenario_of("perfect", list(tracks))
    run = RunDirectory.create(tmp_path, "run")
    writer = TruthWriter(run.path, list(tracks))
    for number in range(200):
        writer.append(number * TICK_NS, [truth(node, number, track) for node, track in tracks.items()])
    writer.close()
    hit, lie = crashes(scenario, run)
    told = "UA 2 at 19.6 m/s, at 2.05 s; 1 at 9.8 m/s, at 1.05 s"
    assert hit == f"hit the ground: {told}: flight models take no damage"
    assert lie == "ended on their side or back: UA 1 (tilted by 170 deg)"


def truth(node: str, number: int, track: Track) -> Truth:
    height_m, sink_mps, roll_deg = track(number * TICK_NS / 1e9)
    half = math.radians(roll_deg) / 2.0
    return Truth(
        Header.at(number * TICK_NS, node),
        position_ned_m=Vector3(0.0, 0.0, -height_m),
        velocity_ned_mps=Vector3(0.0, 0.0, sink_mps),
        attitude=Quaternion(math.sin(half), 0.0, 0.0, math.cos(half)),
    )
