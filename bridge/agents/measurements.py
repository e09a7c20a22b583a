"""What a node's RF sensor reports to its agent."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from bridge.agents.frames import Frames, Place
from bridge.bus.messages import AircraftState, Measurements

KEPT_STATES = 4
"""A measurement comes with the tick after the one at which it was taken."""


@dataclass(frozen=True, slots=True)
class Measurement:
    """The power of one emitter, measured once.

    Attributes:
        sim_time_ns: the tick at which it was taken.
        number: the sensor's count of its measurements: one for all emitters that it measured at a tick.
        power_dbm: in the sensor's steps.
        frequency_hz: of the emitter; None if the sensor does not say.
        emitter: its id; None if the sensor does not say.
        state: of the node itself at that tick, as its autopilot reported it; None if it is not known.
        place_ned_m: where the node was by that state, in the fleet's frame, as `Sensor.expected_power_dbm` takes it.
    """

    sim_time_ns: int
    number: int
    power_dbm: float
    frequency_hz: float | None = None
    emitter: str | None = None
    state: AircraftState | None = None
    place_ned_m: Place | None = None


class SensorMemory:
    """Those measurements that came with the present tick, to iterate over; and the newest.

    Args:
        frames: of the node, if they are known.
    """

    def __init__(self, frames: Frames | None = None) -> None:
        self._frames = frames
        self._new: tuple[Measurement, ...] = ()
        self._latest: dict[str, tuple[Measurement, ...]] = {}
        self._states: dict[int, AircraftState] = {}

    def __iter__(self) -> Iterator[Measurement]:
        return iter(self._new)

    def __len__(self) -> int:
        return len(self._new)

    @property
    def latest(self) -> tuple[Measurement, ...]:
        """The newest of each emitter that the sensor distinguishes, sorted by id or frequency.

        Those on one frequency, if the sensor says no more, or all, if it says nothing, are those of one tick.
        """
        return tuple(each for _, group in sorted(self._latest.items()) for each in group)

    def take_state(self, sim_time_ns: int, state: AircraftState) -> None:
        """Keep the node's own state of a tick, for what is measured at it."""
        self._states[sim_time_ns] = state
        if len(self._states) > KEPT_STATES:
            del self._states[min(self._states)]

    def take(self, measurements: Sequence[Measurement]) -> None:
        """Take what came with a tick; it is of one tick, too."""
        self._new = tuple(map(self._with_state, measurements))
        groups: dict[str, list[Measurement]] = {}
        for each in self._new:
            groups.setdefault(_whose(each), []).append(each)
        self._latest |= {whose: tuple(group) for whose, group in groups.items()}

    def _with_state(self, measurement: Measurement) -> Measurement:
        state = self._states.get(measurement.sim_time_ns)
        if state is None:
            return measurement
        place_ned_m = None if self._frames is None else self._frames.place_of(state)
        return replace(measurement, state=state, place_ned_m=place_ned_m)


def _whose(measurement: Measurement) -> str:
    """What the sensor distinguishes emitters by; texts that sort as frequencies do."""
    if measurement.emitter is not None:
        return measurement.emitter
    return "" if measurement.frequency_hz is None else f"{measurement.frequency_hz:020.3f}"


def measurements_by_node(message: Measurements) -> dict[int, list[Measurement]]:
    """The measurements in a message, by the index of the node."""
    found: dict[int, list[Measurement]] = {}
    sim_time_ns = message.header.stamp.ns
    rows = zip(
        message.node, message.number, message.power_dbm, message.frequency_hz, message.emitter, strict=True
    )
    for node, number, power_dbm, frequency_hz, emitter in rows:
        told_hz = None if math.isnan(frequency_hz) else frequency_hz
        each = Measurement(sim_time_ns, number, power_dbm, told_hz, emitter or None)
        found.setdefault(node, []).append(each)
    return found
