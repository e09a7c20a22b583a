"""How long an autopilot takes to answer on a link: the round trip of TIMESYNC. No I/O, no clock."""

from __future__ import annotations

from collections import deque
from typing import Any, Final

NS_PER_MS: Final = 1_000_000
MAX_UNANSWERED: Final = 8
"""Requests that may still be answered: an answer to an older one is nobody's."""
WINDOW: Final = 60
"""Latest round trips that the figures are made of."""


class LinkLatency:
    """Round trips on one link.

    A request carries an instant of ours, the answer brings it back unchanged (mavlink.io, "Time Synchronization
    Protocol"): the difference is the way there and back, and what the autopilot needed between two of its loops.
    """

    __slots__ = ("_round_trips_ns", "_unanswered", "answered", "asked", "told_ns")

    def __init__(self) -> None:
        self.asked = 0
        self.answered = 0
        self.told_ns: tuple[int, int] | None = None
        """The latest request that our autopilot answered, and its own time then."""
        self._unanswered: deque[int] = deque(maxlen=MAX_UNANSWERED)
        self._round_trips_ns: deque[int] = deque(maxlen=WINDOW)

    def ask(self, now_ns: int) -> int:
        """A request is sent now; returns what it is to carry as ``ts1``."""
        self.asked += 1
        self._unanswered.append(now_ns)
        return now_ns

    def answer(self, ts1: int, now_ns: int) -> bool:
        """An answer came; returns whether it is to a request of ours."""
        if ts1 not in self._unanswered:
            return False
        self._unanswered.remove(ts1)
        self.answered += 1
        self._round_trips_ns.append(now_ns - ts1)
        return True

    def statistics(self) -> dict[str, Any]:
        """The latest round trip, and least, median and most of the last ``WINDOW``, ms; ``None`` before the first."""
        ordered = sorted(self._round_trips_ns)
        figures = (
            (self._round_trips_ns[-1], ordered[0], ordered[len(ordered) // 2], ordered[-1])
            if ordered
            else (None, None, None, None)
        )
        names = ("latest_ms", "least_ms", "median_ms", "most_ms")
        return {
            "asked": self.asked,
            "answered": self.answered,
            **{
                name: None if value is None else round(value / NS_PER_MS, 3)
                for name, value in zip(names, figures, strict=True)
            },
        }
