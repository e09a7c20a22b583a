"""The flight modes, with ArduCopter's numbers: each says when it may be entered, and flies the vehicle.

A mode is made anew each time it is entered. ``update`` runs at 100 Hz while the vehicle is armed.
"""

from __future__ import annotations

from enum import Enum, auto
from typing import NamedTuple

from standin.control.navigator import FlightLimits
from standin.control.profile import Limits
from standin.control.quaternion import Vector
from standin.vehicle.maneuvers import ReturnSequence, Takeoff, land
from standin.vehicle.mission import SpeedKind
from standin.vehicle.mode import Drive, FlightMode, ModeNumber
from standin.vehicle.vehicle import StandinVehicle

ZERO: Vector = (0.0, 0.0, 0.0)
BRAKE_ACCEL_MPS2 = 7.5
"""ArduCopter's BRAKE_MODE_DECEL_RATE, horizontal and vertical."""
BRAKE_JERK_MPS3 = 5.0
"""PSC_JERK_XY and PSC_JERK_Z."""


class Nose(NamedTuple):
    """Where the nose is to point: a yaw or a rate of turn, or neither."""

    yaw_rad: float | None = None
    turn_radps: float | None = None


AS_IT_LIKES = Nose()


class GuidedTarget(Enum):
    """What GUIDED flies to."""

    TAKEOFF = auto()
    POINT = auto()
    MOVING_POINT = auto()
    VELOCITY = auto()


class VehicleMode(FlightMode):
    """What the modes have in common; each overrides what differs."""

    def __init__(self, vehicle: StandinVehicle) -> None:
        self.vehicle = vehicle

    def refusal(self) -> str:
        """Without a mission that it needs, or a position."""
        if self.needs_mission and len(self.vehicle.mission) < 2:
            return "no mission"
        return self.vehicle.position_failure()


class Stabilize(VehicleMode):
    """The mode at boot. There is no pilot: the motors idle, and no flying vehicle may enter it."""

    number = ModeNumber.STABILIZE
    guided_flag = False

    def refusal(self) -> str:
        """A pilot's mode, and there is none."""
        return "" if self.vehicle.landed else "no RC"

    def update(self, _step_s: float) -> None:
        """Stand."""
        self.vehicle.drive = Drive.IDLE


class Brake(VehicleMode):
    """Stop, and hold where that ends."""

    number = ModeNumber.BRAKE
    armable = False

    def limits(self, limits: FlightLimits) -> FlightLimits:
        """Brake as ArduCopter, whatever the parameters of way points say."""
        horizontal = Limits(limits.horizontal.speed_mps, BRAKE_ACCEL_MPS2, BRAKE_JERK_MPS3)
        vertical = Limits(limits.vertical.speed_mps, BRAKE_ACCEL_MPS2, BRAKE_JERK_MPS3)
        return FlightLimits(horizontal, vertical, limits.climb_mps, limits.sink_mps)

    def update(self, _step_s: float) -> None:
        """Hold what the navigator was given when the mode began."""
        self.vehicle.drive = Drive.IDLE if self.vehicle.landed else Drive.FOLLOW


class Loiter(VehicleMode):
    """Hold position; climb and sink by the throttle stick, which lies at zero unless a client holds it elsewhere."""

    number = ModeNumber.LOITER

    def update(self, _step_s: float) -> None:
        """Hold the position, and follow the stick."""
        self.vehicle.drive = Drive.IDLE if self.vehicle.landed else Drive.FOLLOW
        self.vehicle.navigator.fly_sink_rate(-self.vehicle.sticks.climb_mps(self.vehicle.sim_time_ns))


class Land(VehicleMode):
    """Come down here and disarm."""

    number = ModeNumber.LAND
    armable = False

    def update(self, _step_s: float) -> None:
        """Sink."""
        if self.vehicle.landed:
            self.vehicle.disarm(force=False)
        else:
            land(self.vehicle)

    def touched_ground(self) -> None:
        """Disarm."""
        self.vehicle.disarm(force=False)


class ReturnToLaunch(VehicleMode):
    """Climb, fly home, wait, and land."""

    number = ModeNumber.RTL
    armable = False

    def __init__(self, vehicle: StandinVehicle) -> None:
        super().__init__(vehicle)
        self._sequence: ReturnSequence | None = None

    def enter(self) -> None:
        """Plan the height of the return."""
        self._sequence = ReturnSequence(self.vehicle)

    def update(self, step_s: float) -> None:
        """Go on with the return."""
        if self.vehicle.landed or self._sequence is None:
            self.vehicle.disarm(force=False)
        else:
            self._sequence.update(self.vehicle, step_s)

    def touched_ground(self) -> None:
        """Disarm."""
        self.vehicle.disarm(force=False)


