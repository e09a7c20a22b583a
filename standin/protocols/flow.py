"""Flow control of a serial port behind a modem, as ArduPilot's (`GCS_Common.cpp`, `GCS_Param.cpp`)."""

from __future__ import annotations

from typing import Final

NS_PER_S: Final = 1_000_000_000
BITS_PER_BYTE: Final = 10
STALE_NS: Final = 5 * NS_PER_S
"""A RADIO_STATUS that is older says nothing."""
SLOWDOWN_MAX_MS: Final = 2000
PARAMETERS_ABOVE_PERCENT: Final = 33
"""Parameters of a list go out only while more of the modem's buffer is free."""
PARAMETERS_SHARE: Final = 0.3
"""Of the port's rate, at most, that parameters of a list take."""
IDLE_NS: Final = 10_000_000
"""A line that was idle has at most this long to catch up with: some frames of physics."""
BUFFER_BYTES: Final = 512
"""Streams and lists wait while so much is in the port's buffer."""


class FlowControl:
    """What a port's modem has said of its buffer, and how fast the port's line is.

    Args:
        baud: bit/s; 0: there is no line, bytes leave at once.

    Attributes:
        slowdown_ms: added to the interval of each stream.
    """

    def __init__(self, baud: int = 0) -> None:
        self.baud = baud
        self.slowdown_ms = 0
        self._txbuf, self._heard_ns = 100, -STALE_NS - 1
        self._left_ns = 0

    def radio_status(self, txbuf: int, now_ns: int) -> None:
        """The modem says how much of its buffer is free, percent (`handle_radio_status`)."""
        self._txbuf, self._heard_ns = txbuf, now_ns
        if txbuf < 20 and self.slowdown_ms < SLOWDOWN_MAX_MS:
            self.slowdown_ms += 60
        elif txbuf < 50 and self.slowdown_ms < SLOWDOWN_MAX_MS:
            self.slowdown_ms += 20
        elif txbuf > 95 and self.slowdown_ms > 200:
            self.slowdown_ms -= 40
        elif txbuf > 90:
            self.slowdown_ms = max(self.slowdown_ms - 20, 0)

    def takes_parameters(self, now_ns: int) -> bool:
        """Whether parameters of a list may go out (`last_txbuf_is_greater`)."""
        return now_ns - self._heard_ns > STALE_NS or self._txbuf > PARAMETERS_ABOVE_PERCENT

    def parameter_interval_ns(self, length_bytes: int) -> int:
        """How far apart parameters of a list are, so that they take no more than their share; 0: any."""
        if not self.baud:
            return 0
        return round(length_bytes * BITS_PER_BYTE * NS_PER_S / (self.baud * PARAMETERS_SHARE))

    def leaves_bytes(self, waiting_bytes: int, now_ns: int) -> int:
        """How many of the bytes that wait have left over the line by now."""
        if not self.baud:
            return waiting_bytes
        self._left_ns = max(self._left_ns, now_ns - IDLE_NS)
        count = min((now_ns - self._left_ns) * self.baud // (BITS_PER_BYTE * NS_PER_S), waiting_bytes)
        if count == waiting_bytes:
            self._left_ns = now_ns
        else:
            self._left_ns += count * BITS_PER_BYTE * NS_PER_S // self.baud
        return count
