"""An estimate of the wind from what a multirotor senses: its drag and its airspeed.

A multirotor's thrust has no component across its own axis, so that the accelerometer's x and y show the drag
alone: the air comes from where the drag points. With the airspeed's size this gives the velocity through the
air, and the velocity over ground gives the rest. Physics that states the wind (``velocity_wind``) is
believed.
"""

from __future__ import annotations

from math import hypot

from bridge.standin.wire.sensors import SensorFrame

FILTER_TIME_S = 5.0
DRAG_MIN_MPS2 = 0.05


class WindEstimate:
    """Filtered horizontal velocity of the air, north and east, m/s."""

    def __init__(self) -> None:
        self.north_mps = self.east_mps = 0.0

    def step(self, frame: SensorFrame, step_s: float) -> None:
        """Take one frame."""
        measured = self._measured(frame)
        if measured is not None:
            blend = min(1.0, step_s / FILTER_TIME_S)
            self.north_mps += blend * (measured[0] - self.north_mps)
            self.east_mps += blend * (measured[1] - self.east_mps)

    def _measured(self, frame: SensorFrame) -> tuple[float, float] | None:
        if frame.wind_ned_mps is not None:
            return frame.wind_ned_mps[:2]
        if frame.airspeed_mps is None:
            return None
        drag_north, drag_east = _level_drag(frame)
        drag_mps2 = hypot(drag_north, drag_east)
        if drag_mps2 < DRAG_MIN_MPS2:
            return None
        share = frame.airspeed_mps / drag_mps2
        return (
            frame.velocity_ned_mps[0] + share * drag_north,
            frame.velocity_ned_mps[1] + share * drag_east,
        )


def _level_drag(frame: SensorFrame) -> tuple[float, float]:
    """Return the horizontal part of the specific force across the thrust axis, north and east."""
    x, y, _ = frame.specific_force_mps2
    w, qx, qy, qz = frame.attitude_wxyz
    north = (1.0 - 2.0 * (qy * qy + qz * qz)) * x + 2.0 * (qx * qy - w * qz) * y
    east = 2.0 * (qx * qy + w * qz) * x + (1.0 - 2.0 * (qx * qx + qz * qz)) * y
    return north, east
