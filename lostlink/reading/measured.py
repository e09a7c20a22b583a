"""What the RF sensors of a record reported: messages, made from the rows of its table of measurements."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import groupby
from typing import Final

from bridge.bus.messages import Measurements
from bridge.radio.measurements import Told, as_message
from bridge.record.tables.measurements import MEASUREMENTS
from bridge.record.tables.schema import Columns
from bridge.scenario.model import Scenario
from bridge.scenario.resolve.sensing import emitters_of, sensors_of
from channel.sensing.measured import MEASURED, OUTCOMES

_TOLD: Final = (MEASUREMENTS.tick, "node", "emitter", "number", "power_dbm")
COLUMNS: Final = (*_TOLD, "outcome")
"""What the messages are made from."""


class SensorReports:
    """Makes the messages that the sensors of a run published.

    Args:
        scenario: as flown.
        nodes: ids, as the messages count them.
    """

    def __init__(self, scenario: Scenario, nodes: Sequence[str]) -> None:
        self._nodes = tuple(nodes)
        self._places = {node: place for place, node in enumerate(nodes)}
        self._carriers_hz = {each.name: each.frequency_hz for each in emitters_of(scenario)}
        self._tells = {node: sensor.identifies for node, sensor in sensors_of(scenario).items()}

    def of(self, columns: Columns) -> Iterator[tuple[int, str, Measurements]]:
        """Of rows of whole ticks, by tick, then by node: sim time in ns, whose sensor, and what it reported."""
        reported = columns["outcome"] == OUTCOMES[MEASURED].value
        rows = zip(*(columns[name][reported].tolist() for name in _TOLD), strict=True)
        for sim_time_ns, of_tick in groupby(rows, key=lambda row: int(row[0])):
            told = sorted(self._told(*row[1:]) for row in of_tick)
            for place, mine in groupby(told, key=lambda each: each.node):
                node = self._nodes[place]
                yield sim_time_ns, node, as_message(sim_time_ns, tuple(mine), node)

    def _told(self, node: str, emitter: str, number: int, power_dbm: float) -> Told:
        tells, carrier_hz = self._tells[node], self._carriers_hz[emitter]
        return Told.of(self._places[node], number, power_dbm, tells, emitter, carrier_hz)
