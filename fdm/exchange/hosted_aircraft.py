"""One UA of an exchange: its lockstep, frame timing and flight model. No socket, no clock of its own."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from typing import Any, Protocol

from fdm.air.wind import ConstantWind
from fdm.clock.member import Member
from fdm.clock.pace import NEVER_NS
from fdm.errors import ModelDivergedError, WindError
from fdm.model.air_point import AirPoint, StaticAir, Wind
from fdm.model.airframe import Airframe
from fdm.model.geodesy import Home
from fdm.model.plausible import plausible
from fdm.model.truth import TrueState, Vector
from fdm.wire.lockstep import STEPPING, FrameTimer, Lockstep, ServoVerdict
from fdm.wire.sensor_frame import Encoder, Rounder
from fdm.wire.servo_packet import Fields, unpack_servo_packet

WIND_PERIOD_NS = 10_000_000
"""Sim time between two looks at the wind; it is held in between."""
BOOT_S = 1e-6
"""Timestamp of the state at boot. At 0 SITL takes its clock for one that runs by itself, and computes that one frame
by the host's: no two boots would be alike."""
OVERRUNS = "overruns"
"""Counter of the servo packets that gave way to later ones, as two of their UA were waiting already."""


class FlightModel(Protocol):
    """What a UA needs of its flight model; see fdm.model.jsbsim_model.JsbsimModel."""

    sense: Callable[[], tuple[float, ...]]
    """Reads the numbers of a sensor frame, without its timestamp."""

    def step(self, fields: Fields, rate_hz: int) -> None:
        """Step by 1 / rate_hz with the servo outputs in `fields`."""

    def truth(self, ua_id: int, sim_time_ns: int) -> TrueState:
        """The true state."""

    def air_point(self, sim_time_ns: int) -> AirPoint:
        """Where it is in the air."""

    def set_wind(self, wind_ned_mps: Vector) -> None:
        """Set the velocity of the air around it, from the next step on."""


class FlightModelInAir(FlightModel, Protocol):
    """A flight model with what a barometer needs."""

    def air(self) -> StaticAir:
        """The air where it is."""


BuildModel = Callable[[Airframe, Home], FlightModelInAir]
"""Makes a flight model."""
Sense = Callable[[], tuple[float, ...]]
Disturb = Callable[[Sense], Sense]


