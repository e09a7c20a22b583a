"""A UA whose autopilot is called, not reached over UDP: the same numbers pass, in the same order."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import Protocol

from fdm.clock.member import Member
from fdm.exchange.aircraft_spec import AircraftSpec
from fdm.exchange.hosted_aircraft import ExchangedAircraft, FlightModel
from fdm.exchange.settings import Coupling
from fdm.wire.sensor_frame import Numbers, SensorFrame, decode_sensor_frame, make_encoder, make_rounder
from fdm.wire.servo_packet import Fields


class CalledAutopilot(Protocol):
    """An autopilot in this process, deterministic: what it answers depends on what it was given alone."""

    @property
    def fields(self) -> Fields:
        """Those of its latest servo packet; before the first frame, of the one that opens the exchange."""

    def frame(self, numbers: Numbers) -> Fields | None:
        """Take a sensor frame; return the fields of the servo packet that answers it, or None if it answers none."""


class CalledSeat:
    """One UA of an exchange with its autopilot (`fdm.exchange.seat.Seat` is one with a socket).

    Args:
        spec: the UA.
        autopilot: flies it.
        member: its place in the fleet clock.
        build_model: makes its flight model.
        coupling: of the exchange.

    Attributes:
        packets: fields of the autopilot's servo packets that were not heard yet.

    Raises:
        AirframeError: the model cannot be loaded.
    """

    __slots__ = ("_autopilot", "_encode", "aircraft", "member", "packets", "port")

    def __init__(
        self,
        spec: AircraftSpec,
        autopilot: CalledAutopilot,
        member: Member,
        build_model: Callable[[], FlightModel],
        coupling: Coupling,
    ) -> None:
        self.member = member
        self.port = 0
        self.aircraft = ExchangedAircraft(
            member,
            build_model,
            make_rounder(spec.airframe.sensors),
            spec.wind,
            spec.disturb,
            parallel=coupling == "parallel",
        )
        self._encode = make_encoder(spec.airframe.sensors)
        self._autopilot = autopilot
        self.packets: deque[Fields] = deque((autopilot.fields,))

    def send(self, reply: Numbers) -> None:
        """Have the autopilot fly a frame; its answer is in `packets`."""
        fields = self._autopilot.frame(reply)
        if fields is not None:
            self.packets.append(fields)

    def last_frame(self) -> SensorFrame | None:
        """The last sensor frame that was sent."""
        numbers = self.aircraft.lockstep.reply
        return decode_sensor_frame(self._encode(numbers)) if numbers else None

    def counters(self) -> dict[str, int]:
        """What the aircraft counted."""
        return self.aircraft.counters()

    def close(self) -> None:
        """Nothing is held."""
