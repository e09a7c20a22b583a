"""The pilot's sticks: RC_CHANNELS_OVERRIDE or nothing (there is no receiver)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

CHANNELS = 8
IGNORE_US = 65535
TRIM_US, RANGE_US = 1500, 400
THROTTLE_LOW_US, THROTTLE_HIGH_US = 1100, 1900


@dataclass(frozen=True, slots=True)
class Sticks:
    """Roll, pitch (positive = stick back = nose up), yaw in -1..1, throttle in 0..1."""

    roll: float
    pitch: float
    throttle: float
    yaw: float


class RcInput:
    """The channels last overridden and when."""

    def __init__(self) -> None:
        self.channels_us = [0] * CHANNELS
        self._until_ns = 0

    def override(self, channels_us: Sequence[int], sim_time_ns: int, lasting_s: float) -> None:
        """Take an override: 0 releases a channel, 65535 leaves it."""
        for index, value in enumerate(channels_us[:CHANNELS]):
            if value != IGNORE_US:
                self.channels_us[index] = value
        self._until_ns = sim_time_ns + round(lasting_s * 1e9)

    def sticks(self, sim_time_ns: int) -> Sticks | None:
        """Return the sticks, or None if there is no override in force."""
        roll, pitch, throttle, yaw = self.channels_us[:4]
        if sim_time_ns >= self._until_ns or not any((roll, pitch, throttle, yaw)):
            return None
        span = THROTTLE_HIGH_US - THROTTLE_LOW_US
        low = (throttle - THROTTLE_LOW_US) / span if throttle else 0.0
        return Sticks(_centred(roll), _centred(pitch), max(0.0, min(1.0, low)), _centred(yaw))


def _centred(value_us: int) -> float:
    if value_us == 0:
        return 0.0
    return max(-1.0, min(1.0, (value_us - TRIM_US) / RANGE_US))
