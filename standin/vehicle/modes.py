"""The flight modes, with ArduCopter's numbers: each says when it may be entered, and flies the vehicle.

A mode is made anew each time it is entered. ``update`` runs at 100 Hz while the vehicle is armed.
"""

from __future__ import annotations

from enum import Enum, IntEnum, auto
from typing import TYPE_CHECKING, NamedTuple

from standin.control.navigator import FlightLimits
from standin.control.profile import Limits
from standin.control.quaternion import Vector
from standin.vehicle.maneuvers import Drive, ReturnSequence, Takeoff, land
from standin.vehicle.mission import SpeedKind

if TYPE_CHECKING:
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


class ModeNumber(IntEnum):
    """ArduCopter's custom_mode."""

    STABILIZE = 0
    AUTO = 3
    GUIDED = 4
    LOITER = 5
    RTL = 6
    LAND = 9
    BRAKE = 17


class FlightMode:
    """What all modes have; a mode of its own overrides what differs."""

    number: ModeNumber
    armable = True
    needs_mission = False
    guided_flag = True
    """Whether the heartbeat carries MAV_MODE_FLAG_GUIDED_ENABLED."""
    only_one_of: frozenset[SpeedKind] = frozenset()
    """Speeds that may be asked for of which each ends the others."""

    @property
    def name(self) -> str:
        """ArduCopter's name of the mode."""
        return self.number.name

    def refusal(self, vehicle: StandinVehicle) -> str:
        """Return why an armed vehicle cannot enter the mode now; empty if it can."""
        if self.needs_mission and len(vehicle.mission) < 2:
            return "no mission"
        return vehicle.position_failure()

    def enter(self, vehicle: StandinVehicle) -> None:
        """Begin: the navigator has just been commanded to stop where the vehicle is."""

    def limits(self, limits: FlightLimits) -> FlightLimits:
        """Return the limits that it flies with, from those of the parameters."""
        return limits

    def update(self, vehicle: StandinVehicle, step_s: float) -> None:
        """Decide the drive and the target; ``step_s`` since the last call."""
        raise NotImplementedError

    def touched_ground(self, vehicle: StandinVehicle) -> None:
        """The vehicle was found standing; its motors are idle now."""


class Stabilize(FlightMode):
    """The mode at boot. There is no pilot: the motors idle, and no flying vehicle may enter it."""

    number = ModeNumber.STABILIZE
    guided_flag = False

    def refusal(self, vehicle: StandinVehicle) -> str:
        """A pilot's mode, and there is none."""
        return "" if vehicle.landed else "no RC"

    def update(self, vehicle: StandinVehicle, _step_s: float) -> None:
        """Stand."""
        vehicle.drive = Drive.IDLE


class Brake(FlightMode):
    """Stop, and hold where that ends."""

    number = ModeNumber.BRAKE
    armable = False

    def limits(self, limits: FlightLimits) -> FlightLimits:
        """Brake as ArduCopter, whatever the parameters of way points say."""
        horizontal = Limits(limits.horizontal.speed_mps, BRAKE_ACCEL_MPS2, BRAKE_JERK_MPS3)
        vertical = Limits(limits.vertical.speed_mps, BRAKE_ACCEL_MPS2, BRAKE_JERK_MPS3)
        return FlightLimits(horizontal, vertical, limits.climb_mps, limits.sink_mps)

    def update(self, vehicle: StandinVehicle, _step_s: float) -> None:
        """Hold what the navigator was given when the mode began."""
        vehicle.drive = Drive.IDLE if vehicle.landed else Drive.FOLLOW


class Loiter(FlightMode):
    """Hold position; climb and sink by the throttle stick, which lies at zero unless a client holds it elsewhere."""

    number = ModeNumber.LOITER

    def update(self, vehicle: StandinVehicle, _step_s: float) -> None:
        """Hold the position, and follow the stick."""
        vehicle.drive = Drive.IDLE if vehicle.landed else Drive.FOLLOW
        vehicle.navigator.fly_sink_rate(-vehicle.sticks.climb_mps(vehicle.sim_time_ns))


class Land(FlightMode):
    """Come down here and disarm."""

    number = ModeNumber.LAND
    armable = False

    def update(self, vehicle: StandinVehicle, _step_s: float) -> None:
        """Sink."""
        if vehicle.landed:
            vehicle.disarm(force=False)
        else:
            land(vehicle)

    def touched_ground(self, vehicle: StandinVehicle) -> None:
        """Disarm."""
        vehicle.disarm(force=False)


class ReturnToLaunch(FlightMode):
    """Climb, fly home, wait, and land."""

    number = ModeNumber.RTL
    armable = False

    def __init__(self) -> None:
        self._sequence: ReturnSequence | None = None

    def enter(self, vehicle: StandinVehicle) -> None:
        """Plan the height of the return."""
        self._sequence = ReturnSequence(vehicle)

    def update(self, vehicle: StandinVehicle, step_s: float) -> None:
        """Go on with the return."""
        if vehicle.landed or self._sequence is None:
            vehicle.disarm(force=False)
        else:
            self._sequence.update(vehicle, step_s)

    def touched_ground(self, vehicle: StandinVehicle) -> None:
        """Disarm."""
        vehicle.disarm(force=False)