class ExchangedAircraft:
    """One UA between its datagrams and its flight model.

    Args:
        member: its place in the fleet clock.
        build_model: makes a flight model that stands at its home; called once now, and at each later boot of
            the autopilot.
        encode: makes the sensor frame's datagram, or the numbers that an autopilot gets which is called.
        wind: the air around it; None = still.
        disturb: turns a model's `sense` into what the sensors measure; None = they are exact.
        unpack: takes a datagram apart: a servo packet's fields, or why it is none.
        parallel: it is coupled in parallel (fdm.exchange.exchange.Exchange): its autopilot may send the frame after the
            one that is asked for.

    Attributes:
        ua_id: which UA.
        member: its place in the fleet clock.
        lockstep: state of the exchange with its autopilot.
        fields: the servo packet of the frame that is asked for.
        early: in parallel coupling the one after it, if that came before the frame was flown; empty = none.
        frames: frames that were asked for in the usual way.
        lead_due: in parallel coupling, the state at boot is to be sent before the first frame is flown.
        model: its flight model.
    """

    __slots__ = (
        "_build_model",
        "_counters",
        "_disturb",
        "_encode",
        "_measure",
        "_offset_ns",
        "_timer",
        "_unpack",
        "_used",
        "_wind",
        "_wind_at_ns",
        "early",
        "fields",
        "frames",
        "lead_due",
        "lockstep",
        "member",
        "model",
        "parallel",
        "ua_id",
    )

    def __init__(
        self,
        member: Member,
        build_model: Callable[[], FlightModel],
        encode: Encoder | Rounder,
        wind: Wind | None = None,
        disturb: Disturb | None = None,
        unpack: Callable[[bytes], Fields | str] = unpack_servo_packet,
        parallel: bool = False,
    ) -> None:
        self.ua_id = member.ua_id
        self.member = member
        self.lockstep = Lockstep()
        self.frames = 0
        self.fields: Fields = ()
        self.early: Fields = ()
        self.parallel = self.lead_due = parallel
        self._unpack = unpack
        self._disturb = disturb
        self._build_model = build_model
        self._set_model(build_model())
        self._encode = encode
        self._timer = FrameTimer()
        self._offset_ns = 0
        self._used = False
        self._counters: Counter[str] = Counter()
        self._wind = wind
        self._wind_at_ns = -1 if wind is not None else NEVER_NS

    def receive(self, datagram: bytes, sender: object, wall_ns: int) -> ServoVerdict | None:
        """Judge a datagram.

        Returns:
            The verdict, or None if it was no servo packet (counted by reason). Never raises.
        """
        fields = self._unpack(datagram)
        if fields.__class__ is str:
            self._counters[fields] += 1
            return None
        return self.asked(fields, sender, wall_ns)  # type: ignore[arg-type]

    def asked(self, fields: Fields, sender: object, wall_ns: int) -> ServoVerdict:
        """Judge a servo packet that was taken apart. Never raises."""
        queued = self.parallel and self.lockstep.waiting and sender == self.lockstep.sender
        verdict = self.lockstep.receive(fields[2], sender, wall_ns)
        if verdict is ServoVerdict.ADVANCE:
            self.frames += 1
        else:
            self._counters[verdict.value] += 1
            if verdict not in STEPPING:
                return verdict
        if queued and verdict is ServoVerdict.ADVANCE:
            if self.early:
                self._counters[OVERRUNS] += 1
            self.early = fields
        else:
            self.fields, self.early = fields, ()
        return verdict

    def take_early(self) -> None:
        """The frame that was asked for is flown: go on with the one that came early."""
        self.fields, self.early = self.early, ()

    def reset(self) -> None:
        """The autopilot booted: own time starts at 0, the model stands at its home."""
        self._timer = FrameTimer()
        if self._used:
            self._set_model(self._build_model())
        self._used = False
        self.lead_due = self.parallel

    def _set_model(self, model: FlightModel) -> None:
        self.model = model
        sense = plausible(model.sense)
        self._measure = sense if self._disturb is None else self._disturb(sense)

    def set_fleet_time(self, sim_time_ns: int) -> None:
        """The UA's present own time is `sim_time_ns` of fleet sim time."""
        self._offset_ns = sim_time_ns - self._timer.time_ns
        if self._wind is not None:
            self._wind_at_ns = sim_time_ns

    def target_ns(self) -> int:
        """Fleet sim time after the frame that was asked for."""
        return self._offset_ns + self._timer.next_ns(self.fields[1])

    def step(self) -> None:
        """Fly the frame that was asked for; `measure` is to follow.

        Raises:
            ModelDivergedError: the flight model is lost, or there is no wind where it is.
        """
        self._used = True
        fields = self.fields
        if self.member.sim_time_ns >= self._wind_at_ns:
            self._feel_the_wind()
        self.model.step(fields, fields[1])

    def at_boot(self) -> Any:
        """The sensor frame, as encoded, of the UA at the boot of its autopilot: in still air, with exact sensors.

        The errors of the sensors, which are drawn frame by frame, begin with the first frame that is flown.

        Raises:
            ModelDivergedError: the flight model is lost.
        """
        self.lead_due = False
        return self._encode((BOOT_S, *self.model.sense()))

    def measure(self) -> Any:
        """The reply after a step: the sensor frame as encoded.

        Raises:
            ModelDivergedError: the flight model is lost.
        """
        return self._encode((self._timer.advance(self.fields[1]) / 1e9, *self._measure()))

    def _feel_the_wind(self) -> None:
        now_ns = self.member.sim_time_ns
        self._wind_at_ns = now_ns - now_ns % WIND_PERIOD_NS + WIND_PERIOD_NS
        if isinstance(self._wind, ConstantWind):
            self._wind_at_ns = NEVER_NS  # once in a flight
        if self._wind is None:
            return
        try:
            self.model.set_wind(self._wind.air_ned_mps(self.model.air_point(now_ns)))
        except WindError as error:
            raise ModelDivergedError(f"no wind: {error}") from error

    def truth(self) -> TrueState:
        """The true state, stamped with fleet sim time."""
        return self.model.truth(self.ua_id, self.member.sim_time_ns)

    def count(self, reason: str) -> None:
        """Count something that is worth it."""
        self._counters[reason] += 1

    def counters(self) -> dict[str, int]:
        """What was received and done so far, by name: ``frames``, and all that happened at least once."""
        return {ServoVerdict.ADVANCE.value: self.frames, **self._counters}
