"""A simple battery: current from the motors' commands, voltage from its charge and internal resistance."""

from __future__ import annotations

CELLS = 3
CELL_FULL_V, CELL_EMPTY_V = 4.2, 3.5
RESISTANCE_OHM = 0.02
IDLE_CURRENT_A = 0.3
MOTOR_CURRENT_MAX_A = 12.0
"""Current of one motor at full command; it goes with the command to the power 1.5."""


class Battery:
    """State: the charge used, mAh."""

    def __init__(self) -> None:
        self.used_mah = 0.0
        self.current_a = IDLE_CURRENT_A
        self.voltage_v = CELLS * CELL_FULL_V

    def step(self, commands: tuple[float, ...], capacity_mah: float, step_s: float) -> None:
        """Draw current for ``step_s``."""
        self.current_a = IDLE_CURRENT_A + MOTOR_CURRENT_MAX_A * sum(
            command * command**0.5 for command in commands if command > 0.0
        )
        self.used_mah += self.current_a * step_s / 3.6
        left = self.remaining(capacity_mah)
        open_v = CELLS * (CELL_EMPTY_V + left * (CELL_FULL_V - CELL_EMPTY_V))
        self.voltage_v = open_v - RESISTANCE_OHM * self.current_a

    def remaining(self, capacity_mah: float) -> float:
        """Return the share of the charge that is left, 0..1."""
        return max(0.0, 1.0 - self.used_mah / capacity_mah) if capacity_mah > 0.0 else 1.0
