"""Callbacks with the state, at a rate in the autopilot's own time."""

from __future__ import annotations

from collections.abc import Callable

from aps.callbacks import Callbacks
from aps.telemetry import AircraftState

__all__ = ["Subscription"]


class Subscription:
    """Calls back with the state; ``cancel`` ends it."""

    def __init__(
        self,
        callback: Callable[[AircraftState], None],
        period_ms: float,
        on_cancel: Callable[[Subscription], None],
        callbacks: Callbacks,
    ) -> None:
        self._callback, self._period_ms, self._on_cancel = callback, period_ms, on_cancel
        self._callbacks = callbacks
        self._next_ms = 0.0

    def cancel(self) -> None:
        """Stop calling back."""
        self._on_cancel(self)

    @property
    def rated(self) -> bool:
        """Whether it has a rate; else it is called after every batch of telemetry."""
        return self._period_ms > 0.0

    def due(self, now_ms: int) -> bool:
        """Whether the period has passed in the autopilot's time (or that time has gone back)."""
        return not now_ms < self._next_ms <= now_ms + 2 * self._period_ms

    def offer(self, state: AircraftState) -> None:
        """Call back if it is due."""
        now_ms = state.time_boot_ms
        if not self.due(now_ms):
            return
        # Keep the grid, so that jitter of the telemetry does not slow the subscription down.
        due_ms = self._next_ms + self._period_ms
        self._next_ms = due_ms if now_ms < due_ms <= now_ms + self._period_ms else now_ms + self._period_ms
        self._callbacks.call("a state callback", self._callback, state)
