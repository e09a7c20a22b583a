"""COMMAND_LONG and COMMAND_INT: one handler per command, and its MAV_RESULT, as ArduCopter answers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum
from math import isfinite, isnan

from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridge.standin.protocols.guided_targets import location_from
from bridge.standin.protocols.streams import Streams
from bridge.standin.protocols.telemetry import Telemetry
from bridge.standin.vehicle.events import Severity
from bridge.standin.vehicle.flight_modes import ModeNumber
from bridge.standin.vehicle.mode_auto import Auto, turn_to_condition
from bridge.standin.vehicle.mode_guided import Guided, GuidedTarget
from bridge.standin.vehicle.vehicle import Vehicle
from bridge.standin.wire.mavlink_codec import Message

FORCE_MAGIC = (2989.0, 21196.0)
"""param2 of COMPONENT_ARM_DISARM that skips the checks (either of ArduPilot's two numbers)."""
SPEED_TYPES = (0, 1, 2, 3)
SPEED_MAX_MPS = 20.0
REBOOT_TEXT = "Reboot: end and start the process"


class Result(IntEnum):
    """MAV_RESULT."""

    ACCEPTED = 0
    TEMPORARILY_REJECTED = 1
    DENIED = 2
    UNSUPPORTED = 3
    FAILED = 4


@dataclass(frozen=True, slots=True)
class CommandRequest:
    """A command of either form: four parameters, degrees, and a height in a frame."""

    command: int
    param1: float
    param2: float
    param3: float
    param4: float
    lat_deg: float
    lon_deg: float
    alt_m: float
    frame: int
    whole_degrees: bool
    """Whether the position came as integers (COMMAND_INT)."""


def request_from(message: Message) -> CommandRequest:
    """Return the request of a COMMAND_LONG or COMMAND_INT."""
    parameters = (message.param1, message.param2, message.param3, message.param4)
    if message.get_type() == "COMMAND_INT":
        return CommandRequest(
            message.command, *parameters, message.x * 1e-7, message.y * 1e-7, message.z, message.frame, True
        )
    frame = dialect.MAV_FRAME_GLOBAL_RELATIVE_ALT
    if message.command in (dialect.MAV_CMD_DO_SET_HOME,):
        frame = dialect.MAV_FRAME_GLOBAL
    return CommandRequest(
        message.command, *parameters, message.param5, message.param6, message.param7, frame, False
    )


class Commands:
    """Runs requests on a vehicle; ``send`` is where requested messages go."""

    def __init__(
        self, vehicle: Vehicle, telemetry: Telemetry, streams: Streams, send: Callable[[Message], None]
    ) -> None:
        self._vehicle = vehicle
        self._telemetry = telemetry
        self._streams = streams
        self._send = send
        self._requested: list[Message] = []
        self._handlers: dict[int, Callable[[CommandRequest], Result]] = {
            dialect.MAV_CMD_COMPONENT_ARM_DISARM: self._arm_disarm,
            dialect.MAV_CMD_RUN_PREARM_CHECKS: self._run_prearm_checks,
            dialect.MAV_CMD_DO_SET_MODE: self._set_mode,
            dialect.MAV_CMD_NAV_TAKEOFF: self._take_off,
            dialect.MAV_CMD_NAV_LAND: lambda _: self._enter(ModeNumber.LAND),
            dialect.MAV_CMD_NAV_RETURN_TO_LAUNCH: lambda _: self._enter(ModeNumber.RTL),
            dialect.MAV_CMD_NAV_LOITER_UNLIM: lambda _: self._enter(ModeNumber.LOITER),
            dialect.MAV_CMD_MISSION_START: self._start_mission,
            dialect.MAV_CMD_DO_SET_MISSION_CURRENT: self._set_mission_current,
            dialect.MAV_CMD_DO_REPOSITION: self._reposition,
            dialect.MAV_CMD_DO_CHANGE_SPEED: self._change_speed,
            dialect.MAV_CMD_CONDITION_YAW: self._condition_yaw,
            dialect.MAV_CMD_DO_SET_HOME: self._set_home,
            dialect.MAV_CMD_GET_HOME_POSITION: self._get_home,
            dialect.MAV_CMD_SET_MESSAGE_INTERVAL: self._set_interval,
            dialect.MAV_CMD_GET_MESSAGE_INTERVAL: self._get_interval,
            dialect.MAV_CMD_REQUEST_MESSAGE: self._request_message,
            dialect.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES: self._request_capabilities,
            dialect.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN: self._reboot,
        }

    def run(self, request: CommandRequest) -> Result:
        """Run one request; return its MAV_RESULT."""
        handler = self._handlers.get(request.command)
        return Result.UNSUPPORTED if handler is None else handler(request)

    def take_requested(self) -> list[Message]:
        """Return and forget the messages that follow the acknowledgement."""
        requested, self._requested = self._requested, []
        return requested

    def _arm_disarm(self, request: CommandRequest) -> Result:
        force = request.param2 in FORCE_MAGIC
        if request.param1 == 1.0:
            return Result.ACCEPTED if self._vehicle.arm(force) else Result.FAILED
        if request.param1 == 0.0:
            return Result.ACCEPTED if self._vehicle.disarm(force) else Result.FAILED
        return Result.UNSUPPORTED

    def _run_prearm_checks(self, _: CommandRequest) -> Result:
        if self._vehicle.armed:
            return Result.TEMPORARILY_REJECTED
        self._vehicle.report_prearm_failures()
        return Result.ACCEPTED

    def _set_mode(self, request: CommandRequest) -> Result:
        if not int_or_zero(request.param1) & dialect.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED:
            return Result.DENIED
        return self._enter(int_or_zero(request.param2))

    def _enter(self, number: int) -> Result:
        return Result.ACCEPTED if self._vehicle.set_mode(number) else Result.FAILED

    def _take_off(self, request: CommandRequest) -> Result:
        mode = self._vehicle.mode
        if request.frame not in (
            dialect.MAV_FRAME_GLOBAL_RELATIVE_ALT,
            dialect.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT,
        ) or not isfinite(request.alt_m):
            return Result.DENIED
        if not isinstance(mode, Guided):
            return Result.FAILED
        return Result.ACCEPTED if mode.take_off(self._vehicle, request.alt_m) else Result.FAILED

    def _start_mission(self, request: CommandRequest) -> Result:
        if request.param1 != 0.0 or request.param2 != 0.0:
            return Result.DENIED
        if not self._vehicle.set_mode(ModeNumber.AUTO):
            return Result.FAILED
        if isinstance(self._vehicle.mode, Auto):
            self._vehicle.mode.started = True
        return Result.ACCEPTED

    def _set_mission_current(self, request: CommandRequest) -> Result:
        seq = int_or_zero(request.param1)
        if not self._vehicle.mission.set_current(seq):
            return Result.DENIED
        self._requested.append(self._telemetry.mission_current())
        return Result.ACCEPTED

    def _reposition(self, request: CommandRequest) -> Result:
        if not request.whole_degrees:
            return Result.UNSUPPORTED  # COMMAND_LONG would lose metres: ArduPilot takes COMMAND_INT only
        vehicle = self._vehicle
        change_mode = int_or_zero(request.param2) & dialect.MAV_DO_REPOSITION_FLAGS_CHANGE_MODE
        location = location_from(vehicle, request.lat_deg, request.lon_deg, request.alt_m, request.frame)
        if location is None or not (isinstance(vehicle.mode, Guided) or change_mode):
            return Result.DENIED
        if not vehicle.set_mode(ModeNumber.GUIDED) or not isinstance(vehicle.mode, Guided):
            return Result.FAILED
        if isfinite(request.param1) and request.param1 > 0.0:
            vehicle.speed_override_mps = min(request.param1, SPEED_MAX_MPS)
        target = GuidedTarget(vehicle.origin.ned_to(location))
        vehicle.mode.fly(vehicle, target)  # accepted on the ground too, where it moves nothing
        return Result.ACCEPTED

    def _change_speed(self, request: CommandRequest) -> Result:
        if request.param1 not in SPEED_TYPES or not request.param2 > 0.0:
            return Result.DENIED
        vehicle = self._vehicle
        speed_mps = min(request.param2, SPEED_MAX_MPS)
        if not isinstance(vehicle.mode, Guided | Auto) and vehicle.mode.number is not ModeNumber.RTL:
            return Result.FAILED
        if request.param1 in (0, 1):
            vehicle.speed_override_mps = speed_mps
        elif request.param1 == 2:
            vehicle.climb_override_mps = speed_mps
        else:
            vehicle.sink_override_mps = speed_mps
        return Result.ACCEPTED

    def _condition_yaw(self, request: CommandRequest) -> Result:
        if not 0.0 <= request.param1 <= 360.0 or request.param4 not in (0.0, 1.0):
            return Result.FAILED
        turn_to_condition(self._vehicle, request.param1, request.param3, relative=request.param4 == 1.0)
        return Result.ACCEPTED

    def _set_home(self, request: CommandRequest) -> Result:
        vehicle = self._vehicle
        if request.param1 == 1.0 or (request.lat_deg, request.lon_deg, request.alt_m) == (0.0, 0.0, 0.0):
            vehicle.set_home(vehicle.location, lock=True)
            return Result.ACCEPTED
        location = location_from(vehicle, request.lat_deg, request.lon_deg, request.alt_m, request.frame)
        if location is None:
            return Result.DENIED
        vehicle.set_home(location, lock=True)
        return Result.ACCEPTED

    def _get_home(self, _: CommandRequest) -> Result:
        message = self._telemetry.home_position()
        if message is None:
            return Result.FAILED
        self._send(message)
        origin = self._telemetry.gps_global_origin()
        if origin is not None:
            self._send(origin)
        return Result.ACCEPTED

    def _set_interval(self, request: CommandRequest) -> Result:
        message_id = int_or_zero(request.param1)
        if message_id not in self._telemetry.builders or isnan(request.param2):
            self._vehicle.say(Severity.INFO, f"No ap_message for mavlink id ({message_id})")
            return Result.DENIED
        interval_us = int_or_zero(max(-1.0, min(1e9, request.param2)))
        self._streams.set_interval(message_id, interval_us, self._vehicle.sim_time_ns)
        return Result.ACCEPTED

    def _get_interval(self, request: CommandRequest) -> Result:
        message_id = int_or_zero(request.param1)
        if message_id not in self._telemetry.builders:
            self._send(dialect.MAVLink_message_interval_message(message_id & 0xFFFF, 0))
            return Result.FAILED
        self._send(
            dialect.MAVLink_message_interval_message(message_id, self._streams.interval_us(message_id))
        )
        return Result.ACCEPTED

    def _request_message(self, request: CommandRequest) -> Result:
        builder = self._telemetry.builders.get(int_or_zero(request.param1))
        if builder is None:
            return Result.FAILED
        message = builder()
        if message is not None:  # what there is nothing to say about yet is accepted all the same
            self._requested.append(message)
        return Result.ACCEPTED

    def _request_capabilities(self, request: CommandRequest) -> Result:
        if request.param1 == 1.0:
            self._requested.append(self._telemetry.autopilot_version())
        return Result.ACCEPTED

    def _reboot(self, _: CommandRequest) -> Result:
        self._vehicle.say(Severity.WARNING, REBOOT_TEXT)
        return Result.FAILED


def int_or_zero(value: float) -> int:
    """Return a parameter that carries an integer; 0 if it is not a number."""
    return int(value) if isfinite(value) else 0
