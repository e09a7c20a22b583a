"""The vehicle: what it knows, whether it is armed, which mode flies it, and the motor outputs."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from math import acos, degrees, radians

from standin.control.controller import OUTER_STEP_S, FlightController
from standin.control.mixer import MotorCommands, motor_frame, pwm_us
from standin.control.navigator import FlightLimits, Navigator
from standin.control.position_control import GRAVITY_MPS2
from standin.control.profile import Limits
from standin.control.quaternion import Vector, euler_from_quaternion, thrust_axis_down
from standin.vehicle.estimates import Battery, WindEstimate
from standin.vehicle.events import Event, HomeChanged, ModeChanged, Severity, TextEvent
from standin.vehicle.location import Location
from standin.vehicle.mission import Mission, SpeedKind
from standin.vehicle.mode import Drive, FlightMode, ModeNumber
from standin.vehicle.parameters import StandinParameters
from standin.vehicle.sticks import Sticks
from standin.wire.sensors import AT_REST, SensedFrame

GPS_FIX_AFTER_S = 1.0
"""Sensor time from the first frame to a GPS fix."""
ESTIMATE_AFTER_S = 3.0
"""Sensor time from the first frame to a position estimate: ready to arm from then on."""
LEAN_MAX_DEG = 45.0
IDLE_COMMAND = 0.10
"""Of the motors of an armed vehicle that stands."""
GROUND_CONTACT_S = 1.0
GROUND_SPEED_MAX_MPS = 0.2
GROUND_SUSPECTED_S = 0.2
GROUND_LIFT_SHARE = 0.65
"""Share of the weight: a vehicle that carries less of it and does not sink must stand on something."""
SERVOS = 16


Modes = Mapping[int, Callable[["StandinVehicle"], FlightMode]]


class StandinVehicle:
    """A multirotor on the ground or in flight: ``sense`` every sensor frame, then ``step``.

    Args:
        origin: where position (0, 0, 0) of the sensor frames is.
        parameters: their values.
        modes: by its number, what makes each mode.
    """

    def __init__(self, origin: Location, parameters: StandinParameters, modes: Modes) -> None:
        self.origin, self.parameters, self._modes = origin, parameters, modes
        self.home: Location | None = None
        self.mission = Mission()
        self.navigator = Navigator()
        self.sticks = Sticks()
        self.battery = Battery()
        self.wind = WindEstimate()
        self.frame: SensedFrame = AT_REST
        self.sim_time_ns = 0
        self.uptime_s = 0.0
        """Sensor time since the first frame."""
        self.armed = False
        self.armed_yaw_rad = 0.0
        """Where the nose was at arming."""
        self.landed = True
        self.taking_off = self.landing = False
        self.mode: FlightMode = modes[ModeNumber.STABILIZE](self)
        self.drive = Drive.IDLE
        self.throttle_given = 0.0
        """Throttle while spooling."""
        self._speeds_mps: dict[SpeedKind, float] = {}
        """Set by MAV_CMD_DO_CHANGE_SPEED; they end with the mode."""
        frame = motor_frame(parameters["FRAME_CLASS"], parameters["FRAME_TYPE"])
        self.motor_count = len(frame.motors)
        self.controller = FlightController(parameters["MOT_THST_HOVER"], frame)
        self.servo_output_us = [0] * SERVOS
        self._command((0.0,) * self.motor_count)
        self._events: list[Event] = []
        self._step_s = self._outer_s = self._ground_s = 0.0
        self._idle_since_ns = 0
        self._ready = False
        self._read_parameters()

    # --- time

    def sense(self, frame: SensedFrame, sim_time_ns: int, step_s: float) -> None:
        """Take one sensor frame.

        Args:
            frame: the frame.
            sim_time_ns: time since boot.
            step_s: how much the frame advanced the time; 0 after a reset of the physics.
        """
        self._step_s = 0.0 if self.frame is AT_REST else step_s
        self.uptime_s += self._step_s
        self.frame = frame
        self.sim_time_ns = sim_time_ns

    def step(self) -> list[int]:
        """Control the vehicle by the frame that was taken; return the 16 servo outputs in us."""
        step_s = self._step_s
        if step_s <= 0.0:
            return self.servo_output_us
        self._outer_s += step_s
        if self._outer_s >= OUTER_STEP_S - 1e-6:
            self._outer(self.frame, self._outer_s)
            self._outer_s = 0.0
        if self.armed:
            self._command(self._motors(self.frame, step_s))
        return self.servo_output_us

    @property
    def has_events(self) -> bool:
        """Whether ``take_events`` would return any."""
        return bool(self._events)

    def take_events(self) -> list[Event]:
        """Return and forget the events since the last call."""
        events, self._events = self._events, []
        return events

    def tell(self, event: Event) -> None:
        """Add an event."""
        self._events.append(event)

    def say(self, severity: Severity, text: str) -> None:
        """Add a status text."""
        self._events.append(TextEvent(severity, text))

    # --- state as others read it

    @property
    def position_ned_m(self) -> Vector:
        """Position from the origin."""
        return self.frame.position_ned_m

    @property
    def velocity_ned_mps(self) -> Vector:
        """Velocity over ground."""
        return self.frame.velocity_ned_mps

    @property
    def attitude_rad(self) -> Vector:
        """Roll, pitch, yaw."""
        return euler_from_quaternion(self.frame.attitude_wxyz)

    @property
    def location(self) -> Location:
        """Where the vehicle is."""
        return self.origin.offset(*self.position_ned_m)

    @property
    def home_or_origin(self) -> Location:
        """Home, or the origin before home is set."""
        return self.home or self.origin

    @property
    def alt_rel_m(self) -> float:
        """Height above home."""
        return self.origin.alt_amsl_m - self.position_ned_m[2] - self.home_or_origin.alt_amsl_m

    def depth_of(self, alt_amsl_m: float) -> float:
        """Return the down coordinate of an altitude, m."""
        return self.origin.alt_amsl_m - alt_amsl_m

    def position_failure(self) -> str:
        """Return why there is no position yet, in ArduPilot's words; empty if there is one."""
        if self.uptime_s < GPS_FIX_AFTER_S:
            return "GPS 1: Bad fix"
        return "Need Position Estimate" if self.uptime_s < ESTIMATE_AFTER_S else ""

    def prearm_failures(self) -> list[str]:
        """Return why the vehicle is not ready to arm, in ArduPilot's words; empty if it is."""
        if failure := self.position_failure():
            return [failure]
        if self.mode.needs_mission and len(self.mission) < 2:
            return ["Mode requires mission"]
        return []

    # --- what the ground asks

    def arm(self, force: bool) -> bool:
        """Arm the motors; on refusal say why and return False."""
        if self.armed:
            return True
        failures = [] if force else self._arm_failures()
        if failures:
            for failure in failures:
                self.say(Severity.CRITICAL, f"Arm: {failure}")
            return False
        self.armed = self.landed = True
        self.armed_yaw_rad = self.attitude_rad[2]
        self.drive = Drive.IDLE
        self._idle_since_ns = self.sim_time_ns
        self._set_home()
        self.say(Severity.INFO, "Arming motors")
        self.tell(ModeChanged())
        self.mode.enter()
        return True

    def disarm(self, force: bool) -> bool:
        """Stop the motors; refused in flight unless forced."""
        if self.armed and not self.landed and not force:
            return False
        if self.armed:
            self.armed = self.taking_off = self.landing = False
            self.landed = True
            self.drive = Drive.IDLE
            self.mission.rewind()
            self._command((0.0,) * self.motor_count)
            self.say(Severity.INFO, "Disarming motors")
            self.tell(ModeChanged())
        return True

    def set_mode(self, number: int) -> bool:
        """Change the flight mode; on refusal say why and return False."""
        if number not in self._modes:
            self.say(Severity.WARNING, f"No such mode {number}")
            return False
        if number == self.mode.number:
            return True
        mode = self._modes[number](self)
        refusal = mode.refusal() if self.armed else ""  # on the ground any mode may be chosen
        if refusal:
            self.say(Severity.WARNING, f"Mode change to {mode.name} failed: {refusal}")
            return False
        self.mission.end(complete=False)
        self.mode = mode
        self.taking_off = self.landing = False
        self.forget_speeds()
        self.tell(ModeChanged())
        self.navigator.start(self.frame)
        mode.enter()
        return True

    # --- what the modes ask

    def leave_ground(self) -> None:
        """The vehicle has lifted off: fly on from its present state."""
        self.landed = False
        self.controller.lifted_off(self.frame)
        self.navigator.start(self.frame)
        self.drive = Drive.FOLLOW

    def change_speed(self, kind: SpeedKind, speed_mps: float) -> None:
        """Fly with another speed, > 0, until the mode, or GUIDED's kind of target, ends.

        One through the air is taken for one over ground.
        """
        kind = SpeedKind.GROUND if kind is SpeedKind.AIR else kind
        if kind in self.mode.only_one_of:
            for other in self.mode.only_one_of:
                self._speeds_mps.pop(other, None)
        self._speeds_mps[kind] = speed_mps

    def forget_speeds(self) -> None:
        """End what was asked for by ``change_speed``."""
        self._speeds_mps = {}

    def limits(self) -> FlightLimits:
        """Return the limits of the references, from the parameters and DO_CHANGE_SPEED."""
        if self._revision != self.parameters.revision:
            self._read_parameters()
        limits, speeds_mps = self.mode.limits(self._limits), self._speeds_mps
        if not speeds_mps:
            return limits
        ground_mps = speeds_mps.get(SpeedKind.GROUND, limits.horizontal.speed_mps)
        return FlightLimits(
            Limits(ground_mps, limits.horizontal.accel_mps2, limits.horizontal.jerk_mps3),
            limits.vertical,
            speeds_mps.get(SpeedKind.CLIMB, limits.climb_mps),
            speeds_mps.get(SpeedKind.DESCENT, limits.sink_mps),
        )

    # --- inside

    def _outer(self, frame: SensedFrame, step_s: float) -> None:
        self._announce_ready()
        limits = self.limits()
        if self.armed:
            self.mode.update(step_s)
            if self.drive is Drive.FOLLOW:
                self.navigator.step(frame, limits, step_s)
                self.controller.plan(frame, self.navigator, step_s)
            self._check_ground(frame, step_s)
            self._check_idle()
        self.battery.step(self._commands, step_s)
        self.wind.step(frame, self.origin.alt_amsl_m - frame.position_ned_m[2], step_s)

    def _motors(self, frame: SensedFrame, step_s: float) -> MotorCommands:
        if self.drive is Drive.FOLLOW:
            return self.controller.follow(frame, step_s)
        if self.drive is Drive.SPOOL:
            return self.controller.spool(frame, self.throttle_given, self.navigator.yaw_rad, step_s)
        return self.controller.rest(frame, IDLE_COMMAND)

    def _command(self, commands: MotorCommands) -> None:
        self._commands = commands
        self.servo_output_us[0 : self.motor_count] = pwm_us(commands)

    def _check_ground(self, frame: SensedFrame, step_s: float) -> None:
        """Find that the vehicle stands: little thrust, and still it does not sink."""
        little = (
            self.drive is Drive.FOLLOW
            and self.controller.planned_lift_mps2 < GROUND_LIFT_SHARE * GRAVITY_MPS2
        )
        still = abs(frame.velocity_ned_mps[2]) < GROUND_SPEED_MAX_MPS
        self._ground_s = self._ground_s + step_s if little and still and not self.landed else 0.0
        if self._ground_s > GROUND_SUSPECTED_S:
            self.navigator.restart_horizontal(frame)
            self.controller.relax(frame)
        if self._ground_s >= GROUND_CONTACT_S:
            self._ground_s = 0.0
            self.landed = True
            self.landing = False
            self.drive = Drive.IDLE
            self._idle_since_ns = self.sim_time_ns
            self.mode.touched_ground()

    def _check_idle(self) -> None:
        """Disarm a vehicle that stands armed for longer than DISARM_DELAY, with the throttle stick at zero."""
        delay_s = self.parameters["DISARM_DELAY"]
        if not self.landed or self.drive is not Drive.IDLE or not self.sticks.low(self.sim_time_ns):
            self._idle_since_ns = self.sim_time_ns
        elif delay_s > 0 and self.sim_time_ns - self._idle_since_ns > delay_s * 1e9:
            self.disarm(force=False)

    def _announce_ready(self) -> None:
        if not self._ready and self.uptime_s >= ESTIMATE_AFTER_S:
            self._ready = True
            self.say(Severity.INFO, "EKF3 IMU0 is using GPS")
            if self.home is None:
                self._set_home()

    def _set_home(self) -> None:
        """Home is here; item 0 of the mission follows."""
        self.home = self.location
        self.mission.set_home(self.home)
        self.tell(HomeChanged())

    def _arm_failures(self) -> list[str]:
        """Return what forbids arming now; empty if nothing does."""
        failures = self.prearm_failures() if self.parameters["ARMING_CHECK"] != 0 else []
        if failures:
            return failures
        if not self.mode.armable:
            failures.append(f"{self.mode.name} mode not armable")
        tilt_deg = degrees(acos(max(-1.0, min(1.0, thrust_axis_down(self.frame.attitude_wxyz)))))
        if tilt_deg > LEAN_MAX_DEG:
            failures.append("Leaning")
        return failures

    def _read_parameters(self) -> None:
        value = self.parameters.__getitem__
        self._revision = self.parameters.revision
        self._limits = FlightLimits(
            Limits(max(value("WPNAV_SPEED"), 10.0) / 100, max(value("WPNAV_ACCEL"), 50.0) / 100, 10.0),
            Limits(0.0, max(value("WPNAV_ACCEL_Z"), 50.0) / 100, 8.0),
            max(value("WPNAV_SPEED_UP"), 10.0) / 100,
            max(value("WPNAV_SPEED_DN"), 10.0) / 100,
        )
        self.controller.tilt_max_rad = radians(max(10.0, min(60.0, value("ANGLE_MAX") / 100)))


def heading_deg(yaw_rad: float) -> float:
    """Return a yaw as a heading, 0 <= degrees < 360."""
    return degrees(yaw_rad) % 360.0
