"""Pieces of flight that several modes share: leaving the ground, landing, and the return home."""

from __future__ import annotations

from enum import Enum, auto
from math import hypot, radians

from standin.control.quaternion import wrapped, yaw_of
from standin.vehicle.mode import Drive
from standin.vehicle.vehicle import StandinVehicle

SPOOL_RATE_PER_S = 0.5
SPOOL_START_SHARE = 0.4
"""Share of the hover throttle at which the motors begin to speed up."""
LIFT_OFF_RISE_M = 0.05
LIFT_OFF_SPEED_MPS = 0.1
LIFT_OFF_SMOOTHING_S = 0.1
TAKEOFF_NEAR_M = 0.3
ARRIVED_HEIGHT_M = 0.5
ARRIVED_DISTANCE_M = 1.0
RTL_ALT_MIN_M = 0.3
RTL_CONE_SLOPE_MIN = 0.5
"""A shallower cone is none."""
STOPPING_GAIN_PER_S = 1.0
"""PSC_POSXY_P, by which ArduCopter foresees where it stops."""
HEIGHT_UNREACHED_M = 0.3
YAW_HELD_IN_RTL = (0, 2)
"""WP_YAW_BEHAVIOR: never turn, and do not on the way home."""
ARMED_YAW_NEAR_RAD = radians(2.0)


class Takeoff:
    """Speed the motors up until the vehicle rises, then climb straight up."""

    def __init__(self, vehicle: StandinVehicle, down_m: float) -> None:
        self.down_m = min(down_m, vehicle.position_ned_m[2])
        """Height to reach (never lower than the vehicle is), as metres down from the origin."""
        self._start_ned_m = vehicle.position_ned_m
        self._rise_m = self._climb_mps = 0.0
        self._off_ground = not vehicle.landed
        vehicle.taking_off = True
        if self._off_ground:
            self._climb(vehicle)
        else:
            vehicle.throttle_given = SPOOL_START_SHARE * vehicle.controller.hover_throttle
            vehicle.navigator.restart_yaw(vehicle.frame)
            vehicle.drive = Drive.SPOOL

    def update(self, vehicle: StandinVehicle, step_s: float) -> bool:
        """Go on; return True once the height is reached."""
        if not self._off_ground:
            if not self._rises(vehicle, step_s):
                vehicle.throttle_given = min(1.0, vehicle.throttle_given + SPOOL_RATE_PER_S * step_s)
                return False
            self._off_ground = True
            vehicle.leave_ground()
            self._climb(vehicle)
        done = abs(vehicle.position_ned_m[2] - self.down_m) < TAKEOFF_NEAR_M
        vehicle.taking_off = not done
        return done

    def _rises(self, vehicle: StandinVehicle, step_s: float) -> bool:
        """Judge by the smoothed velocity alone, so that a noisy position is no lift-off and hides none."""
        share = min(1.0, step_s / LIFT_OFF_SMOOTHING_S)
        self._climb_mps += share * (-vehicle.velocity_ned_mps[2] - self._climb_mps)
        self._rise_m = max(0.0, self._rise_m + step_s * self._climb_mps)
        return self._rise_m > LIFT_OFF_RISE_M and self._climb_mps > LIFT_OFF_SPEED_MPS

    def _climb(self, vehicle: StandinVehicle) -> None:
        vehicle.drive = Drive.FOLLOW
        vehicle.navigator.go_to(self._start_ned_m[0], self._start_ned_m[1])
        vehicle.navigator.go_to_depth(self.down_m)


def land(vehicle: StandinVehicle) -> None:
    """Sink where the vehicle is until it finds that it stands: fast above LAND_ALT_LOW, then at LAND_SPEED."""
    vehicle.landing = True
    vehicle.drive = Drive.FOLLOW
    low = vehicle.alt_rel_m <= vehicle.parameters["LAND_ALT_LOW"] / 100
    sink_mps = vehicle.parameters["LAND_SPEED"] / 100 if low else vehicle.limits().sink_mps
    vehicle.navigator.fly_sink_rate(sink_mps)


class ReturnStage(Enum):
    """Where a return home has got to."""

    CLIMB = auto()
    FLY = auto()
    WAIT = auto()
    LAND = auto()


