"""The table `states`: what a node's autopilot says of itself, as it is published."""

from __future__ import annotations

import math
from pathlib import Path

from bridge.bus.messages import AircraftState
from bridge.record.tables.journal import TableWriter
from bridge.record.tables.schema import AGES, STATES

_NO_AGES = (math.nan,) * len(AGES)
BUFFER_ROWS = 256
"""A host has many nodes, and writes what there is each second."""


class StateRows:
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
