"""The table `truth`: what physics writes at each tick."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np

from bridge.bus.messages import Truth
from bridge.record.tables.journal import TableWriter
from bridge.record.tables.schema import NUMBER, TRUTH

_NUMBERS: Final = tuple(column.name for column in TRUTH.columns if column.dtype == NUMBER)


class TruthColumns:
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
        if not states:
            return
        numbers = np.array([_numbers(state) for state in states]).T
        self._writer.append(
            len(states),
            tick_ns=tick_ns,
            node=np.array([self._places[state.header.frame_id] for state in states]),
            sim_time_ns=np.array([state.header.stamp.ns for state in states]),
            **dict(zip(_NUMBERS, numbers, strict=True)),
        )


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
