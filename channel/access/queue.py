"""The transmit queue of one node."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from math import inf
from typing import Final

from channel.access.packets import AirPacket, Loss

NEVER: Final = inf


@dataclass(frozen=True, slots=True)
class QueueLimits:
    """How much a queue holds; 0 = no limit.

    Attributes:
        packets: at most so many wait.
        length_bytes: of all that wait.
        by_class: each priority has a queue of these limits of its own.
    """

    packets: int = 64
    length_bytes: int = 0
    by_class: bool = False

    def __post_init__(self) -> None:
        if self.packets < 0 or self.length_bytes < 0:
            raise ValueError(f"a queue of {self.packets} packets, {self.length_bytes} bytes: 0 or more")


class TransmitQueue:
    """Packets that wait: higher priorities first, first in first out within one; a full queue takes no more.

    With `QueueLimits.by_class` it is full for the priorities that have as many packets as it may hold.
    """

    def __init__(self, limits: QueueLimits) -> None:
        self._limits = limits
        self._classes: dict[int, deque[AirPacket]] = {}
        self._packets = 0
        self._bytes = 0
        self._none_expires_ns = NEVER
        """Until this instant no packet that waits expires."""

    def __len__(self) -> int:
        return self._packets

    @property
    def length_bytes(self) -> int:
        """Of all that wait."""
        return self._bytes

    def put(self, packet: AirPacket, now_ns: int, beside_bytes: int = 0) -> list[tuple[AirPacket, Loss]]:
        """Take a packet; returns what is lost: those that have expired, the older one of its key, or itself.

        Bytes that wait beside the queue, of a packet that was taken and is not sent in full, count for its limit.
        """
        lost = [(one, Loss.EXPIRED) for one in self._drop_expired(now_ns)]
        old = self._with_key(packet.key)
        if old is not None and old.order > packet.order:
            return [*lost, (packet, Loss.REPLACED)]
        if not self._has_room(packet, old, beside_bytes):
            return [*lost, (packet, Loss.QUEUE_FULL)]
        if old is None:
            self._classes.setdefault(packet.priority, deque()).append(packet)
        elif old.priority == packet.priority:
            waiting = self._classes[old.priority]
            waiting[waiting.index(old)] = packet
            self._packets -= 1
            self._bytes -= old.length_bytes
        else:
            self._remove(old)
            self._classes.setdefault(packet.priority, deque()).append(packet)
        self._packets += 1
        self._bytes += packet.length_bytes
        self._none_expires_ns = min(self._none_expires_ns, expires_ns(packet))
        return lost if old is None else [*lost, (old, Loss.REPLACED)]

    def take(self, now_ns: int, priority: int | None = None) -> tuple[AirPacket | None, list[AirPacket]]:
        """The packet that leaves next, and those that have expired; see `look`."""
        packet, expired = self.look(now_ns, priority)
        if packet is not None:
            self._remove(packet)
        return packet, expired

    def look(self, now_ns: int, priority: int | None = None) -> tuple[AirPacket | None, list[AirPacket]]:
        """The packet that would leave next, and those that have expired, which wait no longer.

        With a priority, the next of that alone.
        """
        expired = self._drop_expired(now_ns)
        wanted = max(self._classes, default=0) if priority is None else priority
        waiting = self._classes.get(wanted)
        return (waiting[0] if waiting else None), expired

    def _drop_expired(self, now_ns: int) -> list[AirPacket]:
        """Remove the packets of all priorities that waited longer than their life times."""
        if now_ns <= self._none_expires_ns:
            return []
        waiting = [packet for packets in self._classes.values() for packet in packets]
        expired = [packet for packet in waiting if expires_ns(packet) < now_ns]
        for packet in expired:
            self._remove(packet)
        left = (expires_ns(packet) for packets in self._classes.values() for packet in packets)
        self._none_expires_ns = min(left, default=NEVER)
        return expired

    def _has_room(self, packet: AirPacket, old: AirPacket | None, beside_bytes: int) -> bool:
        """Whether it fits, with the one whose place it takes gone."""
        limits = self._limits
        packets, length_bytes = self._packets, self._bytes
        if limits.by_class:
            waiting = self._classes.get(packet.priority, ())
            packets, length_bytes = len(waiting), sum(one.length_bytes for one in waiting)
        length_bytes += beside_bytes + packet.length_bytes
        if old is not None and (not limits.by_class or old.priority == packet.priority):
            packets, length_bytes = packets - 1, length_bytes - old.length_bytes
        return (not limits.packets or packets < limits.packets) and (
            not limits.length_bytes or length_bytes <= limits.length_bytes
        )

    def _with_key(self, key: str) -> AirPacket | None:
        if not key:
            return None
        waiting = (packet for packets in self._classes.values() for packet in packets)
        return next((packet for packet in waiting if packet.key == key), None)

    def _remove(self, packet: AirPacket) -> None:
        waiting = self._classes[packet.priority]
        if waiting[0] is packet:
            waiting.popleft()
        else:
            waiting.remove(packet)
        if not waiting:
            del self._classes[packet.priority]
        self._packets -= 1
        self._bytes -= packet.length_bytes


def expires_ns(packet: AirPacket) -> float:
    """The last instant at which it may leave."""
    return NEVER if packet.lifetime_ns is None else packet.at_ns + packet.lifetime_ns
