"""How much a client may send: one that floods waits, and the others do not notice. No I/O, no clock."""

from __future__ import annotations

from typing import Final

DEFAULT_FRAMES_PER_S: Final = 1000.0
"""Twenty times a busy ground station: uploads of missions, parameters and files wait for answers in between."""
BURST_S: Final = 0.5
GARBAGE_BYTES_PER_FRAME: Final = 16
"""To look for a frame in so many bytes that belong to none costs as much as a frame."""


class Allowance:
    """A bucket of frames that fills with time.

    Args:
        frames_per_s: what may come for good; for half a second's worth it may come at once.
    """

    def __init__(self, frames_per_s: float = DEFAULT_FRAMES_PER_S) -> None:
        if not frames_per_s > 0.0:
            raise ValueError(f"frames_per_s must be positive, not {frames_per_s}")
        self._frames_per_s = frames_per_s
        self._full = frames_per_s * BURST_S
        self._left = self._full
        self._now_s = 0.0

    def charge(self, frames: float, garbage_bytes: int, now_s: float) -> float:
        """Account for what came; returns for how long nothing more should be taken, s (0: go on)."""
        self._left = min(self._full, self._left + (now_s - self._now_s) * self._frames_per_s)
        self._now_s = now_s
        self._left -= frames + garbage_bytes / GARBAGE_BYTES_PER_FRAME
        return max(0.0, -self._left / self._frames_per_s)