class Guided(VehicleMode):
    """Takeoff, a point to fly to, or a velocity (motions end after GUID_TIMEOUT).

    Speeds and accelerations are those of the parameters when the present kind of target began, and a speed that was
    asked for ends with that kind (``ModeGuided::pva_control_start``). They do not limit a velocity that is asked for.
    """

    number = ModeNumber.GUIDED
    only_one_of = frozenset({SpeedKind.CLIMB, SpeedKind.DESCENT})  # ModeGuided::set_speed_up_cms

    def __init__(self, vehicle: StandinVehicle) -> None:
        super().__init__(vehicle)
        self._takeoff: Takeoff | None = None
        self._motion_until_ns: int | None = None
        self._target: GuidedTarget | None = None
        self._limits: FlightLimits | None = None

    def enter(self) -> None:
        """Forget what was asked for before."""
        self._takeoff = self._motion_until_ns = self._target = None
        self._begin(GuidedTarget.VELOCITY)

    def limits(self, limits: FlightLimits) -> FlightLimits:
        """Keep those with which this kind of target began."""
        self._limits = self._limits or limits
        return self._limits

    def take_off(self, alt_rel_m: float) -> bool:
        """Climb to a height above home; False if the vehicle is not standing armed."""
        standing = self.vehicle.armed and self.vehicle.landed and self._takeoff is None
        if not standing or alt_rel_m <= self.vehicle.alt_rel_m:
            return False
        down_m = self.vehicle.depth_of(self.vehicle.home_or_origin.alt_amsl_m + alt_rel_m)
        self._begin(GuidedTarget.TAKEOFF)
        self._takeoff = Takeoff(self.vehicle, down_m)
        return True

    def fly_to(
        self,
        position_ned_m: Vector,
        velocity_ned_mps: Vector | None = None,
        nose: Nose = AS_IT_LIKES,
    ) -> None:
        """Fly to a point and hold there, or, for GUID_TIMEOUT, with one that moves; ignored on the ground."""
        if not self._leave_takeoff():
            return
        self._begin(GuidedTarget.POINT if velocity_ned_mps is None else GuidedTarget.MOVING_POINT)
        north_mps, east_mps, down_mps = velocity_ned_mps or ZERO
        self.vehicle.navigator.go_to(*position_ned_m[:2], (north_mps, east_mps))
        self.vehicle.navigator.go_to_depth(position_ned_m[2], down_mps)
        self._point(nose)

    def fly_velocity(self, velocity_ned_mps: Vector, nose: Nose = AS_IT_LIKES) -> None:
        """Fly a velocity for GUID_TIMEOUT; ignored on the ground."""
        if not self._leave_takeoff():
            return
        self._begin(GuidedTarget.VELOCITY)
        self.vehicle.navigator.fly_velocity(velocity_ned_mps[:2])
        self.vehicle.navigator.fly_sink_rate(velocity_ned_mps[2])
        self._point(nose)

    def stop(self) -> None:
        """Brake and hold."""
        if self._leave_takeoff():
            self.enter()
            self.vehicle.navigator.stop()

    def update(self, step_s: float) -> None:
        """Go on with the takeoff or the target."""
        if self._takeoff is not None:
            if self._takeoff.update(self.vehicle, step_s):
                self._takeoff = None
        else:
            self.vehicle.drive = Drive.IDLE if self.vehicle.landed else Drive.FOLLOW
        if self._motion_until_ns is not None and self.vehicle.sim_time_ns > self._motion_until_ns:
            self._motion_until_ns = None
            self.vehicle.navigator.end_turn()
            if self.vehicle.navigator.point_m is None:
                self.vehicle.navigator.stop()
            else:
                self.vehicle.navigator.halt_point()

    def _begin(self, target: GuidedTarget) -> None:
        if target is not self._target:
            self._target, self._limits = target, None
            self.vehicle.forget_speeds()
            self.vehicle.limits()

    def _point(self, nose: Nose) -> None:
        """Point the nose as asked, or where it flies; turn and move until GUID_TIMEOUT."""
        if nose.yaw_rad is not None:
            self.vehicle.navigator.turn_to(nose.yaw_rad, nose.turn_radps or 0.0)
        elif nose.turn_radps is not None:
            self.vehicle.navigator.turn_at(nose.turn_radps)
        elif self.vehicle.parameters["WP_YAW_BEHAVIOR"] != 0:
            self.vehicle.navigator.look_ahead()
        else:
            self.vehicle.navigator.hold_yaw()
        self._motion_until_ns = self.vehicle.sim_time_ns + round(
            self.vehicle.parameters["GUID_TIMEOUT"] * 1e9
        )

    def _leave_takeoff(self) -> bool:
        """Make room for another target; False while the vehicle stands."""
        if not self.vehicle.armed or self.vehicle.landed:
            return False
        self._takeoff = self._motion_until_ns = None
        self.vehicle.taking_off = False
        return True
