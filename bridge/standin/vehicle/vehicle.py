"""The vehicle: what it knows, whether it is armed, which mode flies it, and the motor outputs."""

from __future__ import annotations

from math import degrees, radians

from bridge.standin.control.attitude_control import AttitudeGains
from bridge.standin.control.controller import OUTER_STEP_S, FlightController
from bridge.standin.control.mixer import PWM_MIN_US, MotorCommands, motor_frame, pwm_us
from bridge.standin.control.navigator import FlightLimits, Navigator
from bridge.standin.control.position_control import GRAVITY_MPS2, PositionGains
from bridge.standin.control.profile import Limits
from bridge.standin.control.quaternion import IDENTITY, Quaternion, Vector, euler_from_quaternion
from bridge.standin.vehicle.arming import arm_failures, prearm_failures
from bridge.standin.vehicle.battery import Battery
from bridge.standin.vehicle.events import Event, HomeChanged, ModeChanged, Severity, StatusText
from bridge.standin.vehicle.flight_modes import FlightMode, ModeNumber, Stabilize
from bridge.standin.vehicle.location import Location
from bridge.standin.vehicle.maneuvers import Drive
from bridge.standin.vehicle.mission import Mission
from bridge.standin.vehicle.modes import mode_by_number
from bridge.standin.vehicle.parameters import Parameters
from bridge.standin.vehicle.rc_input import RcInput
from bridge.standin.vehicle.wind import WindEstimate
from bridge.standin.wire.sensors import SensorFrame

GROUND_CONTACT_S = 1.0
GROUND_SPEED_MAX_MPS = 0.2
GROUND_SUSPECTED_S = 0.2
GROUND_LIFT_SHARE = 0.65
"""Share of the weight: a vehicle that carries less of it and does not sink must stand on something."""
THROTTLE_LOW = 0.1
SERVOS = 16
STANDING: Vector = (0.0, 0.0, 0.0)


