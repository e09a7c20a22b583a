"""What the RF sensors of a record reported, tick by tick, from its table of measurements."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from bridge.bus.messages import Measurements
from bridge.record.tables.measurements import MEASUREMENTS
from bridge.record.tables.reader import read_columns
from bridge.scenario.model import Scenario
from lostlink.reading.measured import COLUMNS, SensorReports


class ReportedMeasurements:
    """The messages of all sensors, by tick.

    Args:
        run: directory of the run.
        scenario: as flown.
        nodes: ids, as the messages count them.

    Raises:
        TableError, OSError: the table is damaged or cannot be read.
    """

    def __init__(self, run: Path, scenario: Scenario, nodes: Sequence[str]) -> None:
        self._found: dict[int, list[tuple[str, Measurements]]] = {}
        if not MEASUREMENTS.is_in(run):
            return
        columns = read_columns(run, MEASUREMENTS, COLUMNS)
        for sim_time_ns, node, message in SensorReports(scenario, nodes).of(columns):
            self._found.setdefault(sim_time_ns, []).append((node, message))

    def at(self, sim_time_ns: int) -> Sequence[tuple[str, Measurements]]:
        """What was measured at a tick, by node."""
        return self._found.get(sim_time_ns, ())
