"""Flooding: whoever hears a packet for the first time transmits it once more, up to a number of hops."""

from __future__ import annotations

from collections.abc import Sequence

from channel.access.packets import AirPacket, Loss
from channel.draws import Draws
from channel.routing.router import Forwarding, Hop, HopRouter, Onward


class Flood(HopRouter):
    """All packets go to all that hear them, also those for one node, which does not hand them on.

    Args:
        nodes: their ids.
        draws: of the network.
        forwarding: how long a node waits before it hands a packet on.
        hop_limit: transmissions of a packet in a row, that of its sender too.
        header_bytes: that each packet gets: sender, receiver, number, hops.
    """

    def __init__(
        self, nodes: Sequence[str], draws: Draws, forwarding: Forwarding, hop_limit: int, header_bytes: int
    ) -> None:
        super().__init__(nodes, draws, forwarding)
        self._hop_limit, self._header_bytes = hop_limit, header_bytes

    def header_bytes(self, hop: Hop) -> int:
        """Of all packets."""
        del hop
        return self._header_bytes

    def send(self, node: int, packet: AirPacket) -> Onward:
        """To all."""
        del node, packet
        return [Hop(None)]

    def hand_on(self, node: int, packet: AirPacket, way: Sequence[int]) -> Onward:
        """Once, after a while that is drawn: those who heard it together do not all transmit together."""
        del packet
        return [Hop(None, self._delay_ns(node))] if len(way) < self._hop_limit else Loss.HOP_LIMIT
