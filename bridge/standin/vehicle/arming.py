"""The checks before arming, in ArduPilot's words."""

from __future__ import annotations

from math import acos, degrees

from bridge.standin.control.quaternion import thrust_axis_down
from bridge.standin.wire.sensors import SensorFrame

GPS_FIX_AFTER_S = 1.0
"""Sensor time from the first frame to a GPS fix."""
ESTIMATE_AFTER_S = 3.0
"""Sensor time from the first frame to a position estimate: ready to arm from then on."""
LEAN_MAX_DEG = 45.0
"""ArduPilot's ANGLE_MAX rule is coarser than any ground a UA may stand on."""


def prearm_failures(frame: SensorFrame | None, uptime_s: float, attitude_only: bool) -> list[str]:
    """Return why the vehicle is not ready to arm; empty if it is.

    Args:
        frame: the latest sensor frame, None before the first.
        uptime_s: sensor time since the first frame.
        attitude_only: whether the flight mode needs no position.
    """
    if frame is None:
        return ["AHRS: not healthy"]
    if uptime_s < GPS_FIX_AFTER_S:
        return ["GPS 1: Bad fix"]
    if uptime_s < ESTIMATE_AFTER_S and not attitude_only:
        return ["Need Position Estimate"]
    return ["AHRS: waiting for alignment"] if uptime_s < ESTIMATE_AFTER_S else []


def arm_failures(frame: SensorFrame, mode_name: str, mode_armable: bool, throttle_low: bool) -> list[str]:
    """Return what forbids arming just now though the vehicle is ready; empty if nothing does."""
    failures = []
    if not mode_armable:
        failures.append(f"{mode_name} mode not armable")
    tilt_deg = degrees(acos(max(-1.0, min(1.0, thrust_axis_down(frame.attitude_wxyz)))))
    if tilt_deg > LEAN_MAX_DEG:
        failures.append("Leaning")
    if not throttle_low:
        failures.append("Throttle too high")
    return failures
