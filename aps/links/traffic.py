"""What came over a link: how much, how much was lost, and whether anybody is there. No I/O, no clock."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

from aps.timeouts import CONNECTED_S
from aps.wire.framer import MAGIC_V2, Frame

NS_PER_S: Final = 1_000_000_000
MAX_SENDERS: Final = 256
REORDERED: Final = 200
"""A jump of the sequence number by so many or more is a frame that was overtaken, not so many lost ones."""
_HEARTBEAT: Final = 0
RATE_WINDOW_NS: Final = NS_PER_S


class Traffic:
    """Counts one link's incoming frames."""

    __slots__ = (
        "_rate_frames",
        "_rate_hz",
        "_sequence",
        "_settled_lost",
        "_window_ns",
        "bytes",
        "frames",
        "heard_ns",
        "heartbeat_ns",
        "lost",
        "sender",
    )

    def __init__(self) -> None:
        self.frames = 0
        self.bytes = 0
        self.lost = 0
        """Frames missing by their senders' sequence numbers. Of a sender whose other frames take another way, these
        count as well."""
        self.sender: int | None = None
        """``sysid << 8 | compid`` of the only sender whose numbers are looked at; ``None``: all. An autopilot hands on
        others' frames as well, our own of another of its ports included, and not all of them."""
        self.heard_ns: int | None = None
        """When the latest frame came."""
        self.heartbeat_ns: int | None = None
        """When the latest heartbeat came: a link is up while there are some."""
        self._sequence: dict[int, int] = {}
        self._settled_lost = 0
        self._window_ns, self._rate_frames, self._rate_hz = 0, 0, 0.0

    def received(self, frames: Sequence[Frame], size_bytes: int, now_ns: int) -> None:
        """Bytes came, and with them frames."""
        self.bytes += size_bytes
        if not frames:
            return
        self.frames += len(frames)
        self.heard_ns = now_ns
        if now_ns - self._window_ns >= RATE_WINDOW_NS:
            self._rate_hz = self._rate_frames * NS_PER_S / max(now_ns - self._window_ns, 1)
            self._window_ns, self._rate_frames = now_ns, 0
        self._rate_frames += len(frames)
        sequence, only = self._sequence, self.sender
        for raw, msg_id, sysid, compid, _, _, _, _ in frames:
            if msg_id == _HEARTBEAT:
                self.heartbeat_ns = now_ns
            sender, seq = sysid << 8 | compid, raw[4] if raw[0] == MAGIC_V2 else raw[2]
            if only is not None and sender != only:
                continue
            expected = sequence.get(sender)
            if expected == seq:
                sequence[sender] = (seq + 1) & 0xFF
                continue
            if expected is not None:
                missing = (seq - expected) & 0xFF
                if missing >= REORDERED:
                    self.lost -= self.lost > 0
                    continue
                self.lost += missing
            elif len(sequence) >= MAX_SENDERS:
                sequence.clear()
            sequence[sender] = (seq + 1) & 0xFF

    def reopened(self) -> None:
        """The line is open anew: it is up with the next heartbeat."""
        self.heartbeat_ns = None

    def settle(self) -> None:
        """The sender has not been started anew until now: what is missing is lost."""
        self._settled_lost = self.lost

    def restarted(self) -> None:
        """The sender has been started anew, and its numbers begin anew: what that looks like is no loss."""
        self.lost = self._settled_lost
        self._sequence.clear()

    def up(self, now_ns: int) -> bool:
        """Whether there has been a heartbeat lately: a socket alone is no link."""
        return self.heartbeat_ns is not None and now_ns - self.heartbeat_ns <= CONNECTED_S * NS_PER_S

    def statistics(self, now_ns: int) -> dict[str, Any]:
        """Counters, as plain data."""
        silent_ns = None if self.heard_ns is None else now_ns - self.heard_ns
        rate_hz = self._rate_hz if silent_ns is not None and silent_ns < 2 * RATE_WINDOW_NS else 0.0
        return {
            "up": self.up(now_ns),
            "silent_s": None if silent_ns is None else round(silent_ns / NS_PER_S, 1),
            "frames_in": self.frames,
            "bytes_in": self.bytes,
            "lost_in": self.lost,
            "rate_in_hz": round(rate_hz, 1),
        }
