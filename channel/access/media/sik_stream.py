"""What a SiK radio's host has given it: a stream of bytes, cut into packets on the air."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from channel.access.packets import AirPacket


class Passage:
    """A packet of the host on its way.

    Attributes:
        packet: which.
        unsent_bytes: not yet put on the air.
        missing_bytes: not yet arrived.
        frames: that had a part of it.
        is_lost: whether one of them was lost.
    """

    __slots__ = ("frames", "is_lost", "missing_bytes", "packet", "unsent_bytes")

    def __init__(self, packet: AirPacket) -> None:
        self.packet = packet
        self.unsent_bytes = self.missing_bytes = max(1, packet.length_bytes)
        self.frames, self.is_lost = 0, False


class Cut(NamedTuple):
    """So many bytes of a packet, in one frame."""

    passage: Passage
    length_bytes: int


class ByteStream:
    """The host's bytes in their order.

    Args:
        look, take: the packet that is next, left where it is or taken out of its queue.
        framed_bytes: packets up to this length are kept whole (MAVLINK = 1); 0: none.
    """

    __slots__ = ("_begun", "_framed_bytes", "_look", "_take")

    def __init__(
        self,
        look: Callable[[], AirPacket | None],
        take: Callable[[], AirPacket | None],
        framed_bytes: int,
    ) -> None:
        self._look, self._take, self._framed_bytes = look, take, framed_bytes
        self._begun: Passage | None = None

    @property
    def begun_bytes(self) -> int:
        """What is left of a packet of which a part was sent."""
        return 0 if self._begun is None else self._begun.unsent_bytes

    def cut(self, room_bytes: int) -> list[Cut]:
        """What goes into a frame with so much room; nothing: there is nothing, or the next packet has to stay whole."""
        parts: list[Cut] = []
        while room_bytes > 0:
            passage = self._passage(room_bytes, is_first=not parts)
            if passage is None:
                break
            length_bytes = min(passage.unsent_bytes, room_bytes)
            passage.unsent_bytes -= length_bytes
            passage.frames += 1
            room_bytes -= length_bytes
            parts.append(Cut(passage, length_bytes))
            self._begun = passage if passage.unsent_bytes else None
        return parts

    def _passage(self, room_bytes: int, *, is_first: bool) -> Passage | None:
        """The packet that is cut next."""
        if self._begun is not None:
            return self._begun
        packet = self._look()
        if packet is None:
            return None
        if self._framed_bytes and packet.length_bytes > room_bytes:
            is_kept_whole = packet.length_bytes <= self._framed_bytes
            if is_kept_whole or not is_first:
                return None
        taken = self._take()
        assert taken is packet
        return Passage(packet)