class ReturnSequence:
    """ArduCopter's RTL: climb to the return height, fly home, wait RTL_LOIT_TIME, then land.

    By WP_YAW_BEHAVIOR the nose turns homewards, and at home to where it was at arming.
    """

    def __init__(self, vehicle: StandinVehicle) -> None:
        self.stage = ReturnStage.CLIMB
        self._waited_s = 0.0
        self._down_m = vehicle.depth_of(vehicle.home_or_origin.alt_amsl_m + _return_alt_m(vehicle))
        self._turns = vehicle.parameters["WP_YAW_BEHAVIOR"] not in YAW_HELD_IN_RTL
        vehicle.forget_speeds()
        vehicle.navigator.hold_yaw()
        vehicle.navigator.go_to_depth(self._down_m)

    def update(self, vehicle: StandinVehicle, step_s: float) -> None:
        """Go on with the stage."""
        vehicle.drive = Drive.FOLLOW
        height_off_m = abs(vehicle.position_ned_m[2] - self._down_m)
        if self.stage is ReturnStage.CLIMB and height_off_m < HEIGHT_UNREACHED_M:
            self.stage = ReturnStage.FLY
            vehicle.navigator.go_to(*vehicle.origin.ned_to(vehicle.home_or_origin)[:2])
            if self._turns:
                vehicle.navigator.look_ahead()
        elif self.stage is ReturnStage.FLY:
            if _from_home_m(vehicle) < ARRIVED_DISTANCE_M and height_off_m < ARRIVED_HEIGHT_M:
                self.stage = ReturnStage.WAIT
                vehicle.navigator.turn_to(vehicle.armed_yaw_rad if self._turns else vehicle.navigator.yaw_rad)
        elif self.stage is ReturnStage.WAIT:
            self._waited_s += step_s
            is_over = self._waited_s * 1000 >= vehicle.parameters["RTL_LOIT_TIME"]
            off_rad = abs(wrapped(yaw_of(vehicle.frame.attitude_wxyz) - vehicle.armed_yaw_rad))
            if is_over and (off_rad <= ARMED_YAW_NEAR_RAD or not self._turns):
                self.stage = ReturnStage.LAND
        elif self.stage is ReturnStage.LAND:
            land(vehicle)


def _from_home_m(vehicle: StandinVehicle, more_north_m: float = 0.0, more_east_m: float = 0.0) -> float:
    """Return the distance over ground from home, of the vehicle or of a point so far from it."""
    north_m, east_m, _ = vehicle.origin.ned_to(vehicle.home_or_origin)
    own_north_m, own_east_m, _ = vehicle.position_ned_m
    return hypot(north_m - own_north_m - more_north_m, east_m - own_east_m - more_east_m)


def _return_alt_m(vehicle: StandinVehicle) -> float:
    """Return the height above home: RTL_ALT, less in the cone of RTL_CONE_SLOPE over home, never less than now.

    ArduCopter: ``ModeRTL::compute_return_target``; RTL_CLIMB_MIN is 0. Where it can stop has to be in the cone.
    """
    least_m = max(RTL_ALT_MIN_M, vehicle.alt_rel_m)
    wanted_m = max(vehicle.parameters["RTL_ALT"] / 100, least_m)
    slope = vehicle.parameters["RTL_CONE_SLOPE"]
    if slope < RTL_CONE_SLOPE_MIN:
        return wanted_m
    return min(wanted_m, max(slope * _from_home_m(vehicle, *_stopping_way_m(vehicle)), least_m))


def _stopping_way_m(vehicle: StandinVehicle) -> tuple[float, float]:
    """Return how far north and east the vehicle gets until it stands (``stopping_distance``)."""
    north_mps, east_mps, _ = vehicle.velocity_ned_mps
    speed_mps, accel_mps2 = hypot(north_mps, east_mps), vehicle.limits().horizontal.accel_mps2
    linear_mps = accel_mps2 / STOPPING_GAIN_PER_S
    if speed_mps <= linear_mps:
        stopping_s = 1.0 / STOPPING_GAIN_PER_S
    else:
        stopping_s = (linear_mps * linear_mps + speed_mps * speed_mps) / (2.0 * accel_mps2 * speed_mps)
    return stopping_s * north_mps, stopping_s * east_mps
