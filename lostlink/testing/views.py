"""What a test asks of a flight: where a UA was, what a link delivered. All of it is read from the record, by sim time.

So an answer does not depend on how fast the machine is or when it was asked: the same flight gives the same answers.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lostlink.reading.run import Run

NS_PER_S = 1e9
_PLACE = ("position_north_m", "position_east_m", "position_down_m")


@dataclass(frozen=True)
class Place:
    """Somewhere in the fleet's frame; an axis that is None does not matter.

    Raises:
        ValueError: no axis matters.
    """

    north_m: float | None = None
    east_m: float | None = None
    height_m: float | None = None

    def __post_init__(self) -> None:
        if self.north_m is self.east_m is self.height_m is None:
            raise ValueError("a place needs north_m, east_m or height_m")

    def distance_m(self, position_ned_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """How far positions, shape (n, 3), are from it, along the axes that matter."""
        down_m = None if self.height_m is None else -self.height_m
        axes = {i: value for i, value in enumerate((self.north_m, self.east_m, down_m)) if value is not None}
        found: NDArray[np.float64] = np.linalg.norm(
            position_ned_m[:, list(axes)] - np.array(list(axes.values())), axis=1
        )
        return found


class RecordedNode:
    """What the record says of one node."""

    def __init__(self, run: Run, node: str) -> None:
        if node not in run.nodes:
            raise ValueError(f"no node {node!r}; there are {', '.join(run.nodes)}")
        self._run, self.node = run, node

    def track(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """True positions so far: sim times in s, shape (n,), and north, east, down in m, shape (n, 3)."""
        truth = self._run.columns("truth", ("tick_ns", "node", *_PLACE))
        own = truth["node"] == self.node
        return truth["tick_ns"][own] / NS_PER_S, np.stack([truth[axis][own] for axis in _PLACE], axis=1)

    def position_ned_m(self, sim_time_s: float) -> NDArray[np.float64]:
        """True position at the last tick not after ``sim_time_s``, shape (3,).

        Raises:
            ValueError: it was not there yet.
        """
        times_s, places = self.track()
        row = int(np.searchsorted(times_s, sim_time_s + 1e-9, side="right")) - 1
        if row < 0:
            raise ValueError(f"node {self.node} was not there yet at {sim_time_s} s")
        found: NDArray[np.float64] = places[row]
        return found

    def state(self, sim_time_s: float) -> dict[str, Any]:
        """What its autopilot said of itself last, not after ``sim_time_s``: a row of `states`.

        Raises:
            ValueError: it had not said anything yet.
        """
        states = self._run.columns("states")
        rows = np.flatnonzero(
            (states["node"] == self.node) & (states["tick_ns"] <= sim_time_s * NS_PER_S + 1)
        )
        if not len(rows):
            raise ValueError(f"node {self.node} had no state yet at {sim_time_s} s")
        return {
            name: column[rows[-1] : rows[-1] + 1].tolist()[0]
            for name, column in states.items()
            if name != "node"
        }

    def reaches(
        self, place: Place, within_m: float = 5.0, after_s: float = 0.0, before_s: float = np.inf
    ) -> float:
        """When, in s of sim time, it first was within ``within_m`` of a place.

        Raises:
            AssertionError: it never was; the text says how near it came.
        """
        times_s, places = self.track()
        during = (times_s >= after_s) & (times_s <= before_s)
        times_s, distance_m = times_s[during], place.distance_m(places[during])
        near = np.flatnonzero(distance_m <= within_m)
        if len(near):
            return float(times_s[near[0]])
        if not len(times_s):
            raise AssertionError(f"node {self.node}: nothing was recorded between {after_s} and {before_s} s")
        nearest = int(np.argmin(distance_m))
        raise AssertionError(
            f"node {self.node} was never within {within_m} m of {place}: nearest was {distance_m[nearest]:.1f} m at "
            f"{times_s[nearest]:.2f} s"
        )


class RecordedLink:
    """What the record says of one directed link."""

    def __init__(self, run: Run, tx: str, rx: str) -> None:
        for node in (tx, rx):
            if node not in run.nodes:
                raise ValueError(f"no node {node!r}; there are {', '.join(run.nodes)}")
        self._run, self.tx, self.rx = run, tx, rx

    def packets(
        self, *, from_s: float = 0.0, to_s: float = np.inf, min_m: float = 0.0, max_m: float = np.inf
    ) -> dict[str, NDArray[Any]]:
        """Rows of `deliveries`: sent from ``from_s`` to before ``to_s``, and over ``min_m`` to below ``max_m``."""
        rows = self._run.columns("deliveries")
        ours = (rows["tx"] == self.tx) & (rows["rx"] == self.rx)
        ours &= (rows["sim_time_ns"] >= from_s * NS_PER_S) & (rows["sim_time_ns"] < to_s * NS_PER_S)
        if min_m > 0.0 or max_m < np.inf:
            ours &= (rows["distance_m"] >= min_m) & (rows["distance_m"] < max_m)
        return {name: column[ours] for name, column in rows.items()}

    def delivery(
        self, *, from_s: float = 0.0, to_s: float = np.inf, min_m: float = 0.0, max_m: float = np.inf
    ) -> float:
        """Share of the packets that were delivered; arguments as of `packets`.

        Raises:
            AssertionError: there were none.
        """
        rows = self.packets(from_s=from_s, to_s=to_s, min_m=min_m, max_m=max_m)
        count = int(rows["packets"].sum())
        if not count:
            raise AssertionError(f"nothing was sent from {self.tx} to {self.rx} there and then")
        return float(rows["packets"][rows["fate"] == "delivered"].sum() / count)
