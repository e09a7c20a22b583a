"""GUIDED: fly what the ground asks for, one target at a time."""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, sin
from typing import TYPE_CHECKING

from bridge.standin.vehicle.flight_modes import FlightMode, ModeNumber
from bridge.standin.vehicle.maneuvers import Drive, Takeoff

if TYPE_CHECKING:
    from bridge.standin.vehicle.vehicle import Vehicle

DEFAULT_TIMEOUT_S = 3.0


@dataclass(frozen=True, slots=True)
class GuidedTarget:
    """What to fly: a point, a velocity, or a point that moves. NED from the origin, m and m/s.

    ``position_ned_m`` None: the velocity alone; ``velocity_ned_mps`` None: the point alone.
    Yaw: ``yaw_rad``, else ``yaw_rate_radps``, else towards the point.
    """

    position_ned_m: tuple[float, float, float] | None
    velocity_ned_mps: tuple[float, float, float] | None = None
    yaw_rad: float | None = None
    yaw_rate_radps: float | None = None


class Guided(FlightMode):
    """Takeoff, position targets, velocity targets (which end after GUID_TIMEOUT)."""

    number = ModeNumber.GUIDED

    def __init__(self) -> None:
        self._takeoff: Takeoff | None = None
        self._velocity_until_ns: int | None = None
        self.target: GuidedTarget | None = None

    def enter(self, _vehicle: Vehicle) -> None:
        """Forget what was asked for before."""
        self._takeoff = None
        self._velocity_until_ns = None
        self.target = None

    def take_off(self, vehicle: Vehicle, alt_rel_m: float) -> bool:
        """Climb to a height above home; False if the vehicle is not standing armed."""
        if (
            not vehicle.armed
            or not vehicle.landed
            or self._takeoff is not None
            or alt_rel_m <= vehicle.alt_rel_m
        ):
            return False
        down_m = vehicle.depth_of(vehicle.home_or_origin.alt_amsl_m + alt_rel_m)
        self.target = None
        self._takeoff = Takeoff(vehicle, down_m)
        return True

    def fly(self, vehicle: Vehicle, target: GuidedTarget) -> bool:
        """Take a target; False (and nothing changes) while the vehicle stands or leaves the ground."""
        if not vehicle.armed or vehicle.landed:
            return False
        self._takeoff = None
        vehicle.taking_off = False
        self.target = target
        self._set_horizontal(vehicle, target)
        self._set_yaw(vehicle, target)
        return True

    def update(self, vehicle: Vehicle, step_s: float) -> None:
        """Go on with the takeoff or the target."""
        if self._takeoff is not None:
            if self._takeoff.update(vehicle, step_s):
                self._takeoff = None
        else:
            vehicle.drive = Drive.IDLE if vehicle.landed else Drive.FOLLOW
        if self._velocity_until_ns is not None and vehicle.sim_time_ns > self._velocity_until_ns:
            self._end_velocity(vehicle)

    def _set_horizontal(self, vehicle: Vehicle, target: GuidedTarget) -> None:
        navigator = vehicle.navigator
        velocity = target.velocity_ned_mps or (0.0, 0.0, 0.0)
        self._velocity_until_ns = None
        if target.velocity_ned_mps is not None:
            timeout_s = vehicle.parameters["GUID_TIMEOUT"] or DEFAULT_TIMEOUT_S
            self._velocity_until_ns = vehicle.sim_time_ns + round(timeout_s * 1e9)
        if target.position_ned_m is None:
            navigator.fly_velocity(velocity[:2])
            navigator.fly_sink_rate(self._limited_sink(vehicle, velocity[2]))
        else:
            navigator.go_to(*target.position_ned_m[:2], moving_mps=velocity[:2])
            navigator.go_to_depth(target.position_ned_m[2])

    def _set_yaw(self, vehicle: Vehicle, target: GuidedTarget) -> None:
        if target.yaw_rad is not None:
            vehicle.navigator.turn_to(target.yaw_rad)
        elif target.yaw_rate_radps is not None:
            vehicle.navigator.turn_at(target.yaw_rate_radps)
        elif target.position_ned_m is not None and vehicle.parameters["WP_YAW_BEHAVIOR"] != 0:
            vehicle.navigator.look_ahead()
        else:
            vehicle.navigator.hold_yaw()

    def _end_velocity(self, vehicle: Vehicle) -> None:
        self._velocity_until_ns = None
        navigator = vehicle.navigator
        if navigator.point_m is None:
            navigator.stop()
        else:
            navigator.go_to(*navigator.point_m)
        navigator.hold_yaw()

    @staticmethod
    def _limited_sink(vehicle: Vehicle, sink_mps: float) -> float:
        limits = vehicle.limits()
        return max(-limits.climb_mps, min(limits.sink_mps, sink_mps))


def ned_from_body(forward: float, right: float, yaw_rad: float) -> tuple[float, float]:
    """Turn a horizontal vector in the heading's frame to north and east."""
    c, s = cos(yaw_rad), sin(yaw_rad)
    return c * forward - s * right, s * forward + c * right
