"""What RF sensors measure at a tick: from the true places, for the nodes that have one, and for the record."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from bridge.bus.messages import Header, Measurements
from bridge.record.tables.measurements import MeasurementWriter
from bridge.run.directory import RunDirectory
from channel.link.emitters.emitter import Emitter
from channel.medium.medium import Medium
from channel.sensing.measured import MEASURED, NOTHING, Measured, Places
from channel.sensing.sensing import Sensing
from channel.sensing.sensor import SensorConfig
from channel.sensing.settings import Identifies


class Told(NamedTuple):
    """One measurement as its sensor reports it: of one of several that it cannot distinguish, the place says nothing.

    Attributes:
        node: index of the node with the sensor.
        number: the sensor's count.
        emitter: id; empty if the sensor does not say.
        frequency_hz: NaN if it does not say.
        power_dbm: in the sensor's steps.
    """

    node: int
    number: int
    emitter: str
    frequency_hz: float
    power_dbm: float

    @classmethod
    def of(
        cls, node: int, number: int, power_dbm: float, tells: Identifies, emitter: str, carrier_hz: float
    ) -> Told:
        """What is told of an emitter on a carrier by a sensor that identifies so much."""
        # a number that sorts, also where it is not known: NaN takes its place in `as_message`
        frequency_hz = 0.0 if tells == "none" else carrier_hz
        return cls(node, number, emitter if tells == "id" else "", frequency_hz, power_dbm)


class RfSensors:
    """The sensors of a run at its medium.

    Args:
        sensing: their laws.
        identifies: what each says, in the order of `sensing.sensors`.
        medium: which knows where everybody is.
    """

    def __init__(self, sensing: Sensing, identifies: Sequence[Identifies], medium: Medium) -> None:
        self._sensing = sensing
        self._identifies = tuple(identifies)
        self._medium = medium
        self._node = np.array([medium.index[node] for node in sensing.sensors], dtype=np.intp)
        tracked = {name: index for index, name in enumerate(medium.emitters.names)}
        self._emitter = np.array([tracked[each.name] for each in sensing.emitters], dtype=np.intp)

    def measure(self, sim_time_ns: int) -> Measured:
        """What the sensors that are due measure at a tick."""
        if not self._sensing.is_due(sim_time_ns):
            return NOTHING
        nodes, instants = self._medium.at(sim_time_ns), np.array([sim_time_ns], dtype=np.int64)
        emitters = self._medium.emitters.snapshot(instants)
        assert nodes.attitude_wxyz is not None
        assert nodes.velocity_ned_mps is not None
        assert emitters.velocity_ned_mps is not None
        return self._sensing.measure(
            sim_time_ns,
            Places(
                nodes.position_ned_m.T[self._node],
                nodes.attitude_wxyz.T[self._node],
                nodes.velocity_ned_mps.T[self._node],
                self._medium.known[self._node],
            ),
            Places(
                emitters.position_ned_m.T[self._emitter],
                velocity_ned_mps=emitters.velocity_ned_mps.T[self._emitter],
            ),
        )

    def told(self, measured: Measured) -> list[Told]:
        """What the sensors report, in an order that says no more than they do: by node, id, frequency and power."""
        rows = np.flatnonzero(measured.outcome == MEASURED)
        columns = (measured.sensor, measured.emitter, measured.number, measured.power_dbm)
        values = zip(*(column[rows].tolist() for column in columns), strict=True)
        return sorted(self._told(*row) for row in values)

    def _told(self, sensor: int, emitter: int, number: int, power_dbm: float) -> Told:
        source, node = self._sensing.emitters[emitter], int(self._node[sensor])
        return Told.of(node, number, power_dbm, self._identifies[sensor], source.name, source.frequency_hz)


def as_message(sim_time_ns: int, told: Sequence[Told], frame_id: str = "") -> Measurements:
    """Measurements of one tick as a message."""
    return Measurements(
        Header.at(sim_time_ns, frame_id),
        tuple(each.node for each in told),
        tuple(each.number for each in told),
        tuple(each.power_dbm for each in told),
        tuple(each.frequency_hz or math.nan for each in told),
        tuple(each.emitter for each in told),
    )


class SensorsOfRun:
    """The sensors of a run with the table that they fill.

    Args:
        sensors: which measure.
        table: which keeps what they do.
    """

    def __init__(self, sensors: RfSensors, table: MeasurementWriter) -> None:
        self._sensors = sensors
        self._table = table
        self.flush, self.close = table.flush, table.close

    @classmethod
    def of(
        cls,
        run: RunDirectory,
        sensors: Mapping[str, SensorConfig],
        emitters: Sequence[Emitter],
        medium: Medium,
    ) -> SensorsOfRun | None:
        """Those of a run; None if no node has one."""
        if not sensors:
            return None
        bases = [node.node for node in run.scenario.ground]
        sensing = Sensing(sensors, emitters, seed=run.scenario.seed, bases=bases)
        table = MeasurementWriter(run.path, sensing.sensors, [each.name for each in emitters])
        return cls(RfSensors(sensing, [each.identifies for each in sensors.values()], medium), table)

    def measure(self, sim_time_ns: int) -> list[Told]:
        """Measure at a tick, keep it all, and return what the sensors report."""
        measured = self._sensors.measure(sim_time_ns)
        self._table.write(sim_time_ns, measured)
        return self._sensors.told(measured)
