"""UA that hit the ground, or ended on their side or back: flight models take no damage, and the run goes on."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import acos, degrees, nan

import numpy as np

from bridge.record.tables.reader import read_batches
from bridge.record.tables.schema import Columns, TableError
from bridge.record.tables.truth import TRUTH
from bridge.run.directory import RunDirectory
from bridge.scenario.model import Scenario
from lostlink.reading.air.use import NS_PER_S
from lostlink.reading.named import named

SINK_MIN_MPS = 3.0
"""A fall from half a metre; landings have a third of it."""
GROUND_WITHIN_M = 2.0
"""The height of a model's reference point, of what stands, lies or has its nose in the ground."""
TILT_MAX_DEG = 60.0
"""Nothing stands on its feet or wheels at more."""
WHERE = ("tick_ns", "node", "position_down_m", "velocity_down_mps", "attitude_x", "attitude_y")


@dataclass(slots=True)
class _Fall:
    """What became of one UA: its last row, and the hardest impact."""

    last: dict[str, float] | None = None
    sink_mps: float = 0.0
    at_s: float = nan


def crashes(scenario: Scenario, run: RunDirectory) -> Iterator[str]:
    """Warnings: UA that hit the ground, the hardest first, and UA that ended on their side or back."""
    falls = {ua.node: _Fall() for ua in scenario.ua}
    nodes = scenario.stations
    try:
        for rows in read_batches(run.path, TRUTH, WHERE, {"node": nodes}):
            for node, fall in falls.items():
                at = np.flatnonzero(rows["node"] == nodes.index(node))
                _look(fall, {name: rows[name][at] for name in WHERE})
    except (OSError, TableError):
        return  # why it cannot be read is reported where it should have become Parquet
    hard = sorted((ua for ua, fall in falls.items() if fall.sink_mps), key=lambda ua: -falls[ua].sink_mps)
    if hard:
        words = [f"{ua} at {falls[ua].sink_mps:.1f} m/s, at {falls[ua].at_s:g} s" for ua in hard]
        yield f"hit the ground: UA {named(words, '; ')}: flight models take no damage"
    tilts_deg = {ua: _tilt_deg(fall) for ua, fall in falls.items()}
    lying = [f"{ua} (tilted by {tilt_deg:.0f} deg)" for ua, tilt_deg in tilts_deg.items() if tilt_deg]
    if lying:
        yield f"ended on their side or back: UA {named(lying, '; ')}"


def _look(fall: _Fall, rows: Columns) -> None:
    """Take further rows of a UA into account."""
    if not len(rows["tick_ns"]):
        return
    if fall.last is not None:
        rows = {name: np.concatenate(([fall.last[name]], values)) for name, values in rows.items()}
    height_m, sink_mps, at_s = -rows["position_down_m"], rows["velocity_down_mps"], rows["tick_ns"] / NS_PER_S
    would_be_at_m = height_m[:-1] - sink_mps[:-1] * np.diff(at_s)
    stopped = (sink_mps[:-1] >= SINK_MIN_MPS) & (sink_mps[1:] < sink_mps[:-1] / 2)
    hits = np.flatnonzero(stopped & (would_be_at_m < GROUND_WITHIN_M) & (height_m[1:] < GROUND_WITHIN_M))
    if hits.size:
        hardest = hits[np.argmax(sink_mps[hits])]
        if sink_mps[hardest] > fall.sink_mps:
            fall.sink_mps, fall.at_s = float(sink_mps[hardest]), float(at_s[hardest + 1])
    fall.last = {name: float(values[-1]) for name, values in rows.items()}


def _tilt_deg(fall: _Fall) -> float:
    """How a UA is tilted that ended on the ground, but not upright, deg; else 0."""
    last = fall.last
    if last is None or -last["position_down_m"] >= GROUND_WITHIN_M:
        return 0.0
    tilt_deg = degrees(acos(max(-1.0, 1.0 - 2.0 * (last["attitude_x"] ** 2 + last["attitude_y"] ** 2))))
    return tilt_deg if tilt_deg > TILT_MAX_DEG else 0.0
