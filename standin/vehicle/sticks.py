"""The throttle stick: there is no receiver, so it lies at zero unless a client holds it elsewhere for a moment."""

from __future__ import annotations

OVERRIDE_S = 3.0
"""RC_OVERRIDE_TIME: how long a client's word holds."""
PILOT_SPEED_MPS = 2.5
"""PILOT_SPEED_UP, and down: of the stick at either end."""
MIDDLE, DEADZONE = 0.5, 0.1
LOW = 0.03
"""RC3_DZ: what is taken for zero throttle."""


class Sticks:
    """Where the throttle stick is, 0 to 1."""

    def __init__(self) -> None:
        self._throttle = 0.0
        self._until_ns = 0

    def hold(self, throttle: float, now_ns: int) -> None:
        """A client puts the stick somewhere; it has to say so again and again."""
        self._throttle = max(0.0, min(1.0, throttle))
        self._until_ns = now_ns + round(OVERRIDE_S * 1e9)

    def release(self) -> None:
        """A client lets go."""
        self._until_ns = 0

    def low(self, now_ns: int) -> bool:
        """Whether the stick is at zero."""
        return self._at(now_ns) <= LOW

    def climb_mps(self, now_ns: int) -> float:
        """The climb rate that the stick asks for: none around the middle, sinking at zero."""
        off = self._at(now_ns) - MIDDLE
        beyond = max(0.0, abs(off) - DEADZONE) / (MIDDLE - DEADZONE)
        return PILOT_SPEED_MPS * (beyond if off > 0.0 else -beyond)

    def _at(self, now_ns: int) -> float:
        return self._throttle if now_ns < self._until_ns else 0.0
