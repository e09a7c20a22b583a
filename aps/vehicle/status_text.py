"""STATUSTEXT messages put together: the autopilot's own words, also when they come in several chunks."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

from aps.timeouts import CHUNK_TIMEOUT_S
from aps.wire.dialect import mavlink
from aps.wire.framer import Frame

STATUSTEXT_ID: Final = 253
MAX_REASON_SEVERITY: Final = int(mavlink.MAV_SEVERITY_WARNING)
CHUNK_CHARS: Final = 50
MAX_CHUNKS: Final = 8
CHUNK_TIMEOUT_NS: Final = round(CHUNK_TIMEOUT_S * 1_000_000_000)
MISSING: Final = b" ... "
"""In place of chunks that were lost."""
_BYTES: Final = 54  # severity, text[50], id (uint16), chunk_seq


@dataclass(frozen=True, slots=True)
class StatusText:
    """One text. ``severity`` is MAV_SEVERITY: 0 emergency ... 4 warning, 6 info, 7 debug."""

    severity: int
    text: str

    @property
    def may_be_a_reason(self) -> bool:
        """A warning, or ArduPilot's notice of what it does: ``Polygon fence breached``, ``changing mode to RTL``."""
        words = self.text.lower()
        is_breach = "fence" in words and words.endswith("breached")
        return self.severity <= MAX_REASON_SEVERITY or is_breach or "changing mode to" in words


def reasons(texts: Iterable[StatusText]) -> list[str]:
    """Those that may be one, each once."""
    return list(dict.fromkeys(text.text for text in texts if text.may_be_a_reason))


class StatusTextAssembler:
    """Joins the chunks of one sender's texts (MAVLink 2: id != 0 ties chunks together).

    A text ends with a chunk that is not full. The end may be lost, and PX4 sends none after a last chunk that is full
    (STATUSTEXT.hpp): then what has come is the text, with the sender's next or after CHUNK_TIMEOUT_S. A chunk that is
    missing before others is marked.
    """

    def __init__(self) -> None:
        self._id = 0
        self._severity = 0
        self._raw = b""
        self._count = 0
        """Of the chunks so far, also of those that are missing."""
        self.due_ns: int | None = None
        """When a text whose end has not come is given up waiting for."""

    def take(self, frame: Frame, now_ns: int) -> list[StatusText]:
        """Take a STATUSTEXT frame; returns the texts that are whole by it."""
        payload = frame.payload.ljust(_BYTES, b"\0")
        severity, raw, seq = payload[0], payload[1 : 1 + CHUNK_CHARS].split(b"\0", 1)[0], payload[53]
        text_id = int.from_bytes(payload[51:53], "little")
        if text_id == 0:
            return [StatusText(severity, raw.decode("utf-8", "replace"))]
        before = self._end() if text_id != self._id or seq == 0 else []
        self._id, self._severity = text_id, severity
        self._raw += (MISSING if seq > self._count else b"") + raw
        self._count = seq + 1
        if len(raw) < CHUNK_CHARS or self._count >= MAX_CHUNKS:
            return before + self._end()
        self.due_ns = now_ns + CHUNK_TIMEOUT_NS
        return before

    def overdue(self, now_ns: int) -> list[StatusText]:
        """The text whose end has not come in time."""
        return [] if self.due_ns is None or now_ns < self.due_ns else self._end()

    def _end(self) -> list[StatusText]:
        raw, self._raw, self._count, self.due_ns = self._raw, b"", 0, None
        return [StatusText(self._severity, raw.decode("utf-8", "replace"))] if raw else []
