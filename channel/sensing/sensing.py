"""All RF sensors of a run: takes an instant and where everybody is, gives what is measured; no I/O, no clock.

A measurement depends on the seed, the sensor with its id, the emitter with its id, its number and the places of both:
not on who else is there, nor in which order.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from channel.checks import ChannelInputError, FloatArray
from channel.draws import Draws, LinkDraws, check_seed
from channel.geometry import separation_m
from channel.link.emitters.emitter import Emitter
from channel.link.radio import Radio
from channel.phy.spectrum import captured_db, masked
from channel.sensing.measured import (
    BELOW_THRESHOLD,
    MEASURED,
    NOTHING,
    OUT_OF_RANGE,
    SILENT,
    Measured,
    Places,
    blank,
)
from channel.sensing.sensor import Sensor, SensorConfig
from channel.sensing.settings import NS_PER_S
from channel.sensing.terms import SensingTerms, Ways

Indices = NDArray[np.intp]


class _Kind(NamedTuple):
    """Ways that one law serves: from emitters with one antenna to sensors of one configuration."""

    sensor: Sensor
    radio: Radio
    terms: SensingTerms


class Sensing:
    """The sensors of one run.

    Args:
        sensors: by the id of the node that has each.
        emitters: with names that differ from each other and from these ids.
        seed: the run's seed.
        bases: ids of nodes that stand on the ground; see `Sensor`.

    Attributes:
        sensors: ids of the nodes, in order.
        emitters: in order.

    Raises:
        ChannelInputError: names that are not distinct, or a seed that is no integer.
    """

    def __init__(
        self,
        sensors: Mapping[str, SensorConfig],
        emitters: Sequence[Emitter],
        *,
        seed: int,
        bases: Collection[str] = (),
    ) -> None:
        self.sensors = tuple(sensors)
        self.emitters = tuple(emitters)
        names = (*self.sensors, *(each.name for each in self.emitters))
        if len(set(names)) != len(names):
            raise ChannelInputError("sensors and emitters", names, "names that differ")
        self._run = Draws(check_seed(seed))
        self._draws = LinkDraws(self._run, names)
        self._kinds: list[_Kind] = []
        self._kind = self._kind_of_each(tuple(Sensor(config) for config in sensors.values()))
        self._is_base = np.array([node in bases for node in self.sensors], dtype=bool)
        self._rate_hz = np.array([each.rate_hz for each in sensors.values()])
        self._next = np.zeros(len(self.sensors), dtype=np.int64)
        self._power_dbm = np.array(
            [[_heard_dbm(config, each) for each in emitters] for config in sensors.values()]
        )
        self._frequency_hz = np.array([each.frequency_hz for each in self.emitters])

    def _kind_of_each(self, sensors: Sequence[Sensor]) -> NDArray[np.intp]:
        """Return the number of the kind of each way, shape (sensors, emitters); -1 where it is out of the band."""
        found = np.full((len(sensors), len(self.emitters)), -1, dtype=np.intp)
        known: list[tuple[SensorConfig, object]] = []
        for row, sensor in enumerate(sensors):
            for column, emitter in enumerate(self.emitters):
                if not sensor.hears(emitter.frequency_hz):
                    continue
                key = (sensor.config, emitter.antenna)
                if key not in known:
                    radio = sensor.radio_towards(emitter.antenna)
                    known.append(key)
                    self._kinds.append(_Kind(sensor, radio, SensingTerms(radio, self._draws)))
                found[row, column] = known.index(key)
        return found

    def is_due(self, sim_time_ns: int) -> bool:
        """Return whether there is anything to measure at an instant."""
        return bool(self.emitters and (self._number(sim_time_ns) >= self._next).any())

    def _number(self, sim_time_ns: int) -> NDArray[np.int64]:
        """Return the number of each sensor's latest measurement that is due, to the nanosecond."""
        return np.floor((sim_time_ns + 0.5) * (self._rate_hz / NS_PER_S)).astype(np.int64)

    def measure(self, sim_time_ns: int, sensors: Places, emitters: Places) -> Measured:
        """Return what is measured at an instant: by each sensor that is due, of each emitter in its band.

        Measurement n of a sensor is taken at the first instant asked for that is not earlier than n / `rate_hz`; of
        several that are due the last one.

        Args:
            sim_time_ns: later than in the call before.
            sensors: where the nodes with sensors are, in the order of `sensors`.
            emitters: where the emitters are, in the order of `emitters`.
        """
        if not self.is_due(sim_time_ns):
            return NOTHING
        number = self._number(sim_time_ns)
        due = number >= self._next
        self._next[due] = number[due] + 1
        sensor, emitter = np.nonzero((self._kind >= 0) & due[:, np.newaxis])
        out = blank(sensor, emitter, number[sensor])
        known = _known(sensors)[sensor] & _known(emitters)[emitter]
        kind = np.where(known, self._kind[sensor, emitter], -1)
        is_on = np.array([each.is_on(self._run, np.array([sim_time_ns]))[0] for each in self.emitters])
        for index in sorted(set(kind[kind >= 0].tolist())):
            rows = np.flatnonzero(kind == index)
            ways = self._ways(self._kinds[index].radio, out, rows, sensors, emitters)
            self._take(self._kinds[index], ways, sim_time_ns, is_on[emitter[rows]], out, rows)
        return out

    def _ways(self, radio: Radio, out: Measured, rows: Indices, sensors: Places, emitters: Places) -> Ways:
        here, there = out.emitter[rows], out.sensor[rows]
        start, end = emitters.position_ned_m[here], sensors.position_ned_m[there]
        out.distance_m[rows] = separation_m(start, end)
        attitude = None if sensors.attitude_wxyz is None else sensors.attitude_wxyz[there]
        path = radio.paths.of(start, end, out.distance_m[rows], None, attitude, self._frequency_hz[here])
        is_base = self._is_base[there]
        path = path._replace(tx_is_base=~is_base, rx_is_base=is_base)
        relative = _velocity(sensors, there) - _velocity(emitters, here)
        speed_mps = np.sqrt(np.sum(relative * relative, axis=-1))
        return Ways(here + len(self.sensors), there, out.number[rows], path, speed_mps)

    def _take(
        self,
        kind: _Kind,
        ways: Ways,
        sim_time_ns: int,
        is_on: NDArray[np.bool_],
        out: Measured,
        rows: Indices,
    ) -> None:
        """Put in what is measured of ways of one kind."""
        gains = kind.terms.gains(ways, sim_time_ns)
        mean_dbm = kind.radio.mean_power_dbm(ways.path) + self._power_dbm[out.sensor[rows], out.emitter[rows]]
        signal_dbm = mean_dbm + gains.shadowing_db + gains.fading_db
        reading_dbm = kind.sensor.reading_dbm(signal_dbm, gains.noise_normal, gains.noise_uniform)
        in_range = kind.radio.in_range(out.distance_m[rows])
        outcome = np.where(reading_dbm >= kind.sensor.threshold_dbm, MEASURED, BELOW_THRESHOLD)
        outcome = np.where(in_range, np.where(is_on, outcome, SILENT), OUT_OF_RANGE)
        out.mean_power_dbm[rows], out.shadowing_db[rows] = mean_dbm, gains.shadowing_db
        out.fading_db[rows] = gains.fading_db
        out.reading_dbm[rows] = np.where(in_range & is_on, reading_dbm, np.nan)
        told_dbm = kind.sensor.told_dbm(reading_dbm)
        out.power_dbm[rows] = np.where(outcome == MEASURED, told_dbm, np.nan)
        out.outcome[rows] = outcome


def _heard_dbm(config: SensorConfig, emitter: Emitter) -> float:
    """Return the power of an emitter within the bandwidth of a sensor that is tuned to it."""
    return emitter.power_dbm + captured_db(0.0, emitter.bandwidth_hz, masked(config.radio.bandwidth_hz))


def _known(places: Places) -> NDArray[np.bool_]:
    return np.ones(len(places.position_ned_m), dtype=bool) if places.known is None else places.known


def _velocity(places: Places, rows: Indices) -> FloatArray:
    return np.zeros((len(rows), 3)) if places.velocity_ned_mps is None else places.velocity_ned_mps[rows]
