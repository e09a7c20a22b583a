"""Where every node was: the rows of `truth` as arrays, by ticks, and as messages."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bridge.bus.messages import Header, Quaternion, Truth, Vector3
from bridge.record.tables.schema import FRD, NED, NUMBER, TRUTH
from lostlink.reading.coded import coded_columns

_NUMBERS = tuple(column.name for column in TRUTH.columns if column.dtype == NUMBER)
_PLACE = tuple(f"position_{axis}_m" for axis in NED)
_ATTITUDE = tuple(f"attitude_{axis}" for axis in "wxyz")


@dataclass(frozen=True)
class Positions:
    """Rows of `truth`, in its order.

    Attributes:
        nodes: ids of all stations.
        ticks_ns: all ticks, rising.
        first: the first row of each tick, and behind the last one how many rows there are.
        node: place of the node of each row.
        sim_time_ns: the instant of each row.
        numbers: the other columns by name.
    """

    nodes: tuple[str, ...]
    ticks_ns: NDArray[np.int64]
    first: NDArray[np.intp]
    node: NDArray[np.intp]
    sim_time_ns: NDArray[np.int64]
    numbers: dict[str, NDArray[np.float64]]

    @classmethod
    def read(cls, run: Path, nodes: Sequence[str], *, only_places: bool = False) -> Positions:
        """Of the run in ``run``.

        Args:
            run: the run directory.
            nodes: ids of all stations.
            only_places: leave out all but positions and attitudes.

        Raises:
            TableError, OSError: its truth is missing or damaged, or cannot be read.
        """
        numbers = (*_PLACE, *_ATTITUDE) if only_places else _NUMBERS
        names = ("tick_ns", "node", "sim_time_ns", *numbers)
        columns = coded_columns(run, TRUTH, {"node": tuple(nodes)}, names)
        ticks_ns, first = np.unique(columns["tick_ns"], return_index=True)
        bounds = np.append(first, len(columns["tick_ns"])).astype(np.intp)
        kept = {name: columns[name] for name in numbers}
        return cls(tuple(nodes), ticks_ns, bounds, columns["node"], columns["sim_time_ns"], kept)

    @cached_property
    def position_ned_m(self) -> NDArray[np.float64]:
        """Of each row, shape (rows, 3)."""
        return np.stack([self.numbers[name] for name in _PLACE], axis=-1)

    @cached_property
    def attitude_wxyz(self) -> NDArray[np.float64]:
        """Of each row, shape (rows, 4)."""
        return np.stack([self.numbers[name] for name in _ATTITUDE], axis=-1)

    @property
    def last_whole_ns(self) -> int:
        """The last tick that has as many rows as the one before it, or that one: a file that was cut ends in a row."""
        rows = np.diff(self.first)
        is_whole = rows.size < 2 or rows[-1] >= rows[-2]
        return int(self.ticks_ns[-1 if is_whole else -2])

    def without_nonsense(self) -> Positions:
        """All but rows that no radio can work with, which the router refuses: a flight model may diverge."""
        length = np.sqrt(np.sum(np.square(self.attitude_wxyz), axis=-1))
        good = np.isfinite(self.position_ned_m).all(axis=-1) & (length > 0.5) & (length < 2.0)
        if good.all():
            return self
        first = np.concatenate(([0], np.cumsum(good)))[self.first]
        numbers = {name: values[good] for name, values in self.numbers.items()}
        return Positions(self.nodes, self.ticks_ns, first, self.node[good], self.sim_time_ns[good], numbers)

    def rows_of(self, tick: int) -> range:
        """The rows of the tick with this number."""
        return range(int(self.first[tick]), int(self.first[tick + 1]))

    def message(self, row: int) -> Truth:
        """A row as the message that it was written from."""

        def vector(name: str, unit: str, axes: Sequence[str]) -> Vector3:
            return Vector3(*(float(self.numbers[f"{name}_{axis}_{unit}"][row]) for axis in axes))

        def number(name: str) -> float:
            return float(self.numbers[name][row])

        w, x, y, z = (number(name) for name in _ATTITUDE)
        return Truth(
            Header.at(int(self.sim_time_ns[row]), self.nodes[self.node[row]]),
            number("longitude_deg"),
            number("latitude_deg"),
            number("altitude_amsl_m"),
            vector("position", "m", NED),
            vector("velocity", "mps", NED),
            Quaternion(x, y, z, w),
            vector("body_rate", "radps", FRD),
            vector("specific_force", "mps2", FRD),
            number("airspeed_mps"),
            vector("wind", "mps", NED),
        )
