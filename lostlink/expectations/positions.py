"""What the true states of a run show: where nodes were, and how near they came to each other."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from pathlib import Path

import numpy as np

from bridge.scenario.expectations import PositionExpectation, SeparationExpectation
from bridge.scenario.model import Scenario
from lostlink.reading.positions import Floats, places_of, separation_m


class PlaceFinder:
    """Looks into `truth` of a run, which is read when it is first asked for.

    Args:
        run: its directory.
        scenario: what was flown.
    """

    def __init__(self, run: Path, scenario: Scenario) -> None:
        self._run, self._scenario = run, scenario

    @cached_property
    def _tracks(self) -> tuple[Floats, dict[str, Floats]]:
        """Times of the ticks, s, and of each node its places then, shape (ticks, 3), NaN where there is none."""
        ticks_ns, tracks = places_of(self._run, self._scenario.stations)
        return ticks_ns.astype(np.float64) / 1e9, tracks

    @property
    def end_s(self) -> float:
        """Sim time of the last tick; 0 if there is none."""
        times_s, _ = self._tracks
        return float(times_s[-1]) if len(times_s) else 0.0

    def distance_m(self, wanted: PositionExpectation) -> float | None:
        """How far the node was from the place: then, or the least or greatest distance; None if it was nowhere then."""
        times_s, tracks = self._tracks
        down_m = 0.0 if wanted.height_m is None else -wanted.height_m
        away = tracks[wanted.node] - (wanted.north_m, wanted.east_m, down_m)
        distances = np.linalg.norm(away if wanted.height_m is not None else away[:, :2], axis=1)
        known = np.isfinite(distances)
        times_s, distances = times_s[known], distances[known]
        if not len(distances):
            return None
        if isinstance(wanted.at, str):
            found = {"end": distances[-1], "ever": distances.min(), "always": distances.max()}
            return float(found[wanted.at])
        after = int(np.searchsorted(times_s, wanted.at - 1e-9))
        return float(distances[after]) if after < len(times_s) else None

    def separation_m(self, wanted: SeparationExpectation) -> tuple[float, float] | None:
        """The least and the greatest distance of any two of the nodes; None if no two of them were anywhere then."""
        times_s, tracks = self._tracks
        nodes: Sequence[str] = wanted.among or [ua.node for ua in self._scenario.ua]
        begin_s, until_s = wanted.between_s or (0.0, np.inf)
        when = (times_s >= begin_s) & (times_s <= until_s)
        found = separation_m(tracks[node][when] for node in nodes)
        return None if np.isnan(found[0]) else found
