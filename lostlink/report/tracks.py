"""Where the nodes of a run were: their ways, thinned, and what they come to."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from bridge.record.tables.truth import POSITION, TRUTH, VELOCITY, TrueStates
from lostlink.reading.run import Run

POINTS_MAX = 600
"""Of a node's way; more are not seen."""


def tracks_of(run: Run) -> dict[str, Any]:
    """By node: its kind, figures of its way, and points of it.

    ``nodes[]``: ``id``, ``title``, ``kind``; ``height_min_m``, ``height_max_m``, ``farthest_m`` from the origin over
    the ground, ``way_m`` flown, ``speed_max_mps`` over the ground. ``tracks[]``: ``id`` and ``sim_time_s``,
    ``north_m``, ``east_m``, ``height_m`` of up to `POINTS_MAX` points. Heights are above the origin.
    """
    nodes = {node.node: node for node in run.scenario.nodes}
    figures, tracks = [], []
    for node_id, sim_time_s, place, velocity in _ways(run):
        title, kind = run.scenario.title(node_id), nodes[node_id].kind
        figures.append({"id": node_id, "title": title, "kind": kind, **_figures(place, velocity)})
        tracks.append({"id": node_id, "kind": kind, **_points(sim_time_s, place)})
    return {"nodes": figures, "tracks": tracks}


def _ways(run: Run) -> list[tuple[str, NDArray[Any], NDArray[Any], NDArray[Any]]]:
    """Of each node of which there is a true state: instants, places and velocities, in the order of the scenario."""
    if not TRUTH.is_in(run.path):
        return []
    truth = TrueStates.read(run.path, run.nodes, (*POSITION, *VELOCITY))
    own = [(node_id, np.flatnonzero(truth.node == place)) for place, node_id in enumerate(run.nodes)]
    return [
        (
            node_id,
            truth.sim_time_ns[rows] / 1e9,
            truth.position_ned_m[rows],
            truth.velocity_ned_mps[rows],
        )
        for node_id, rows in own
        if rows.size
    ]


def _figures(ned_m: NDArray[Any], ned_mps: NDArray[Any]) -> dict[str, float]:
    steps_m = np.linalg.norm(np.diff(ned_m, axis=0), axis=1)
    return {
        "height_min_m": float(-ned_m[:, 2].max()),
        "height_max_m": float(-ned_m[:, 2].min()),
        "farthest_m": float(np.hypot(ned_m[:, 0], ned_m[:, 1]).max()),
        "way_m": float(steps_m.sum()),
        "speed_max_mps": float(np.hypot(ned_mps[:, 0], ned_mps[:, 1]).max()),
    }


def _points(sim_time_s: NDArray[Any], ned_m: NDArray[Any]) -> dict[str, list[float]]:
    """Evenly in time; one that does not move has its ends."""
    stands = np.ptp(ned_m, axis=0).max() == 0.0
    count = min(len(sim_time_s), 2 if stands else POINTS_MAX)
    at = np.unique(np.linspace(0, len(sim_time_s) - 1, count).round().astype(np.intp))
    return {
        "sim_time_s": np.round(sim_time_s[at], 3).tolist(),
        "north_m": np.round(ned_m[at, 0], 2).tolist(),
        "east_m": np.round(ned_m[at, 1], 2).tolist(),
        "height_m": np.round(-ned_m[at, 2], 2).tolist(),
    }
