"""The medium of a radio on which packets take no time (`medium: {model: ideal}`): only the channel loses them."""

from __future__ import annotations

from channel.access.media.medium import AccessMedium
from channel.access.packets import AirFrame, Loss
from channel.access.queue import QueueLimits
from channel.access.world import Piece, World

INSTANT_NS = 1
"""A frame's length: something has to be on the air."""
NO_LIMIT = 1 << 31


class IdealMedium(AccessMedium):
    """Each packet is on the air at once, alone, and arrives after the way."""

    def __init__(self, world: World) -> None:
        super().__init__(world, QueueLimits(0), NO_LIMIT)

    def _wake(self, node: int) -> None:
        while (packet := self._next(node)) is not None:
            now_ns = self.agenda.now_ns
            frame = AirFrame(
                node, packet.number, "data", packet.length_bytes, now_ns, now_ns + INSTANT_NS, packet
            )
            reached = {one.receiver: one for one in self.world.reach(frame)}
            for receiver in self.receivers_of(packet):
                came = receiver in reached and self._comes(frame, receiver, reached[receiver].power_mw)
                self._book(packet, receiver, frame, 1, None if came else Loss.NOISE)

    def _comes(self, frame: AirFrame, receiver: int, power_mw: float) -> bool:
        return self.world.survives(frame, receiver, power_mw, [Piece(INSTANT_NS, 0.0)])[0]
