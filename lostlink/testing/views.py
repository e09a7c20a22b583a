"""What a test asks of a flight: where a UA was, what a link delivered. All of it is read from the record, by sim time.

So an answer does not depend on how fast the machine is or when it was asked: the same flight gives the same answers.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from bridge.bus.keys import ALL
from bridge.record.tables.deliveries import Cause
from lostlink.reading.positions import distances_m, places_at
from lostlink.reading.run import Run

NS_PER_S = 1e9
Columns = dict[str, NDArray[Any]]
_PLACE = ("position_north_m", "position_east_m", "position_down_m")
_TRACK = ("tick_ns", "node", *_PLACE)


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


class Recorded(Protocol):
    """How far a record goes that may still grow."""

    @property
    def end_s(self) -> float:
        """Sim time at which answers end that name no end."""

    def reach(self, sim_time_s: float) -> None:
        """Wait until it goes so far, or no further."""

    def ended_before(self, sim_time_s: float, /) -> str:
        """How the flight ended, if that was before a sim time; empty if it was not."""

    def columns(self, run: Run, table: str, columns: Sequence[str] | None = None) -> Columns:
        """Columns of a table, which may just now become another file."""


class Whole:
    """The record of a flight that is over."""

    end_s = np.inf

    def reach(self, sim_time_s: float) -> None:
        """It goes as far as it goes."""

    def ended_before(self, _: float) -> str:
        """No flight is known of."""
        return ""

    def columns(self, run: Run, table: str, columns: Sequence[str] | None = None) -> Columns:
        """Columns of a table."""
        return run.columns(table, columns)


def _track_of(truth: Columns, node: str) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """A node's ticks in ns, shape (n,), and its places then, north, east, down in m, shape (n, 3)."""
    own = truth["node"] == node
    return truth["tick_ns"][own], np.stack([truth[axis][own] for axis in _PLACE], axis=1)


