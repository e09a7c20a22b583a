"""What the RF sensors of a record reported, tick by tick, from its table of measurements."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby
from pathlib import Path

from bridge.bus.messages import Measurements
from bridge.radio.measurements import Told, as_message
from bridge.record.tables.measurements import MEASUREMENTS
from bridge.record.tables.reader import read_columns
from bridge.scenario.model import Scenario
from bridge.scenario.resolve.sensing import emitters_of, sensors_of
from channel.sensing.measured import MEASURED, OUTCOMES

_COLUMNS = ("sim_time_ns", "node", "emitter", "number", "power_dbm")


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
        carriers_hz = {each.name: each.frequency_hz for each in emitters_of(scenario)}
        tells = {node: sensor.identifies for node, sensor in sensors_of(scenario).items()}
        columns = read_columns(run, MEASUREMENTS, (*_COLUMNS, "outcome"))
        reported = columns["outcome"] == OUTCOMES[MEASURED].value
        places = {node: place for place, node in enumerate(nodes)}
        rows = zip(*(columns[name][reported].tolist() for name in _COLUMNS), strict=True)
        for sim_time_ns, of_tick in groupby(rows, key=lambda row: int(row[0])):
            told = sorted(
                Told.of(places[node], number, power_dbm, tells[node], emitter, carriers_hz[emitter])
                for _, node, emitter, number, power_dbm in of_tick
            )
            self._found[sim_time_ns] = [
                (nodes[place], as_message(sim_time_ns, tuple(mine), nodes[place]))
                for place, mine in groupby(told, key=lambda each: each.node)
            ]

    def at(self, sim_time_ns: int) -> Sequence[tuple[str, Measurements]]:
        """What was measured at a tick, by node."""
        return self._found.get(sim_time_ns, ())
