"""The flight modes, with ArduCopter's numbers: each says when it may be entered, and flies the vehicle.

A mode is made anew each time it is entered. ``update`` runs at 100 Hz while the vehicle is armed.
"""

from __future__ import annotations

from enum import IntEnum
from math import cos, sin
from typing import TYPE_CHECKING

from bridge.standin.control.quaternion import quaternion_from_euler, yaw_of
from bridge.standin.vehicle.maneuvers import Drive, Landing, ReturnSequence
from bridge.standin.vehicle.rc_input import Sticks

if TYPE_CHECKING:
    from bridge.standin.vehicle.vehicle import Vehicle

STICK_DEADBAND = 0.1
LOITER_SPEED_MPS = 5.0
STICK_YAW_RATE_RADPS = 1.0
THROTTLE_STICK_IDLE = 0.05
LIFT_OFF_RISE_M = 0.1


class ModeNumber(IntEnum):
    """ArduCopter's custom_mode."""

    STABILIZE = 0
    AUTO = 3
    GUIDED = 4
    LOITER = 5
    RTL = 6
    LAND = 9


class FlightMode:
    """What all modes have; a mode of its own overrides what differs."""

    number: ModeNumber
    armable = True
    needs_position = True
    needs_mission = False
    guided_flag = True
    """Whether the heartbeat carries MAV_MODE_FLAG_GUIDED_ENABLED."""

    @property
    def name(self) -> str:
        """ArduCopter's name of the mode."""
        return self.number.name

    def refusal(self, vehicle: Vehicle) -> str:
        """Return why the mode cannot be entered now; empty if it can."""
        failures = vehicle.prearm_failures()
        if self.needs_position and failures:
            return failures[0]
        return ""

    def enter(self, vehicle: Vehicle) -> None:
        """Begin: the navigator has just been told to stop where the vehicle is."""

    def update(self, vehicle: Vehicle, step_s: float) -> None:
        """Decide the drive and the target; ``step_s`` since the last call."""
        raise NotImplementedError

    def touched_ground(self, vehicle: Vehicle) -> None:
        """The vehicle was found standing; its motors are idle now."""


class Stabilize(FlightMode):
    """Level, or as the sticks say; the throttle is the pilot's (none without sticks)."""

    number = ModeNumber.STABILIZE
    needs_position = False
    guided_flag = False

    def __init__(self) -> None:
        self._ground_down_m: float | None = None

    def update(self, vehicle: Vehicle, _step_s: float) -> None:
        """Pass the sticks on."""
        frame = vehicle.frame
        if frame is None:
            return
        sticks = vehicle.rc.sticks(vehicle.sim_time_ns) or Sticks(0.0, 0.0, 0.0, 0.0)
        if vehicle.landed and sticks.throttle < THROTTLE_STICK_IDLE:
            self._ground_down_m = frame.position_ned_m[2]
            vehicle.drive = Drive.IDLE
            return
        if vehicle.landed and (self._ground_down_m or 0.0) - frame.position_ned_m[2] > LIFT_OFF_RISE_M:
            vehicle.landed = False
            vehicle.flight_started_ns = vehicle.sim_time_ns
        lean_rad = vehicle.controller.tilt_max_rad
        vehicle.yaw_rate_given_radps = STICK_YAW_RATE_RADPS * _beyond_deadband(sticks.yaw)
        vehicle.attitude_given = quaternion_from_euler(
            lean_rad * sticks.roll, lean_rad * sticks.pitch, yaw_of(frame.attitude_wxyz)
        )
        vehicle.throttle_given = _stick_throttle(sticks.throttle, vehicle.controller.hover_throttle)
        vehicle.drive = Drive.TILT


class Loiter(FlightMode):
    """Hold position, or move as the sticks say."""

    number = ModeNumber.LOITER

    def update(self, vehicle: Vehicle, _step_s: float) -> None:
        """Turn the sticks into velocities."""
        vehicle.drive = Drive.IDLE if vehicle.landed else Drive.FOLLOW
        sticks = vehicle.rc.sticks(vehicle.sim_time_ns) or Sticks(0.0, 0.0, 0.5, 0.0)
        forward = -LOITER_SPEED_MPS * _beyond_deadband(sticks.pitch)
        right = LOITER_SPEED_MPS * _beyond_deadband(sticks.roll)
        c, s = cos(vehicle.navigator.yaw_rad), sin(vehicle.navigator.yaw_rad)
        vehicle.navigator.fly_velocity((c * forward - s * right, s * forward + c * right))
        climb = _beyond_deadband(2.0 * sticks.throttle - 1.0)
        limits = vehicle.limits()
        vehicle.navigator.fly_sink_rate(-climb * (limits.climb_mps if climb > 0.0 else limits.sink_mps))
        if _beyond_deadband(sticks.yaw):
            vehicle.navigator.turn_at(STICK_YAW_RATE_RADPS * sticks.yaw)
        else:
            vehicle.navigator.hold_yaw()


class Land(FlightMode):
    """Come down here and disarm."""

    number = ModeNumber.LAND
    armable = False

    def __init__(self) -> None:
        self._landing = Landing()

    def update(self, vehicle: Vehicle, _step_s: float) -> None:
        """Sink."""
        if vehicle.landed:
            vehicle.disarm(force=False)
        else:
            self._landing.update(vehicle)

    def touched_ground(self, vehicle: Vehicle) -> None:
        """Disarm."""
        vehicle.disarm(force=False)


class ReturnToLaunch(FlightMode):
    """Climb, fly home, wait, and land (or stay at RTL_ALT_FINAL)."""

    number = ModeNumber.RTL
    armable = False

    def __init__(self) -> None:
        self.sequence = ReturnSequence()

    def refusal(self, vehicle: Vehicle) -> str:
        """RTL needs home too."""
        return super().refusal(vehicle) or ("" if vehicle.home else "requires home")

    def enter(self, vehicle: Vehicle) -> None:
        """Plan the height of the return."""
        self.sequence.start(vehicle)

    def update(self, vehicle: Vehicle, step_s: float) -> None:
        """Go on with the return."""
        if vehicle.landed:
            vehicle.disarm(force=False)
        else:
            self.sequence.update(vehicle, step_s)

    def touched_ground(self, vehicle: Vehicle) -> None:
        """Disarm."""
        vehicle.disarm(force=False)


def _stick_throttle(stick: float, hover_throttle: float) -> float:
    """Map the stick so that its middle hovers."""
    if stick < 0.5:
        return 2.0 * stick * hover_throttle
    return hover_throttle + 2.0 * (stick - 0.5) * (0.95 - hover_throttle)


def _beyond_deadband(value: float) -> float:
    return 0.0 if abs(value) < STICK_DEADBAND else value
