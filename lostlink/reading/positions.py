"""Where the nodes of a run truly were at each tick, and how near they came to each other."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from itertools import combinations
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bridge.record.tables.truth import POSITION, TrueStates

Floats = NDArray[np.float64]


def places_of(run: Path, nodes: Sequence[str]) -> tuple[NDArray[np.int64], dict[str, Floats]]:
    """The ticks of a run, and each node's places then.

    Args:
        run: the run directory.
        nodes: ids of all its stations.

    Returns:
        Sim times of the ticks, ns, rising, shape (ticks,), and by node its north-east-down place in the fleet's frame,
        m, shape (ticks, 3), NaN before its first. A tick without one is one at which its autopilot stood still, and
        the aircraft with it: it is where it was.

    Raises:
        TableError, OSError: the true states are missing or damaged, or cannot be read.
    """
    truth = TrueStates.read(run, nodes, POSITION)
    places = np.full((len(nodes), len(truth.ticks_ns), 3), np.nan)
    places[truth.node, truth.tick] = truth.position_ned_m
    for track in places:
        _hold(track)
    return truth.ticks_ns, dict(zip(nodes, places, strict=True))


def _hold(track: Floats) -> None:
    """Put the place before it at each tick that has none."""
    has_none = np.isnan(track[:, 0])
    if has_none.any():
        track[:] = track[np.maximum.accumulate(np.where(has_none, 0, np.arange(len(track))))]


def places_at(ticks_ns: NDArray[np.int64], track: Floats, at_ns: NDArray[np.int64]) -> Floats:
    """Where a node was at the last tick not after each instant, m, shape (n, 3); NaN before the first.

    Args:
        ticks_ns: sim times, rising, shape (ticks,).
        track: its places then, shape (ticks, 3).
        at_ns: instants, shape (n,).
    """
    found = np.full((len(at_ns), 3), np.nan)
    tick = np.searchsorted(ticks_ns, at_ns, side="right") - 1
    found[tick >= 0] = track[tick[tick >= 0]]
    return found


def distances_m(
    recorded_m: Floats,
    is_of_host: NDArray[np.bool_],
    places: Callable[[NDArray[np.intp]], tuple[Floats, Floats]],
) -> Floats:
    """How far apart the ends of packets were: as recorded or, of those that never were on the air, when they were sent.

    Args:
        recorded_m: NaN where a packet never was on the air, shape (n,).
        is_of_host: which of them the host lost: of these nobody knows it.
        places: gives where both ends of some packets, by their places here, were when these were sent.
    """
    found: Floats = recorded_m.copy()
    missing = np.flatnonzero(np.isnan(found) & ~is_of_host)
    if missing.size:
        tx, rx = places(missing)
        found[missing] = np.linalg.norm(tx - rx, axis=1)
    return found


def separation_m(tracks: Iterable[Floats]) -> tuple[float, float]:
    """The least and the greatest distance of two tracks at one tick, m; nan if no two of them were anywhere at once.

    Args:
        tracks: as `places_of` gives them.
    """
    nearest = farthest = float("nan")
    for a, b in combinations(tracks, 2):
        apart_m = np.linalg.norm(a - b, axis=1)
        nearest = float(np.fmin.reduce(apart_m, initial=nearest))
        farthest = float(np.fmax.reduce(apart_m, initial=farthest))
    return nearest, farthest