class Vehicle:
    """A multirotor on the ground or in flight. ``step`` it with every sensor frame."""

    def __init__(self, origin: Location, parameters: Parameters) -> None:
        self.origin = origin
        """Where position (0, 0, 0) of the sensor frames is."""
        self.parameters = parameters
        self.home: Location | None = None
        self.mission = Mission()
        self.navigator = Navigator()
        self.battery = Battery()
        self.rc = RcInput()
        self.wind = WindEstimate()
        self.frame: SensorFrame | None = None
        self.sim_time_ns = 0
        self.uptime_s = 0.0
        """Sensor time since the first frame."""
        self.armed = False
        self.landed = True
        self.taking_off = self.landing = False
        self.mode: FlightMode = Stabilize()
        self.drive = Drive.IDLE
        self.throttle_given = 0.0
        """Throttle while spooling or in STABILIZE."""
        self.attitude_given: Quaternion = IDENTITY
        self.yaw_rate_given_radps = 0.0
        self.speed_override_mps: float | None = None
        """Set by MAV_CMD_DO_CHANGE_SPEED, as the two below; ends with the mode."""
        self.climb_override_mps: float | None = None
        self.sink_override_mps: float | None = None
        frame = motor_frame(parameters["FRAME_CLASS"], parameters["FRAME_TYPE"])
        motors = self._motor_count = frame.motors
        self.servo_output_us = [PWM_MIN_US] * motors + [0] * (SERVOS - motors)
        self.flight_started_ns: int | None = None
        self._events: list[Event] = []
        self._commands: MotorCommands = (0.0,) * motors
        self._step_s = self._outer_s = 0.0
        self._ground_s = 0.0
        self._idle_since_ns = 0
        self._revision = -1
        self._ready = False
        self._home_locked = False
        self.controller = FlightController(
            AttitudeGains(), PositionGains(), parameters["MOT_THST_HOVER"], frame
        )
        self._read_parameters()

    # --- time

    def sense(self, frame: SensorFrame, sim_time_ns: int, step_s: float) -> None:
        """Take one sensor frame.

        Args:
            frame: the frame.
            sim_time_ns: time since boot.
            step_s: how much the frame advanced the time; 0 after a reset of the physics.
        """
        self._step_s = 0.0 if self.frame is None else step_s
        self.uptime_s += self._step_s
        self.frame = frame
        self.sim_time_ns = sim_time_ns

    def step(self) -> list[int]:
        """Control the vehicle by the frame that was taken; return the 16 servo outputs in us."""
        frame, step_s = self.frame, self._step_s
        if frame is None or step_s <= 0.0:
            return self.servo_output_us
        self._outer_s += step_s
        if self._outer_s >= OUTER_STEP_S - 1e-6:
            self._outer(frame, self._outer_s)
            self._outer_s = 0.0
        if self.armed:
            self._commands = self._motors(frame, step_s)
            self.servo_output_us[0 : self._motor_count] = pwm_us(self._commands)
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
        self._events.append(StatusText(severity, text))

    # --- state as others read it

    @property
    def position_ned_m(self) -> Vector:
        """Position from the origin."""
        return self.frame.position_ned_m if self.frame else STANDING

    @property
    def velocity_ned_mps(self) -> Vector:
        """Velocity over ground."""
        return self.frame.velocity_ned_mps if self.frame else STANDING

    @property
    def attitude_rad(self) -> Vector:
        """Roll, pitch, yaw."""
        return euler_from_quaternion(self.frame.attitude_wxyz) if self.frame else STANDING

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

    @property
    def motor_count(self) -> int:
        """How many motors it has."""
        return self._motor_count

    @property
    def motor_commands(self) -> MotorCommands:
        """The motors' commands, 0..1."""
        return self._commands

    def depth_of(self, alt_amsl_m: float) -> float:
        """Return the down coordinate of an altitude, m."""
        return self.origin.alt_amsl_m - alt_amsl_m

    def ready_to_arm(self) -> bool:
        """Whether the checks before arming pass (SYS_STATUS carries it as PREARM_CHECK)."""
        return not self.prearm_failures()

    def prearm_failures(self) -> list[str]:
        """Return the reasons for which the vehicle is not ready."""
        failures = prearm_failures(self.frame, self.uptime_s, attitude_only=not self.mode.needs_position)
        if not failures and self.mode.needs_mission and len(self.mission) < 2:
            failures.append("Mode requires mission")
        return failures

    def report_prearm_failures(self) -> None:
        """Say why the vehicle is not ready, if it is not."""
        self._refuse("PreArm", self.prearm_failures())

    # --- what the ground asks

    def arm(self, force: bool) -> bool:
        """Arm the motors; on refusal say why and return False."""
        if self.armed:
            return True
        frame = self.frame
        if frame is None or not (force or self.parameters["ARMING_CHECK"] == 0 or self.ready_to_arm()):
            self._refuse("Arm", self.prearm_failures())
            return False
        if not force and not self._mode_may_arm(frame):
            return False
        self.armed = True
        self.landed = True
        self.drive = Drive.IDLE
        self._idle_since_ns = self.sim_time_ns
        if not self._home_locked:
            self.set_home(self.location)
        self.say(Severity.INFO, "Arming motors")
        self.tell(ModeChanged())
        self.mode.enter(self)
        return True

    def disarm(self, force: bool) -> bool:
        """Stop the motors; refused in flight unless forced."""
        if self.armed and not self.landed and not force:
            return False
        if self.armed:
            self.armed = self.taking_off = self.landing = False
            self.landed = True
            self.drive = Drive.IDLE
            self._commands = (0.0,) * self._motor_count
            self.servo_output_us[0 : self._motor_count] = [PWM_MIN_US] * self._motor_count
            self.flight_started_ns = None
            self.say(Severity.INFO, "Disarming motors")
            self.tell(ModeChanged())
        return True

    def set_mode(self, number: int) -> bool:
        """Change the flight mode; on refusal say why and return False."""
        mode = mode_by_number(number)
        if mode is None:
            self.say(Severity.WARNING, f"No such mode {number}")
            return False
        if mode.number == self.mode.number:
            return True
        refusal = mode.refusal(self) if self.armed else ""  # on the ground any mode may be chosen
        if refusal:
            self.say(Severity.WARNING, f"Mode change to {mode.name} failed: {refusal}")
            return False
        self.mode = mode
        self.taking_off = self.landing = False
        self.speed_override_mps = self.climb_override_mps = self.sink_override_mps = None
        self.tell(ModeChanged())
        if self.frame is not None:
            self.navigator.start(self.frame)
            mode.enter(self)
        return True

    def set_home(self, home: Location, *, lock: bool = False) -> None:
        """Set home; item 0 of the mission follows. A home that is locked stays when the vehicle arms."""
        self.home = home
        self._home_locked = lock or self._home_locked
        self.mission.set_home(home)
        self.tell(HomeChanged())

    # --- what the modes ask

    def leave_ground(self) -> None:
        """The vehicle has lifted off: fly on from its present state."""
        if self.frame is None:
            return
        self.landed = False
        self.flight_started_ns = self.sim_time_ns
        self.controller.lifted_off(self.frame)
        self.navigator.start(self.frame)
        self.drive = Drive.FOLLOW

    def limits(self) -> FlightLimits:
        """Return the limits of the references, from the parameters and DO_CHANGE_SPEED."""
        if self._revision != self.parameters.revision:
            self._read_parameters()
        limits = self._limits
        if (
            self.speed_override_mps is None
            and self.climb_override_mps is None
            and self.sink_override_mps is None
        ):
            return limits
        horizontal = limits.horizontal
        return FlightLimits(
            Limits(
                self.speed_override_mps or horizontal.speed_mps, horizontal.accel_mps2, horizontal.jerk_mps3
            ),
            limits.vertical,
            self.climb_override_mps or limits.climb_mps,
            self.sink_override_mps or limits.sink_mps,
        )

    # --- inside

    def _outer(self, frame: SensorFrame, step_s: float) -> None:
        self._announce_ready()
        limits = self.limits()
        if self.armed:
            self.mode.update(self, step_s)
            if self.drive is Drive.FOLLOW:
                self.navigator.step(frame, limits, step_s)
                self.controller.plan(frame, self.navigator, step_s)
            self._check_ground(frame, step_s)
            self._check_idle()
        self.battery.step(self._commands, self.parameters["BATT_CAPACITY"], step_s)
        self.wind.step(frame, step_s)

    def _motors(self, frame: SensorFrame, step_s: float) -> MotorCommands:
        controller = self.controller
        if self.drive is Drive.FOLLOW:
            return controller.follow(frame, step_s)
        if self.drive is Drive.SPOOL:
            return controller.spool(frame, self.throttle_given, self.navigator.yaw_rad, step_s)
        if self.drive is Drive.TILT:
            return controller.tilt(
                frame, self.attitude_given, self.throttle_given, self.yaw_rate_given_radps, step_s
            )
        return controller.rest(frame, self._idle_command)

    def _check_ground(self, frame: SensorFrame, step_s: float) -> None:
        """Find that the vehicle stands: little thrust, and still it does not sink."""
        controller = self.controller
        if self.drive is Drive.FOLLOW:
            little = controller.planned_lift_mps2 < GROUND_LIFT_SHARE * GRAVITY_MPS2
        else:
            little = (
                self.drive is Drive.TILT
                and self.throttle_given < GROUND_LIFT_SHARE * controller.hover_throttle
            )
        still = abs(frame.velocity_ned_mps[2]) < GROUND_SPEED_MAX_MPS
        self._ground_s = self._ground_s + step_s if little and still and not self.landed else 0.0
        if self._ground_s > GROUND_SUSPECTED_S:
            self.navigator.restart_horizontal(frame)
            controller.relax(frame)
        if self._ground_s >= GROUND_CONTACT_S:
            self._ground_s = 0.0
            self.landed = True
            self.landing = False
            self.drive = Drive.IDLE
            self._idle_since_ns = self.sim_time_ns
            self.mode.touched_ground(self)

    def _check_idle(self) -> None:
        """Disarm a vehicle that stands armed for longer than DISARM_DELAY."""
        delay_s = self.parameters["DISARM_DELAY"]
        if not self.landed or self.drive is not Drive.IDLE:
            self._idle_since_ns = self.sim_time_ns
        elif delay_s > 0 and self.sim_time_ns - self._idle_since_ns > delay_s * 1e9:
            self.disarm(force=False)

    def _announce_ready(self) -> None:
        if not self._ready and not prearm_failures(self.frame, self.uptime_s, attitude_only=False):
            self._ready = True
            self.say(Severity.INFO, "EKF3 IMU0 is using GPS")
            if self.home is None:
                self.set_home(self.location)

    def _mode_may_arm(self, frame: SensorFrame) -> bool:
        sticks = self.rc.sticks(self.sim_time_ns)
        throttle_low = (
            sticks is None or sticks.throttle < THROTTLE_LOW or self.mode.number != ModeNumber.STABILIZE
        )
        failures = arm_failures(frame, self.mode.name, self.mode.armable, throttle_low)
        self._refuse("Arm", failures)
        return not failures

    def _refuse(self, stage: str, failures: list[str]) -> None:
        for failure in failures:
            self.say(Severity.CRITICAL, f"{stage}: {failure}")

    def _read_parameters(self) -> None:
        value = self.parameters.__getitem__
        self._revision = self.parameters.revision
        self._limits = FlightLimits(
            Limits(
                max(value("WPNAV_SPEED"), 10.0) / 100,
                max(value("WPNAV_ACCEL"), 50.0) / 100,
                value("PSC_JERK_XY"),
            ),
            Limits(0.0, max(value("WPNAV_ACCEL_Z"), 50.0) / 100, value("PSC_JERK_Z")),
            max(value("WPNAV_SPEED_UP"), 10.0) / 100,
            max(value("WPNAV_SPEED_DN"), 10.0) / 100,
        )
        self._idle_command = value("MOT_SPIN_ARM")
        self.controller.lowest_command = value("MOT_SPIN_MIN")
        self.controller.tilt_max_rad = radians(max(10.0, min(60.0, value("ANGLE_MAX") / 100)))
        self.controller.set_attitude_gains(
            AttitudeGains(
                angle_p=value("ATC_ANG_RLL_P"),
                yaw_angle_p=value("ATC_ANG_YAW_P"),
                rate_p=value("ATC_RAT_RLL_P"),
                rate_i=value("ATC_RAT_RLL_I"),
                rate_d=value("ATC_RAT_RLL_D"),
                yaw_rate_p=value("ATC_RAT_YAW_P"),
                yaw_rate_i=value("ATC_RAT_YAW_I"),
            )
        )


def heading_deg(yaw_rad: float) -> float:
    """Return a yaw as a heading, 0 <= degrees < 360."""
    return degrees(yaw_rad) % 360.0
