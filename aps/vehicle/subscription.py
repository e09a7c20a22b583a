"""Callbacks with the state, at a rate in the autopilot's own time."""

from __future__ import annotations

from collections.abc import Callable

from aps.callbacks import Callbacks
from aps.vehicle.telemetry import VehicleState


class Subscription:
    """Calls back with the state; ``cancel`` ends it."""

    def __init__(
        self,
        callback: Callable[[VehicleState], None],
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

    def offer(self, state: VehicleState) -> None:
        """Call back if it is due."""
        now_ms = state.time_boot_ms
        if not self.due(now_ms):
            return
        # Keep the grid, so that jitter of the telemetry does not slow the subscription down.
        due_ms = self._next_ms + self._period_ms
        self._next_ms = due_ms if now_ms < due_ms <= now_ms + self._period_ms else now_ms + self._period_ms
        self._callbacks.call("a state callback", self._callback, state)


class Subscriptions:
    """All subscriptions of one daemon, in the order of their beginning."""

    def __init__(self, callbacks: Callbacks) -> None:
        self._callbacks = callbacks
        self.rated = False
        """Whether there is one with a rate."""
        self._all: dict[Subscription, None] = {}
        self._seen_ms = 0

    def __len__(self) -> int:
        return len(self._all)

    def add(self, callback: Callable[[VehicleState], None], rate_hz: float | None) -> Subscription:
        """Begin one; ``rate_hz`` in the autopilot's time, ``None`` for after every batch of telemetry."""
        if rate_hz is not None and not rate_hz > 0.0:
            raise ValueError(f"rate_hz must be positive, not {rate_hz}")
        period_ms = 0.0 if rate_hz is None else 1000.0 / rate_hz
        subscription = Subscription(callback, period_ms, self._remove, self._callbacks)
        self._all[subscription] = None
        self.rated |= subscription.rated
        return subscription

    def _remove(self, subscription: Subscription) -> None:
        self._all.pop(subscription, None)
        self.rated = any(one.rated for one in self._all)

    def due(self, clock_ms: int) -> bool:
        """Whether the autopilot's clock has moved and one with a rate is due.

        To be asked after each message: it keeps them at their rate also when a fast autopilot's bytes come in large
        pieces.
        """
        if clock_ms == self._seen_ms:
            return False
        self._seen_ms = clock_ms
        return any(s.rated and s.due(clock_ms) for s in self._all)

    def offer_due(self, state: VehicleState) -> None:
        """Call back those with a rate that are due."""
        for subscription in [s for s in self._all if s.rated]:
            subscription.offer(state)

    def offer(self, state: VehicleState) -> None:
        """Call back all that are due, and those without a rate."""
        for subscription in list(self._all):
            subscription.offer(state)
