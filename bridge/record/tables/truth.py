"""The table `truth`: where every node truly was at each tick. Written by physics."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from bridge.bus.messages import Header, Quaternion, Truth, Vector3
from bridge.record.tables.journal import TableWriter
from bridge.record.tables.reader import read_columns
from bridge.record.tables.schema import (
    FRD,
    LABEL,
    NED,
    NUMBER,
    TICK,
    TIME_MAX_NS,
    Column,
    Table,
    vector,
)

TRUTH: Final = Table(
    "truth",
    (
        Column("tick_ns", TICK, most=TIME_MAX_NS),
        Column("node", LABEL),
        Column("sim_time_ns", TICK, most=TIME_MAX_NS),
        Column("longitude_deg", NUMBER),
        Column("latitude_deg", NUMBER),
        Column("altitude_amsl_m", NUMBER),
        *vector("position", "_m", NED),
        *vector("velocity", "_mps", NED),
        *vector("attitude", "", "wxyz"),
        *vector("body_rate", "_radps", FRD),
        *vector("specific_force", "_mps2", FRD),
        Column("airspeed_mps", NUMBER),
        *vector("wind", "_mps", NED),
    ),
    keys=("tick_ns", "node"),
    tick="tick_ns",
    node="node",
)
"""A row per tick and node, with the fields of `bridge.bus.messages.Truth`."""
NUMBERS: Final = TRUTH.numbers
POSITION: Final = tuple(f"position_{axis}_m" for axis in NED)
VELOCITY: Final = tuple(f"velocity_{axis}_mps" for axis in NED)
ATTITUDE: Final = tuple(f"attitude_{axis}" for axis in "wxyz")


class TruthWriter:
    """Writes true states, a row each.

    Args:
        run: the run directory.
        nodes: ids of all UA.
    """

    def __init__(self, run: Path, nodes: Sequence[str]) -> None:
        self._places = {node: place for place, node in enumerate(nodes)}
        self._writer = TableWriter(run, TRUTH, {"node": nodes})
        self.flush, self.close = self._writer.flush, self._writer.close

    def append(self, tick_ns: int, states: Sequence[Truth]) -> None:
        """Append the states of a tick."""
        for state in states:
            node = self._places[state.header.frame_id]
            self._writer.append_row((tick_ns, node, state.header.stamp.ns, *_numbers(state)))


def _numbers(state: Truth) -> tuple[float, ...]:
    """In the order of the table's columns."""
    q = state.attitude
    return (
        state.longitude_deg,
        state.latitude_deg,
        state.altitude_amsl_m,
        *state.position_ned_m.xyz,
        *state.velocity_ned_mps.xyz,
        *(q.w, q.x, q.y, q.z),
        *state.body_rates_frd_radps.xyz,
        *state.specific_force_frd_mps2.xyz,
        state.airspeed_mps,
        *state.wind_ned_mps.xyz,
    )


def _message(header: Header, numbers: Sequence[float]) -> Truth:
    """From numbers in the order of the table's columns."""
    longitude_deg, latitude_deg, altitude_amsl_m = numbers[:3]
    w, x, y, z = numbers[9:13]
    return Truth(
        header,
        longitude_deg,
        latitude_deg,
        altitude_amsl_m,
        Vector3(*numbers[3:6]),
        Vector3(*numbers[6:9]),
        Quaternion(x, y, z, w),
        Vector3(*numbers[13:16]),
        Vector3(*numbers[16:19]),
        numbers[19],
        Vector3(*numbers[20:]),
    )


@dataclass(frozen=True)
class TrueStates:
    """Rows of the table, in its order.

    Attributes:
        nodes: ids of all stations.
        ticks_ns: all ticks, rising.
        first: the first row of each tick, and behind the last one how many rows there are.
        node: place of the node of each row.
        sim_time_ns: the instant of each row.
        numbers: the other columns by name, in the table's order.
    """

    nodes: tuple[str, ...]
    ticks_ns: NDArray[np.int64]
    first: NDArray[np.intp]
    node: NDArray[np.intp]
    sim_time_ns: NDArray[np.int64]
    numbers: dict[str, NDArray[np.float64]]

    @classmethod
    def read(cls, run: Path, nodes: Sequence[str], numbers: Sequence[str] = NUMBERS) -> TrueStates:
        """Of the run in ``run``.

        Args:
            run: the run directory.
            nodes: ids of all stations.
            numbers: names of the columns wanted; all of them unless given. `message` needs all.

        Raises:
            TableError, OSError: its truth is missing or damaged, or cannot be read.
        """
        columns = read_columns(
            run, TRUTH, ("tick_ns", "node", "sim_time_ns", *numbers), {"node": tuple(nodes)}
        )
        ticks_ns, first = np.unique(columns["tick_ns"], return_index=True)
        bounds = np.append(first, len(columns["tick_ns"])).astype(np.intp)
        kept = {name: columns[name] for name in numbers}
        return cls(tuple(nodes), ticks_ns, bounds, columns["node"], columns["sim_time_ns"], kept)

    @cached_property
    def tick(self) -> NDArray[np.intp]:
        """The number of each row's tick."""
        return np.repeat(np.arange(self.ticks_ns.size), np.diff(self.first))

    @cached_property
    def position_ned_m(self) -> NDArray[np.float64]:
        """Of each row, shape (rows, 3)."""
        return self._together(POSITION)

    @cached_property
    def velocity_ned_mps(self) -> NDArray[np.float64]:
        """Of each row, shape (rows, 3)."""
        return self._together(VELOCITY)

    @cached_property
    def attitude_wxyz(self) -> NDArray[np.float64]:
        """Of each row, shape (rows, 4)."""
        return self._together(ATTITUDE)

    def _together(self, names: Sequence[str]) -> NDArray[np.float64]:
        return np.stack([self.numbers[name] for name in names], axis=-1)

    def at(self, chosen: NDArray[np.bool_]) -> TrueStates:
        """Some of the rows, of all ticks."""
        first = np.concatenate(([0], np.cumsum(chosen)))[self.first]
        numbers = {name: values[chosen] for name, values in self.numbers.items()}
        return TrueStates(
            self.nodes, self.ticks_ns, first, self.node[chosen], self.sim_time_ns[chosen], numbers
        )

    def rows_of(self, tick: int) -> range:
        """The rows of the tick with this number."""
        return range(int(self.first[tick]), int(self.first[tick + 1]))

    def message(self, row: int) -> Truth:
        """A row as the message that it was written from."""
        header = Header.at(int(self.sim_time_ns[row]), self.nodes[self.node[row]])
        return _message(header, [column.item(row) for column in self.numbers.values()])
