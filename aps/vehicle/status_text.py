"""STATUSTEXT messages put together: the autopilot's own words, also when they come in several chunks."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from aps.wire.framer import Frame

__all__ = ["STATUSTEXT_ID", "StatusText", "StatusTextAssembler"]

STATUSTEXT_ID: Final = 253
CHUNK_CHARS: Final = 50
MAX_CHUNKS: Final = 8
_BYTES: Final = 54  # severity, text[50], id (uint16), chunk_seq


@dataclass(frozen=True, slots=True)
class StatusText:
    """One text. ``severity`` is MAV_SEVERITY: 0 emergency ... 4 warning, 6 info, 7 debug."""

    severity: int
    text: str


class StatusTextAssembler:
    """Joins the chunks of one sender's texts (MAVLink 2: id != 0 ties chunks together)."""

    def __init__(self) -> None:
        self._id = 0
        self._chunks: list[str] = []

    def take(self, frame: Frame) -> StatusText | None:
        """Take a STATUSTEXT frame; returns the text once its last chunk is there."""
        payload = frame.payload.ljust(_BYTES, b"\0")
        severity, raw = payload[0], payload[1 : 1 + CHUNK_CHARS].split(b"\0", 1)[0]
        text_id = int.from_bytes(payload[51:53], "little")
        text = raw.decode("utf-8", "replace")
        if text_id == 0:
            return StatusText(severity, text)
        if text_id != self._id or payload[53] == 0:
            self._id, self._chunks = text_id, []
        self._chunks.append(text)
        if len(raw) == CHUNK_CHARS and len(self._chunks) < MAX_CHUNKS:
            return None
        whole, self._chunks = "".join(self._chunks), []
        return StatusText(severity, whole)
