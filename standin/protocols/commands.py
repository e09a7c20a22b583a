"""COMMAND_LONG and COMMAND_INT: one handler per command, and its MAV_RESULT, as ArduCopter answers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum
from math import inf, isfinite

from pymavlink.dialects.v20 import ardupilotmega as dialect

from standin.protocols.streams import INTERVAL_MIN_US, Streams
from standin.protocols.targets import location_from
from standin.protocols.telemetry import TelemetryProtocol
from standin.vehicle.auto import Auto
from standin.vehicle.events import Severity
from standin.vehicle.mission import ALT_STEP_M, SPEED_KINDS, SpeedKind
from standin.vehicle.mode import ModeNumber
from standin.vehicle.modes import Guided
from standin.vehicle.vehicle import StandinVehicle
from standin.wire.mavlink_codec import Message

FORCE_MAGIC = {True: (2989.0, 21196.0), False: (21196.0,)}
"""param2 of COMPONENT_ARM_DISARM that skips the checks, of arming (either of ArduPilot's two numbers) and disarming."""
INTERVAL_END_US = 2**31
"""ArduPilot's intervals are an int32; its simulation is ended by what is beyond, the stand-in denies it."""
RELATIVE_FRAMES = (dialect.MAV_FRAME_GLOBAL_RELATIVE_ALT, dialect.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT)


class Result(IntEnum):
    """MAV_RESULT."""

    ACCEPTED = 0
    TEMPORARILY_REJECTED = 1
    DENIED = 2
    UNSUPPORTED = 3
    FAILED = 4


@dataclass(frozen=True, slots=True)
class Request:
    """A command of either form: four parameters, degrees, and a height in a frame."""

    command: int
    parameters: tuple[float, float, float, float]
    lat_deg: float
    lon_deg: float
    alt_m: float
    frame: int
    whole_degrees: bool
    """Whether the position came as integers (COMMAND_INT)."""


def request_from(message: Message) -> Request:
    """Return the request of a COMMAND_LONG or COMMAND_INT."""
    parameters = (message.param1, message.param2, message.param3, message.param4)
    if message.get_type() == "COMMAND_INT":
        place = (message.x * 1e-7, message.y * 1e-7, message.z)
        return Request(message.command, parameters, *place, message.frame, True)
    place = (message.param5, message.param6, message.param7)
    return Request(message.command, parameters, *place, dialect.MAV_FRAME_GLOBAL_RELATIVE_ALT, False)


class CommandProtocol:
    """Runs requests on a vehicle."""

    def __init__(self, vehicle: StandinVehicle, telemetry: TelemetryProtocol, streams: Streams) -> None:
        self._vehicle = vehicle
        self._telemetry = telemetry
        self._streams = streams
        self._requested: list[Message] = []
        self._handlers: dict[int, Callable[[Request], Result]] = {
            dialect.MAV_CMD_COMPONENT_ARM_DISARM: self._arm_disarm,
            dialect.MAV_CMD_DO_SET_MODE: self._set_mode,
            dialect.MAV_CMD_NAV_TAKEOFF: self._take_off,
            dialect.MAV_CMD_NAV_LAND: lambda _: self._enter(ModeNumber.LAND),
            dialect.MAV_CMD_NAV_RETURN_TO_LAUNCH: lambda _: self._enter(ModeNumber.RTL),
            dialect.MAV_CMD_MISSION_START: self._start_mission,
            dialect.MAV_CMD_DO_SET_MISSION_CURRENT: self._set_mission_current,
            dialect.MAV_CMD_DO_REPOSITION: self._reposition,
            dialect.MAV_CMD_DO_CHANGE_SPEED: self._change_speed,
            dialect.MAV_CMD_SET_MESSAGE_INTERVAL: self._set_interval,
            dialect.MAV_CMD_REQUEST_MESSAGE: lambda request: self._tell(request.parameters[0]),
            dialect.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES: self._tell_version,
        }

    def run(self, request: Request) -> Result:
        """Run one request; return its MAV_RESULT."""
        handler = self._handlers.get(request.command)
        return Result.UNSUPPORTED if handler is None else handler(request)

    def take_requested(self) -> list[Message]:
        """Return and forget the messages that follow the acknowledgement."""
        requested, self._requested = self._requested, []
        return requested

    def _arm_disarm(self, request: Request) -> Result:
        wanted, magic, _, _ = request.parameters
        if wanted not in (0.0, 1.0):
            return Result.UNSUPPORTED
        act = self._vehicle.arm if wanted == 1.0 else self._vehicle.disarm
        return Result.ACCEPTED if act(magic in FORCE_MAGIC[wanted == 1.0]) else Result.FAILED

    def _set_mode(self, request: Request) -> Result:
        if not int_or_zero(request.parameters[0]) & dialect.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED:
            return Result.DENIED
        return self._enter(int_or_zero(request.parameters[1]))

    def _enter(self, number: int) -> Result:
        return Result.ACCEPTED if self._vehicle.set_mode(number) else Result.FAILED

    def _take_off(self, request: Request) -> Result:
        mode = self._vehicle.mode
        if request.frame not in RELATIVE_FRAMES or not isfinite(request.alt_m):
            return Result.DENIED
        if not isinstance(mode, Guided) or not mode.take_off(request.alt_m):
            return Result.FAILED
        return Result.ACCEPTED

    def _start_mission(self, request: Request) -> Result:
        if any(request.parameters[:2]):  # from one item to another: ArduCopter cannot
            return Result.DENIED
        result = self._enter(ModeNumber.AUTO)
        mode = self._vehicle.mode
        if isinstance(mode, Auto):
            mode.start()
        return result

    def _set_mission_current(self, request: Request) -> Result:
        if not self._vehicle.mission.set_current(int_or_zero(request.parameters[0])):
            return Result.DENIED
        self._requested.append(self._telemetry.mission_current())
        return Result.ACCEPTED

    def _reposition(self, request: Request) -> Result:
        if not request.whole_degrees:
            return Result.UNSUPPORTED  # COMMAND_LONG would lose metres: ArduPilot takes COMMAND_INT only
        vehicle = self._vehicle
        speed_mps, flags, _, _ = request.parameters
        may_enter = int_or_zero(flags) & dialect.MAV_DO_REPOSITION_FLAGS_CHANGE_MODE
        location = location_from(vehicle, request.lat_deg, request.lon_deg, request.alt_m, request.frame)
        is_here = request.lat_deg == request.lon_deg == 0.0
        is_as_high = request.frame in RELATIVE_FRAMES and abs(request.alt_m) < ALT_STEP_M
        if is_here or is_as_high:  # ArduPilot replaces these by its own (Location::sanitize), and denies
            return Result.DENIED
        if location is None or not (isinstance(vehicle.mode, Guided) or may_enter):
            return Result.DENIED
        if not vehicle.set_mode(ModeNumber.GUIDED) or not isinstance(vehicle.mode, Guided):
            return Result.FAILED
        if isfinite(speed_mps) and speed_mps > 0.0:
            vehicle.change_speed(SpeedKind.GROUND, speed_mps)
        vehicle.mode.fly_to(vehicle.origin.ned_to(location))
        return Result.ACCEPTED

    def _change_speed(self, request: Request) -> Result:
        kind, speed_mps, _, _ = request.parameters
        if kind not in SPEED_KINDS or not 0.0 < speed_mps < inf:
            return Result.DENIED
        if self._vehicle.mode.number not in (ModeNumber.GUIDED, ModeNumber.AUTO, ModeNumber.RTL):
            return Result.FAILED
        self._vehicle.change_speed(SpeedKind(int(kind)), speed_mps)
        return Result.ACCEPTED

    def _set_interval(self, request: Request) -> Result:
        message_id, interval_us, _, _ = request.parameters
        if not isfinite(message_id) or not -1.0 <= interval_us < INTERVAL_END_US:  # also false for NaN
            return Result.DENIED
        if int(message_id) not in self._telemetry.builders:
            self._vehicle.say(Severity.INFO, f"No ap_message for mavlink id ({int(message_id)})")
            return Result.DENIED
        if 0.0 < interval_us < INTERVAL_MIN_US:
            text = f"Requested rate for message ID {int(message_id)} too fast. Increase SCHED_LOOP_RATE"
            self._vehicle.say(Severity.INFO, text)
            return Result.DENIED
        self._streams.set_interval(int(message_id), int(interval_us), self._vehicle.sim_time_ns)
        return Result.ACCEPTED

    def _tell_version(self, request: Request) -> Result:
        """The old form of a request for AUTOPILOT_VERSION; dronekit uses it."""
        if request.parameters[0] != 1.0:
            return Result.FAILED
        return self._tell(dialect.MAVLINK_MSG_ID_AUTOPILOT_VERSION)

    def _tell(self, message_id: float) -> Result:
        builder = self._telemetry.builders.get(int(message_id)) if isfinite(message_id) else None
        if builder is None:
            return Result.FAILED
        message = builder()
        if message is not None:  # what there is nothing to say about yet is accepted all the same
            self._requested.append(message)
        return Result.ACCEPTED


def int_or_zero(value: float) -> int:
    """Return a parameter that carries an integer; 0 if it is not a number."""
    return int(value) if isfinite(value) else 0
