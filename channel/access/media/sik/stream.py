"""What a SiK radio's host has given it: a stream of bytes, cut into packets on the air."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, NamedTuple

from channel.access.packets import AirPacket

SERIAL_BYTE_TICKS: Final = 10
"""What the firmware takes a byte of the host for, at SERIAL_SPEED 57: 65536 // (57 * 125) + 1."""

LOST: Final = -1


class Passage:
    """A packet of the host on its way.

    Attributes:
        packet: which.
        unsent_bytes: not yet put on the air.
        frames: that had a part of it.
    """

    __slots__ = ("_length_bytes", "_missing_bytes", "frames", "packet", "unsent_bytes")

    def __init__(self, packet: AirPacket) -> None:
        self.packet = packet
        self.unsent_bytes = self._length_bytes = max(1, packet.length_bytes)
        self._missing_bytes: dict[int, int] = {}
        """By receiver that a part has passed: what has not arrived there, or `LOST`."""
        self.frames = 0

    def passes(self, receiver: int, length_bytes: int, *, is_lost: bool) -> bool:
        """A part of it has passed a receiver; whether that decides what becomes of it there."""
        missing_bytes = self._missing_bytes.get(receiver, self._length_bytes)
        if missing_bytes == LOST:
            return False
        missing_bytes -= length_bytes
        self._missing_bytes[receiver] = LOST if is_lost else missing_bytes
        return is_lost or not missing_bytes


class Cut(NamedTuple):
    """So many bytes of a packet, in one frame."""

    passage: Passage
    length_bytes: int


class ByteStream:
    """The host's bytes in their order.

    A packet that is to stay whole and finds no room is held back, as by `packet_get_next` in the firmware, for as long
    as its bytes would take on the serial line; after that it is cut.

    Args:
        look, take: the packet that is next, left where it is or taken out of its queue.
        framed_bytes: packets up to this length are kept whole (MAVLINK = 1); 0: none.
    """

    __slots__ = ("_begun", "_framed_bytes", "_held", "_held_since", "_look", "_take")

    def __init__(
        self,
        look: Callable[[], AirPacket | None],
        take: Callable[[], AirPacket | None],
        framed_bytes: int,
    ) -> None:
        self._look, self._take, self._framed_bytes = look, take, framed_bytes
        self._begun: Passage | None = None
        self._held: AirPacket | None = None
        self._held_since = 0

    @property
    def begun_bytes(self) -> int:
        """What is left of a packet of which a part was sent."""
        return 0 if self._begun is None else self._begun.unsent_bytes

    def cut(self, room_bytes: int, tick: int) -> list[Cut]:
        """What goes into a frame with so much room; nothing: there is nothing, or the next packet is held back."""
        parts: list[Cut] = []
        is_stream = self._begun is not None
        while room_bytes > 0:
            passage = self._begun or self._passage(room_bytes, tick, is_first=not parts, is_stream=is_stream)
            if passage is None:
                break
            length_bytes = min(passage.unsent_bytes, room_bytes)
            passage.unsent_bytes -= length_bytes
            passage.frames += 1
            room_bytes -= length_bytes
            parts.append(Cut(passage, length_bytes))
            self._begun = passage if passage.unsent_bytes else None
            is_stream = is_stream or not self._stays_whole(passage.packet)
        return parts

    def _stays_whole(self, packet: AirPacket) -> bool:
        return self._framed_bytes > 0 and packet.length_bytes <= self._framed_bytes

    def _passage(self, room_bytes: int, tick: int, *, is_first: bool, is_stream: bool) -> Passage | None:
        """The packet that is cut next; a frame has whole packets, or a part of the stream of those that are not."""
        packet = self._look()
        if packet is None:
            self._held = None
            return None
        stays_whole = self._stays_whole(packet)
        if is_first:
            if stays_whole and packet.length_bytes > room_bytes and not self._may_be_cut(packet, tick):
                return None
        elif is_stream:
            if stays_whole:
                self._hold(packet, tick)
                return None
        elif not stays_whole or packet.length_bytes > room_bytes:
            return None
        if packet is self._held or packet.length_bytes > room_bytes:
            self._held = None
        taken = self._take()
        assert taken is packet
        return Passage(packet)

    def _may_be_cut(self, packet: AirPacket, tick: int) -> bool:
        """Whether it, or one whose place it took, has been held back long enough."""
        self._hold(packet, tick)
        return tick - self._held_since > packet.length_bytes * SERIAL_BYTE_TICKS

    def _hold(self, packet: AirPacket, tick: int) -> None:
        if self._held is None:
            self._held, self._held_since = packet, tick
