"""Where to fly: the target of the moment, and the limited references that lead there."""

from __future__ import annotations

from dataclasses import dataclass
from math import atan2, hypot

from standin.control.profile import HorizontalProfile, Limits, VerticalProfile
from standin.control.quaternion import Vector, wrapped, yaw_of
from standin.wire.sensors import SensedFrame

YAW_RATE_MAX_RADPS = 1.05
"""ATC_SLEW_YAW's default, 60 degrees per second."""
YAW_ACCEL_MAX_RADPS2 = 2.0
YAW_GAIN_PER_S = 1.5
LOOK_AHEAD_SHARE = 0.05
"""Of the speed limit: a slower reference turns no nose (``AC_PosControl::calculate_yaw_and_rate_yaw``)."""
REFERENCE_LAG_MAX_M = 8.0


@dataclass(frozen=True, slots=True)
class FlightLimits:
    """Speeds and accelerations of the references, from the parameters."""

    horizontal: Limits
    vertical: Limits
    climb_mps: float
    sink_mps: float


class Navigator:
    """Holds one target (point or velocity, horizontal and vertical apart) and moves the references."""

    def __init__(self) -> None:
        self.horizontal = HorizontalProfile()
        self.vertical = VerticalProfile()
        self.yaw_rad = 0.0
        self.yaw_rate_radps = 0.0
        self.point_m: tuple[float, float] | None = None
        """North and east of the target, or None when a velocity is flown."""
        self.point_mps = (0.0, 0.0)
        """Velocity of that target, north and east."""
        self.depth_m: float | None = None
        """Down of the target, or None when a climb rate is flown."""
        self.depth_mps = 0.0
        """Velocity of that target, down."""
        self.velocity_mps = (0.0, 0.0)
        """North and east wanted."""
        self.sink_mps = 0.0
        self.yaw_target_rad = 0.0
        """Where the nose is turning to."""
        self._turn_radps = self._target_radps = 0.0
        self._look_ahead = False

    def start(self, frame: SensedFrame) -> None:
        """Begin where the vehicle is, with its velocity, and hold its yaw; the target is to stop."""
        self.restart_horizontal(frame)
        self.restart_vertical(frame)
        self.restart_yaw(frame)
        self.stop()

    def restart_horizontal(self, frame: SensedFrame) -> None:
        """Put the horizontal reference where the vehicle is, with its velocity."""
        self.horizontal.reset(*frame.position_ned_m[:2], *frame.velocity_ned_mps[:2])

    def restart_vertical(self, frame: SensedFrame) -> None:
        """Put the vertical reference where the vehicle is, with its velocity."""
        self.vertical.reset(frame.position_ned_m[2], frame.velocity_ned_mps[2])

    def restart_yaw(self, frame: SensedFrame) -> None:
        """Hold the vehicle's present yaw."""
        self.yaw_rad = yaw_of(frame.attitude_wxyz)
        self.yaw_rate_radps = 0.0
        self.hold_yaw()

    def stop(self) -> None:
        """Brake and hold where that ends."""
        self.fly_velocity((0.0, 0.0))
        self.fly_sink_rate(0.0)

    def go_to(self, north_m: float, east_m: float, point_mps: tuple[float, float] = (0.0, 0.0)) -> None:
        """Fly to a point, horizontally, and with it if it moves."""
        self.point_m, self.point_mps = (north_m, east_m), point_mps

    def go_to_depth(self, down_m: float, down_mps: float = 0.0) -> None:
        """Climb or sink to a height, given as metres down from the origin, and with it if it moves."""
        self.depth_m, self.depth_mps = down_m, down_mps

    def fly_velocity(self, velocity_mps: tuple[float, float]) -> None:
        """Fly a horizontal velocity, north and east."""
        self.point_m = None
        self.velocity_mps = velocity_mps

    def fly_sink_rate(self, sink_mps: float) -> None:
        """Climb (negative) or sink at a rate."""
        self.depth_m = None
        self.sink_mps = sink_mps

    def halt_point(self) -> None:
        """Let the target point stand where it is now."""
        self.point_mps, self.depth_mps = (0.0, 0.0), 0.0

    def hold_yaw(self) -> None:
        """Stop turning."""
        self.turn_to(self.yaw_rad)

    def turn_to(self, yaw_rad: float, target_radps: float = 0.0) -> None:
        """Turn to a yaw and keep it, or go on with one that turns at a rate."""
        self.yaw_target_rad, self._target_radps = yaw_rad, target_radps
        self._turn_radps, self._look_ahead = 0.0, False

    def turn_at(self, turn_radps: float) -> None:
        """Turn on and on."""
        self._turn_radps, self._target_radps, self._look_ahead = turn_radps, 0.0, False

    def end_turn(self) -> None:
        """Stop turning on, if that is what it does."""
        if self._turn_radps or self._target_radps:
            self.hold_yaw()

    def look_ahead(self) -> None:
        """Turn to where it flies whenever it is fast enough."""
        self.hold_yaw()
        self._look_ahead = True

    def step(self, frame: SensedFrame, limits: FlightLimits, step_s: float) -> None:
        """Move the references on by ``step_s``."""
        if self.point_m is None:
            self.horizontal.step_to_velocity(self.velocity_mps, limits.horizontal, step_s)
        else:
            (north_m, east_m), (north_mps, east_mps) = self.point_m, self.point_mps
            self.point_m = (north_m + north_mps * step_s, east_m + east_mps * step_s)
            self.horizontal.step_to_position(self.point_m, limits.horizontal, step_s, self.point_mps)
        if self.depth_m is None:
            self.vertical.step_to_velocity(self.sink_mps, limits.vertical, step_s)
        else:
            self.depth_m += self.depth_mps * step_s
            self.vertical.step_to_position(
                self.depth_m, limits.climb_mps, limits.sink_mps, limits.vertical, step_s, self.depth_mps
            )
        self._keep_near(frame)
        self._step_yaw(limits, step_s)

    def distance_m(self, frame: SensedFrame) -> float:
        """Return the horizontal distance from the vehicle to the target point (0 without one)."""
        if self.point_m is None:
            return 0.0
        return hypot(self.point_m[0] - frame.position_ned_m[0], self.point_m[1] - frame.position_ned_m[1])

    def bearing_rad(self, frame: SensedFrame) -> float:
        """Return the direction from the vehicle to the target point (the reference's yaw without one)."""
        if self.point_m is None:
            return self.yaw_rad
        return atan2(self.point_m[1] - frame.position_ned_m[1], self.point_m[0] - frame.position_ned_m[0])

    def target_ned_m(self) -> Vector:
        """Return the target, with the reference's own position where a velocity is flown."""
        north_m, east_m = self.point_m or (self.horizontal.north_m, self.horizontal.east_m)
        return (north_m, east_m, self.vertical.down_m if self.depth_m is None else self.depth_m)

    def _keep_near(self, frame: SensedFrame) -> None:
        """Do not let the reference run away from a vehicle that cannot follow (wind, tilt limit)."""
        north_m, east_m, _ = frame.position_ned_m
        ahead_north, ahead_east = self.horizontal.north_m - north_m, self.horizontal.east_m - east_m
        lag_m = hypot(ahead_north, ahead_east)
        if lag_m > REFERENCE_LAG_MAX_M:
            share = REFERENCE_LAG_MAX_M / lag_m
            self.horizontal.north_m = north_m + share * ahead_north
            self.horizontal.east_m = east_m + share * ahead_east

    def _step_yaw(self, limits: FlightLimits, step_s: float) -> None:
        north_mps, east_mps = self.horizontal.north_mps, self.horizontal.east_mps
        if self._look_ahead and hypot(north_mps, east_mps) > LOOK_AHEAD_SHARE * limits.horizontal.speed_mps:
            self.yaw_target_rad = atan2(east_mps, north_mps)
        if self._turn_radps:
            self.yaw_target_rad = self.yaw_rad + self._turn_radps / YAW_GAIN_PER_S
        self.yaw_target_rad += self._target_radps * step_s
        wanted = YAW_GAIN_PER_S * wrapped(self.yaw_target_rad - self.yaw_rad) + self._target_radps
        wanted = max(-YAW_RATE_MAX_RADPS, min(YAW_RATE_MAX_RADPS, wanted))
        most = YAW_ACCEL_MAX_RADPS2 * step_s
        self.yaw_rate_radps += max(-most, min(most, wanted - self.yaw_rate_radps))
        self.yaw_rad = wrapped(self.yaw_rad + step_s * self.yaw_rate_radps)