class RecordedNode:
    """What the record says of one node."""

    def __init__(self, run: Run, node: str, extent: Recorded | None = None) -> None:
        if node not in run.nodes:
            raise ValueError(f"no node {node!r}; there are {', '.join(run.nodes)}")
        self._run, self.node, self._extent = run, node, extent or Whole()

    def __repr__(self) -> str:
        """What an assertion shows of it: where it is, as far as the test has waited; it waits for nothing itself."""
        with suppress(OSError, ValueError):
            times_s, places = self._track(self._run.columns("truth", _TRACK))
            if row := int(np.sum(times_s <= self._extent.end_s)):
                north_m, east_m, up_m = np.round(places[row - 1] * (1.0, 1.0, -1.0), 1) + 0.0  # no -0.0
                place = f"{north_m:.1f} m N, {east_m:.1f} m E, {up_m:.1f} m up"
                return f"<{type(self).__name__} {self.node}: {place} at {times_s[row - 1]:.2f} s>"
        return f"<{type(self).__name__} {self.node}>"

    def track(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """True positions: sim times in s, shape (n,), and north, east, down in m, shape (n, 3).

        Of a flight that goes on, as far as the test has waited for it.
        """
        end_s = self._extent.end_s
        self._extent.reach(end_s)
        times_s, places = self._track(self._extent.columns(self._run, "truth", _TRACK))
        return times_s[times_s <= end_s], places[times_s <= end_s]

    def _track(self, truth: Columns) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        ticks_ns, places = _track_of(truth, self.node)
        return ticks_ns / NS_PER_S, places

    def position_ned_m(self, sim_time_s: float) -> NDArray[np.float64]:
        """True position at the last tick not after ``sim_time_s``, shape (3,). Waits for it while the flight goes on.

        Raises:
            ValueError: it was not there yet, or no longer: nothing is recorded of it after some tick before that.
        """
        self._extent.reach(sim_time_s)
        times_s, places = self._track(self._extent.columns(self._run, "truth", _TRACK))
        found: NDArray[np.float64] = places[self._row(times_s, sim_time_s)]
        return found

    def _row(self, times_s: NDArray[np.float64], sim_time_s: float) -> int:
        """The tick that holds at a sim time, of those of which there is a true state."""
        row = int(np.searchsorted(times_s, sim_time_s + 1e-9, side="right")) - 1
        if row < 0:
            raise ValueError(f"node {self.node} was not there yet at {sim_time_s} s")
        if row == len(times_s) - 1 and sim_time_s >= times_s[-1] + np.min(np.diff(times_s), initial=np.inf):
            raise ValueError(
                f"node {self.node}: nothing is recorded of it after {times_s[-1]:.2f} s, "
                f"and {sim_time_s} s was asked for{self._because(sim_time_s)}"
            )
        return row

    def _because(self, sim_time_s: float) -> str:
        """How the flight ended before a sim time, to be said after something else; empty if it did not."""
        ended = self._extent.ended_before(sim_time_s)
        return f"; {ended}" if ended else ""

    def state(self, sim_time_s: float) -> dict[str, Any]:
        """What its autopilot said of itself last, not after ``sim_time_s``: a row of `states`. Waits as for a position.

        Raises:
            ValueError: it had not said anything yet; or as of `position_ned_m`.
        """
        self._extent.reach(sim_time_s)
        times_s, _ = self._track(self._extent.columns(self._run, "truth", _TRACK))
        self._row(times_s, sim_time_s)
        states = self._extent.columns(self._run, "states")
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
        """When, in s of sim time, it first was within ``within_m`` of a place, by the record as it is now.

        Raises:
            AssertionError: it never was; the text says how near it came.
        """
        times_s, places = self._track(self._run.columns("truth", _TRACK))
        during = (times_s >= after_s) & (times_s <= before_s)
        times_s, distance_m = times_s[during], place.distance_m(places[during])
        near = np.flatnonzero(distance_m <= within_m)
        if len(near):
            return float(times_s[near[0]])
        if not len(times_s):
            raise AssertionError(
                f"node {self.node}: nothing was recorded between {after_s} and {before_s} s{self._because(before_s)}"
            )
        nearest = int(np.argmin(distance_m))
        raise AssertionError(
            f"node {self.node} was never within {within_m} m of {place}: nearest was {distance_m[nearest]:.1f} m at "
            f"{times_s[nearest]:.2f} s{self._because(before_s)}"
        )


class RecordedLink:
    """What the record says of one directed link."""

    def __init__(self, run: Run, tx: str, rx: str, extent: Recorded | None = None) -> None:
        for node in (tx, rx):
            if node not in run.nodes:
                raise ValueError(f"no node {node!r}; there are {', '.join(run.nodes)}")
        self._run, self.tx, self.rx, self._extent = run, tx, rx, extent or Whole()

    def __repr__(self) -> str:
        """What an assertion shows of it: counts by network, as far as the test has waited; it waits for nothing."""
        with suppress(OSError, ValueError):
            rows = self._run.columns("deliveries")
            ours = self._ours(rows) & (rows["sim_time_ns"] / NS_PER_S < self._extent.end_s)
            told = [self._counts(network, rows, ours) for network in self._networks(rows, ours)]
            return f"<RecordedLink {self.tx} -> {self.rx}: {'; '.join(told) or 'nothing sent'}>"
        return f"<RecordedLink {self.tx} -> {self.rx}>"

    @staticmethod
    def _networks(rows: Columns, ours: NDArray[np.bool_]) -> list[str]:
        return list(dict.fromkeys(rows["radio"][ours].tolist()))

    @staticmethod
    def _counts(network: str, rows: Columns, ours: NDArray[np.bool_]) -> str:
        on_it = ours & (rows["radio"] == network)
        delivered = on_it & (rows["fate"] == "delivered")
        return f"{network} {rows['packets'][delivered].sum()} of {rows['packets'][on_it].sum()} delivered"

    def _ours(self, rows: Columns) -> NDArray[np.bool_]:
        """Which rows are of this link; those for everybody are."""
        found: NDArray[np.bool_] = (rows["tx"] == self.tx) & ((rows["rx"] == self.rx) | (rows["rx"] == ALL))
        return found

    def packets(
        self, *, from_s: float = 0.0, to_s: float = np.inf, min_m: float = 0.0, max_m: float = np.inf
    ) -> dict[str, NDArray[Any]]:
        """Rows of `deliveries`: sent from ``from_s`` to before ``to_s``, and over ``min_m`` to below ``max_m``.

        Packets that never were on the air count at the distance at which they were sent; of what the host lost nobody
        knows it. A row for everybody (``rx`` is ``all``) is one of this link, too.

        Of a flight that goes on: waits for ``to_s``; without it, as far as the test has waited. A packet that is queued
        or on its way then has no row yet.

        Raises:
            AssertionError: the flight ended before the ``to_s`` that was given; the text says how.
        """
        is_given = np.isfinite(to_s)
        to_s = to_s if is_given else min(to_s, self._extent.end_s)
        self._extent.reach(to_s)
        ended = self._extent.ended_before(to_s) if is_given else ""
        if ended:
            raise AssertionError(ended)
        rows = self._extent.columns(self._run, "deliveries")
        ours = self._ours(rows)
        sent_s = rows["sim_time_ns"] / NS_PER_S
        ours &= (sent_s >= from_s) & (sent_s < to_s)
        if min_m > 0.0 or max_m < np.inf:
            distance_m = self._distance_m({name: column[ours] for name, column in rows.items()})
            ours[ours] = (distance_m >= min_m) & (distance_m < max_m)
        return {name: column[ours] for name, column in rows.items()}

    def _distance_m(self, rows: Columns) -> NDArray[np.float64]:
        """Of this link's packets, as `distances_m` gives it."""

        def ends(missing: NDArray[np.intp]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
            truth, at_ns = self._extent.columns(self._run, "truth", _TRACK), rows["sim_time_ns"][missing]
            tx, rx = (places_at(*_track_of(truth, node), at_ns) for node in (self.tx, self.rx))
            return tx, rx

        return distances_m(rows["distance_m"], np.asarray(rows["fate"] == Cause.TRANSPORT), ends)

    def delivery(
        self, *, from_s: float = 0.0, to_s: float = np.inf, min_m: float = 0.0, max_m: float = np.inf
    ) -> float:
        """Share of the packets that were delivered; arguments as of `packets`.

        Raises:
            AssertionError: there were none; or as of `packets`.
        """
        rows = self.packets(from_s=from_s, to_s=to_s, min_m=min_m, max_m=max_m)
        count = int(rows["packets"].sum())
        if not count:
            end_s = min(to_s, self._extent.end_s)
            until = f" from {from_s} to {end_s} s" if np.isfinite(end_s) else ""
            raise AssertionError(f"nothing was sent from {self.tx} to {self.rx} there and then{until}")
        return float(rows["packets"][rows["fate"] == "delivered"].sum() / count)
