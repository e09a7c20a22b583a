"""The table `measurements`: what RF sensors measured. Written by the radio, if a node has a sensor."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path
from typing import Final

from bridge.record.tables.journal import TableWriter
from bridge.record.tables.schema import (
    LABEL,
    NUMBER,
    TICK,
    TIME_MAX_NS,
    Column,
    Table,
)
from channel.sensing.measured import OUTCOMES, Measured

MEASUREMENTS: Final = Table(
    "measurements",
    (
        Column("sim_time_ns", TICK, most=TIME_MAX_NS),
        Column("node", LABEL),
        Column("emitter", LABEL),
        Column("number", TICK),
        Column("distance_m", NUMBER, 1e3),
        Column("mean_power_dbm", NUMBER, 1e3),
        Column("shadowing_db", NUMBER, 1e3),
        Column("fading_db", NUMBER, 1e3),
        Column("reading_dbm", NUMBER, 1e3),
        Column("power_dbm", NUMBER, 1e3),
        Column("outcome", LABEL),
    ),
    keys=("sim_time_ns", "node", "emitter"),
    tick="sim_time_ns",
    node="node",
)
"""A row per measurement of an RF sensor and emitter in its band."""


class MeasurementWriter:
    """Writes what was measured, a row per sensor and emitter in its band.

    Args:
        run: the run directory.
        sensors: ids of the nodes with sensors, as `Measured.sensor` counts them.
        emitters: ids of the emitters, likewise.
    """

    def __init__(self, run: Path, sensors: Collection[str], emitters: Collection[str]) -> None:
        labels = {
            "node": tuple(sensors),
            "emitter": tuple(emitters),
            "outcome": tuple(each.value for each in OUTCOMES),
        }
        self._writer = TableWriter(run, MEASUREMENTS, labels)
        self.flush, self.close = self._writer.flush, self._writer.close

    def write(self, sim_time_ns: int, measured: Measured) -> None:
        """Append the measurements of a tick."""
        if not measured.size:
            return
        columns = measured._asdict()
        self._writer.append(measured.size, sim_time_ns=sim_time_ns, node=columns.pop("sensor"), **columns)
