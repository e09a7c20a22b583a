"""What a process does now and then, by wall time: writing to disk, reporting progress."""

from __future__ import annotations

from time import monotonic


class Every:
    """Due once per period.

    Args:
        period_s: wall time.
        first_s: the first period, where time has passed before; as the others unless given.
    """

    def __init__(self, period_s: float, first_s: float | None = None) -> None:
        self._period_s = period_s
        self._due = monotonic() + (period_s if first_s is None else first_s)

    def is_due(self) -> bool:
        """Whether the period has passed; the next one then begins."""
        now = monotonic()
        if now < self._due:
            return False
        self._due = now + self._period_s
        return True
