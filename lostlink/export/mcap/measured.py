"""From the table of measurements: what RF sensors reported, a message per node and tick."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from bridge.bus.messages import Measurements, encode
from bridge.record.tables.measurements import MEASUREMENTS
from bridge.scenario.model import Scenario
from lostlink.export.mcap.file import McapFile
from lostlink.export.mcap.source import Item, Slices
from lostlink.reading.measured import SensorReports


class MeasurementSource:
    """Measurements of all nodes that have a sensor.

    Args:
        run: the run directory.
        file: where to.
        scenario: of the run.
        prefixes: of topics, by node.
    """

    def __init__(self, run: Path, file: McapFile, scenario: Scenario, prefixes: dict[str, str]) -> None:
        self._file, self._prefixes = file, prefixes
        self._slices = Slices(run, MEASUREMENTS, {})
        self._reports = SensorReports(scenario, scenario.transceiver_ids)

    def until(self, time_ns: int) -> Iterator[Item]:
        """The messages up to ``time_ns``."""
        columns = self._slices.until(time_ns)
        if columns is None:
            return
        for tick_ns, node, message in self._reports.of(columns):
            topic = f"/{self._prefixes[node]}/measurements"
            channel = self._file.channel(topic, Measurements.TYPE, "measurements")
            if channel.is_due(tick_ns):
                yield tick_ns, channel, encode(message)