class Guided(FlightMode):
    """Takeoff, a point to fly to, or a velocity (motions end after GUID_TIMEOUT).

    Speeds and accelerations are those of the parameters when the present kind of target began, and a speed that was
    asked for ends with that kind (``ModeGuided::pva_control_start``). They do not limit a velocity that is asked for.
    """

    number = ModeNumber.GUIDED
    only_one_of = frozenset({SpeedKind.CLIMB, SpeedKind.DESCENT})  # ModeGuided::set_speed_up_cms

    def __init__(self) -> None:
        self._takeoff: Takeoff | None = None
        self._motion_until_ns: int | None = None
        self._target: GuidedTarget | None = None
        self._limits: FlightLimits | None = None

    def enter(self, vehicle: StandinVehicle) -> None:
        """Forget what was asked for before."""
        self._takeoff = self._motion_until_ns = self._target = None
        self._begin(vehicle, GuidedTarget.VELOCITY)

    def limits(self, limits: FlightLimits) -> FlightLimits:
        """Keep those with which this kind of target began."""
        self._limits = self._limits or limits
        return self._limits

    def take_off(self, vehicle: StandinVehicle, alt_rel_m: float) -> bool:
        """Climb to a height above home; False if the vehicle is not standing armed."""
        standing = vehicle.armed and vehicle.landed and self._takeoff is None
        if not standing or alt_rel_m <= vehicle.alt_rel_m:
            return False
        down_m = vehicle.depth_of(vehicle.home_or_origin.alt_amsl_m + alt_rel_m)
        self._begin(vehicle, GuidedTarget.TAKEOFF)
        self._takeoff = Takeoff(vehicle, down_m)
        return True

    def fly_to(
        self,
        vehicle: StandinVehicle,
        position_ned_m: Vector,
        velocity_ned_mps: Vector | None = None,
        nose: Nose = AS_IT_LIKES,
    ) -> None:
        """Fly to a point and hold there, or, for GUID_TIMEOUT, with one that moves; ignored on the ground."""
        if not self._leave_takeoff(vehicle):
            return
        self._begin(vehicle, GuidedTarget.POINT if velocity_ned_mps is None else GuidedTarget.MOVING_POINT)
        north_mps, east_mps, down_mps = velocity_ned_mps or ZERO
        vehicle.navigator.go_to(*position_ned_m[:2], (north_mps, east_mps))
        vehicle.navigator.go_to_depth(position_ned_m[2], down_mps)
        self._point(vehicle, nose)

    def fly_velocity(
        self, vehicle: StandinVehicle, velocity_ned_mps: Vector, nose: Nose = AS_IT_LIKES
    ) -> None:
        """Fly a velocity for GUID_TIMEOUT; ignored on the ground."""
        if not self._leave_takeoff(vehicle):
            return
        self._begin(vehicle, GuidedTarget.VELOCITY)
        vehicle.navigator.fly_velocity(velocity_ned_mps[:2])
        vehicle.navigator.fly_sink_rate(velocity_ned_mps[2])
        self._point(vehicle, nose)

    def stop(self, vehicle: StandinVehicle) -> None:
        """Brake and hold."""
        if self._leave_takeoff(vehicle):
            self.enter(vehicle)
            vehicle.navigator.stop()

    def update(self, vehicle: StandinVehicle, step_s: float) -> None:
        """Go on with the takeoff or the target."""
        if self._takeoff is not None:
            if self._takeoff.update(vehicle, step_s):
                self._takeoff = None
        else:
            vehicle.drive = Drive.IDLE if vehicle.landed else Drive.FOLLOW
        if self._motion_until_ns is not None and vehicle.sim_time_ns > self._motion_until_ns:
            self._motion_until_ns = None
            vehicle.navigator.end_turn()
            if vehicle.navigator.point_m is None:
                vehicle.navigator.stop()
            else:
                vehicle.navigator.halt_point()

    def _begin(self, vehicle: StandinVehicle, target: GuidedTarget) -> None:
        if target is not self._target:
            self._target, self._limits = target, None
            vehicle.forget_speeds()
            vehicle.limits()

    def _point(self, vehicle: StandinVehicle, nose: Nose) -> None:
        """Point the nose as asked, or where it flies; turn and move until GUID_TIMEOUT."""
        if nose.yaw_rad is not None:
            vehicle.navigator.turn_to(nose.yaw_rad, nose.turn_radps or 0.0)
        elif nose.turn_radps is not None:
            vehicle.navigator.turn_at(nose.turn_radps)
        elif vehicle.parameters["WP_YAW_BEHAVIOR"] != 0:
            vehicle.navigator.look_ahead()
        else:
            vehicle.navigator.hold_yaw()
        self._motion_until_ns = vehicle.sim_time_ns + round(vehicle.parameters["GUID_TIMEOUT"] * 1e9)

    def _leave_takeoff(self, vehicle: StandinVehicle) -> bool:
        """Make room for another target; False while the vehicle stands."""
        if not vehicle.armed or vehicle.landed:
            return False
        self._takeoff = self._motion_until_ns = None
        vehicle.taking_off = False
        return True
