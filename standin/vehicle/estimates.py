"""What a ground station shows and no loop needs: the battery's charge and the wind."""

from __future__ import annotations

from math import hypot, sqrt

from standin.wire.sensors import SensedFrame

CELLS = 3
CELL_FULL_V, CELL_EMPTY_V = 4.2, 3.5
IDLE_CURRENT_A = 0.3
MOTOR_CURRENT_MAX_A = 12.0
"""Of one motor at full command; it goes with the command to the power 1.5."""
WIND_FILTER_TIME_S = 5.0
DRAG_MIN_MPS2 = 0.05
TROPOPAUSE_M = 11_000.0


class Battery:
    """Current from the motors' commands, voltage from the charge."""

    def __init__(self) -> None:
        self.used_mah = 0.0
        self.current_a = IDLE_CURRENT_A

    def step(self, commands: tuple[float, ...], step_s: float) -> None:
        """Draw current for ``step_s``."""
        self.current_a = IDLE_CURRENT_A + MOTOR_CURRENT_MAX_A * sum(
            command * command**0.5 for command in commands if command > 0.0
        )
        self.used_mah += self.current_a * step_s / 3.6

    def remaining(self, capacity_mah: float) -> float:
        """Return the share of the charge that is left, 0..1."""
        return max(0.0, 1.0 - self.used_mah / capacity_mah) if capacity_mah > 0.0 else 1.0

    def voltage_v(self, capacity_mah: float) -> float:
        """Return the voltage: linear in the charge."""
        return CELLS * (CELL_EMPTY_V + self.remaining(capacity_mah) * (CELL_FULL_V - CELL_EMPTY_V))


class WindEstimate:
    """Filtered horizontal velocity of the air, north and east, m/s.

    A multirotor's thrust has no component across its own axis, so that the accelerometer's x and y show the
    drag alone, and the air comes from where the drag points. With the airspeed's size this gives the velocity
    through the air; the velocity over ground gives the rest. The air is taken to move neither up nor down.
    """

    def __init__(self) -> None:
        self.north_mps = self.east_mps = 0.0

    def step(self, frame: SensedFrame, alt_amsl_m: float, step_s: float) -> None:
        """Take one frame, of a place of that height."""
        drag_north, drag_east = _level_drag(frame)
        drag_mps2 = hypot(drag_north, drag_east)
        if frame.airspeed_mps is None or drag_mps2 < DRAG_MIN_MPS2:
            return
        true_mps, down_mps = frame.airspeed_mps * true_per_equivalent(alt_amsl_m), frame.velocity_ned_mps[2]
        level_mps = sqrt(max(0.0, true_mps * true_mps - down_mps * down_mps))
        share, blend = level_mps / drag_mps2, min(1.0, step_s / WIND_FILTER_TIME_S)
        self.north_mps += blend * (frame.velocity_ned_mps[0] + share * drag_north - self.north_mps)
        self.east_mps += blend * (frame.velocity_ned_mps[1] + share * drag_east - self.east_mps)


def true_per_equivalent(alt_amsl_m: float) -> float:
    """Return true over equivalent airspeed in the standard atmosphere (ISO 2533), up to its tropopause."""
    return float((1.0 - 2.25577e-5 * min(alt_amsl_m, TROPOPAUSE_M)) ** -2.12794)


def _level_drag(frame: SensedFrame) -> tuple[float, float]:
    """Return the horizontal part of the specific force across the thrust axis, north and east."""
    x, y, _ = frame.specific_force_mps2
    w, qx, qy, qz = frame.attitude_wxyz
    north = (1.0 - 2.0 * (qy * qy + qz * qz)) * x + 2.0 * (qx * qy - w * qz) * y
    east = 2.0 * (qx * qy + w * qz) * x + (1.0 - 2.0 * (qx * qx + qz * qz)) * y
    return north, east
