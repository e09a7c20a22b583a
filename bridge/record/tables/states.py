"""The table `states`: what a node's autopilot says of itself, as it is published. Written by whoever has the node."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from bridge.bus.messages import AircraftState, Header, Vector3
from bridge.record.tables.journal import TableWriter
from bridge.record.tables.reader import no_rows, read_columns
from bridge.record.tables.schema import (
    COUNT,
    FLAG,
    FRD,
    LABEL,
    NED,
    NUMBER,
    TEXT_PREFIX,
    TICK,
    TIME_MAX_NS,
    Column,
    Columns,
    Table,
    vector,
)

AGES: Final = (
    *("heartbeat", "status", "attitude", "position", "local_position", "velocity"),
    *("speed", "airspeed", "wind", "current", "clock"),
)
"""Groups of fields of a state that an autopilot sends together, in the order of AircraftState.msg."""
STATES: Final = Table(
    "states",
    (
        Column("tick_ns", TICK, most=TIME_MAX_NS),
        Column("node", LABEL),
        Column("mav_id", COUNT),
        *(Column(f"{name}_rad", NUMBER) for name in ("roll", "pitch", "yaw")),
        Column("longitude_deg", NUMBER),
        Column("latitude_deg", NUMBER),
        Column("altitude_amsl_m", NUMBER),
        Column("altitude_rel_m", NUMBER),
        *vector("position", "_m", NED),
        *vector("velocity", "_mps", NED),
        Column("indicated_airspeed_mps", NUMBER),
        Column("groundspeed_mps", NUMBER),
        Column("airspeed_mps", NUMBER),
        Column("mode", f"{TEXT_PREFIX}32"),
        Column("base_mode", f"{TEXT_PREFIX}192"),
        Column("heartbeat_age_s", NUMBER),
        Column("flight_time_s", NUMBER),
        Column("voltage_v", NUMBER),
        Column("current_a", NUMBER),
        *vector("wind", "_mps", FRD),
        Column("throttle_percent", NUMBER),
        Column("armed", FLAG),
        Column("ready_to_arm", FLAG),
        *(Column(f"age_{name}_s", NUMBER, 1e3) for name in AGES),
    ),
    keys=("tick_ns", "node"),
    tick="tick_ns",
    node="node",
    by_node=True,
)
"""A row per node and tick at which its state is published, with the fields of `bridge.bus.messages.AircraftState`."""
_NO_AGES = (math.nan,) * len(AGES)
BUFFER_ROWS = 256
"""A host has many nodes, and writes what there is each second."""


class StateWriter:
    """Writes the states of one node.

    Args:
        run: the run directory.
        node: its id.

    Raises:
        OSError: the file cannot be made.
    """

    def __init__(self, run: Path, node: str) -> None:
        self._writer = TableWriter(run, STATES, {"node": [node]}, node, BUFFER_ROWS)
        self.flush, self.close = self._writer.flush, self._writer.close

    def append(self, state: AircraftState) -> None:
        """Append a state, under its stamp."""
        self._writer.append_row(
            (
                state.header.stamp.ns,
                0,
                state.mav_id,
                *state.euler_rad.xyz,
                state.longitude_deg,
                state.latitude_deg,
                state.altitude_amsl_m,
                state.altitude_rel_m,
                *state.position_ned_m.xyz,
                *state.velocity_ned_mps.xyz,
                state.indicated_airspeed_mps,
                state.groundspeed_mps,
                state.airspeed_mps,
                state.mode.encode(),
                state.base_mode.encode(),
                state.heartbeat_age_s,
                state.flight_time_s,
                state.voltage_v,
                state.current_a,
                *state.wind_body_mps.xyz,
                state.throttle_percent,
                state.armed,
                state.ready_to_arm,
                *(state.age_s if len(state.age_s) else _NO_AGES),
            )
        )


def _message(node: str, row: Sequence[Any]) -> AircraftState:
    """From a row's values in the order of the table's columns."""
    tick_ns, _, mav_id, *values = row
    ages_s = values[-len(AGES) :]
    fields: tuple[Any, ...] = (
        Header.at(tick_ns, node),
        mav_id,
        Vector3(*values[:3]),
        *values[3:7],
        Vector3(*values[7:10]),
        Vector3(*values[10:13]),
        *values[13:22],
        Vector3(*values[22:25]),
        *values[25:28],
        () if math.isnan(ages_s[0]) else tuple(ages_s),
    )
    return AircraftState(*fields)


@dataclass(frozen=True)
class States:
    """The states of a run's nodes.

    Attributes:
        columns: of all rows, in the table's order; ``node`` is a place in the list of nodes.
        rows: of each node, rising with its ticks.
    """

    columns: Columns
    rows: dict[str, NDArray[np.intp]]

    @classmethod
    def read(cls, run: Path, nodes: Sequence[str]) -> States:
        """Of the run in ``run``; no rows if its record has no such table.

        Args:
            run: the run directory.
            nodes: ids of all its nodes.

        Raises:
            TableError, OSError: the table is damaged, or cannot be read.
        """
        names = {"node": tuple(nodes)}
        columns = (
            read_columns(run, STATES, None, names) if STATES.is_in(run) else no_rows(STATES, None, names)
        )
        return cls(
            columns, {node: np.flatnonzero(columns["node"] == place) for place, node in enumerate(nodes)}
        )

    def changes_ns(self, name: str) -> NDArray[np.int64]:
        """Ticks, rising, at which a column of a node has another value than in its row before, or the first."""
        found = [np.empty(0, dtype=np.int64)]
        for rows in self.rows.values():
            values = self.columns[name][rows]
            is_new = np.concatenate((np.ones(min(1, rows.size), dtype=np.bool_), values[1:] != values[:-1]))
            found.append(self.columns["tick_ns"][rows[is_new]])
        return np.unique(np.concatenate(found))

    def at(self, node: str, sim_time_ns: int) -> AircraftState | None:
        """The newest state of a node at an instant, under its own stamp; None if there is none yet."""
        rows = self.rows[node]
        place = int(np.searchsorted(self.columns["tick_ns"], sim_time_ns, side="right"))
        place = int(np.searchsorted(rows, place))
        if not place:
            return None
        return _message(node, [column.item(rows[place - 1]) for column in self.columns.values()])
