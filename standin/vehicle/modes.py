"""The flight modes, with ArduCopter's numbers: each says when it may be entered, and flies the vehicle.

A mode is made anew each time it is entered. ``update`` runs at 100 Hz while the vehicle is armed.
"""

from __future__ import annotations

from enum import IntEnum
from typing import TYPE_CHECKING, NamedTuple

from standin.control.navigator import FlightLimits
from standin.control.profile import Limits
from standin.control.quaternion import Vector
from standin.vehicle.maneuvers import Drive, ReturnSequence, Takeoff, land

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
    """Takeoff, a point to fly to, or a velocity (which ends after GUID_TIMEOUT)."""

    number = ModeNumber.GUIDED

    def __init__(self) -> None:
        self._takeoff: Takeoff | None = None
        self._velocity_until_ns: int | None = None

    def enter(self, _vehicle: StandinVehicle) -> None:
        """Forget what was asked for before."""
        self._takeoff = self._velocity_until_ns = None

    def take_off(self, vehicle: StandinVehicle, alt_rel_m: float) -> bool:
        """Climb to a height above home; False if the vehicle is not standing armed."""
        standing = vehicle.armed and vehicle.landed and self._takeoff is None
        if not standing or alt_rel_m <= vehicle.alt_rel_m:
            return False
        down_m = vehicle.depth_of(vehicle.home_or_origin.alt_amsl_m + alt_rel_m)
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
        vehicle.navigator.go_to(*position_ned_m[:2], (velocity_ned_mps or ZERO)[:2])
        vehicle.navigator.go_to_depth(position_ned_m[2])
        if velocity_ned_mps is not None:
            self._velocity_until_ns = self._timeout_ns(vehicle)
        if not self._point(vehicle, nose) and vehicle.parameters["WP_YAW_BEHAVIOR"] != 0:
            vehicle.navigator.look_ahead()

    def fly_velocity(
        self, vehicle: StandinVehicle, velocity_ned_mps: Vector, nose: Nose = AS_IT_LIKES
    ) -> None:
        """Fly a velocity for GUID_TIMEOUT; ignored on the ground."""
        if not self._leave_takeoff(vehicle):
            return
        limits = vehicle.limits()
        vehicle.navigator.fly_velocity(velocity_ned_mps[:2])
        vehicle.navigator.fly_sink_rate(max(-limits.climb_mps, min(limits.sink_mps, velocity_ned_mps[2])))
        if not self._point(vehicle, nose):
            vehicle.navigator.hold_yaw()
        self._velocity_until_ns = self._timeout_ns(vehicle)

    def stop(self, vehicle: StandinVehicle) -> None:
        """Brake and hold."""
        if self._leave_takeoff(vehicle):
            vehicle.navigator.stop()

    def update(self, vehicle: StandinVehicle, step_s: float) -> None:
        """Go on with the takeoff or the target."""
        if self._takeoff is not None:
            if self._takeoff.update(vehicle, step_s):
                self._takeoff = None
        else:
            vehicle.drive = Drive.IDLE if vehicle.landed else Drive.FOLLOW
        if self._velocity_until_ns is not None and vehicle.sim_time_ns > self._velocity_until_ns:
            self._velocity_until_ns = None
            vehicle.navigator.end_turn()
            if vehicle.navigator.point_m is None:
                vehicle.navigator.stop()
            else:
                vehicle.navigator.halt_point()

    @staticmethod
    def _point(vehicle: StandinVehicle, nose: Nose) -> bool:
        """Point the nose as asked; False if nothing was asked."""
        if nose.yaw_rad is not None:
            vehicle.navigator.turn_to(nose.yaw_rad)
        elif nose.turn_radps is not None:
            vehicle.navigator.turn_at(nose.turn_radps)
        return nose != AS_IT_LIKES

    @staticmethod
    def _timeout_ns(vehicle: StandinVehicle) -> int:
        return vehicle.sim_time_ns + round(vehicle.parameters["GUID_TIMEOUT"] * 1e9)

    def _leave_takeoff(self, vehicle: StandinVehicle) -> bool:
        """Make room for another target; False while the vehicle stands."""
        if not vehicle.armed or vehicle.landed:
            return False
        self._takeoff = self._velocity_until_ns = None
        vehicle.taking_off = False
        return True
