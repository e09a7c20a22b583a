"""Bytes on their way over a serial line: one after the other, each ten bit times long (8N1)."""

from __future__ import annotations

from collections import deque
from typing import Final

BITS_PER_BYTE: Final = 10
"""A start bit, eight bits, a stop bit."""
NS_PER_S: Final = 1_000_000_000
_SCALE: Final = BITS_PER_BYTE * NS_PER_S


class SerialLine:
    """One direction of a line.

    Args:
        baud: bit/s; 0: bytes take no time.

    Raises:
        ValueError: a negative rate.
    """

    __slots__ = ("_free_ns", "_runs", "baud", "waiting_bytes")

    def __init__(self, baud: int) -> None:
        if baud < 0:
            raise ValueError(f"{baud} baud: 0 (no serial line) or more")
        self.baud = baud
        self.waiting_bytes = 0
        """Put in, and not taken out."""
        self._free_ns = 0
        self._runs: deque[_Run] = deque()

    def span_ns(self, count: int) -> int:
        """How long so many bytes are under way, rounded down."""
        return count * _SCALE // self.baud if self.baud else 0

    def put(self, data: bytes, at_ns: int) -> int:
        """Send bytes from an instant on, after all that were sent before; returns when the last of them arrives."""
        if data:
            if not self._runs or at_ns > self._free_ns:
                self._runs.append(_Run(max(at_ns, self._free_ns)))
            run = self._runs[-1]
            run.data += data
            self.waiting_bytes += len(data)
            self._free_ns = run.started_ns + self.span_ns(run.taken + len(run.data))
        return max(self._free_ns, at_ns)

    @property
    def coming(self) -> bytes | bytearray:
        """The next bytes, as far as they come without a pause."""
        return self._runs[0].data if self._runs else b""

    def arrives_ns(self, count: int) -> int | None:
        """When the ``count``-th byte from now arrives; None: so many were not sent."""
        for run in self._runs:
            if count <= len(run.data):
                return run.started_ns + self.span_ns(run.taken + count)
            count -= len(run.data)
        return None

    def arrived(self, until_ns: int) -> int:
        """How many bytes that were not taken out have arrived by an instant."""
        count = 0
        for run in self._runs:
            if run.started_ns > until_ns:
                break
            there = len(run.data)
            if self.baud:  # the k-th is there if k * _SCALE // baud <= elapsed
                elapsed_ns = until_ns - run.started_ns
                there = min(there, ((elapsed_ns + 1) * self.baud - 1) // _SCALE - run.taken)
            count += max(there, 0)
        return count

    def take(self, count: int) -> bytes:
        """Take out the next bytes."""
        parts = []
        while count > 0 and self._runs:
            run = self._runs[0]
            part = bytes(run.data[:count])
            del run.data[:count]
            run.taken += len(part)
            count -= len(part)
            self.waiting_bytes -= len(part)
            parts.append(part)
            if not run.data:
                self._runs.popleft()
        return b"".join(parts)


class _Run:
    """Bytes that follow each other without a pause; those that were taken out are counted only."""

    __slots__ = ("data", "started_ns", "taken")

    def __init__(self, started_ns: int) -> None:
        self.data = bytearray()
        self.started_ns, self.taken = started_ns, 0
