"""Routes that are written down: at each node the next one by destination."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from channel.access.packets import AirPacket
from channel.draws import Draws
from channel.routing.router import Forwarding, Hop, HopRouter, Onward

Routes = Mapping[int, Mapping[int, int]]
"""At a node, by destination: the next node."""


class Static(HopRouter):
    """Packets for one node go from node to node; one without a route there is sent to it directly.

    What is for all, or for a group, is sent once, and is not handed on.

    Args:
        nodes: their ids.
        draws: of the network.
        forwarding: how long a node takes to hand a packet on.
        routes: that come to their destinations (`leads_back`).
        header_bytes: that each packet gets: sender, receiver.
    """

    def __init__(
        self, nodes: Sequence[str], draws: Draws, forwarding: Forwarding, routes: Routes, header_bytes: int
    ) -> None:
        super().__init__(nodes, draws, forwarding)
        self._routes, self._header_bytes = routes, header_bytes

    def header_bytes(self, hop: Hop) -> int:
        """Of all packets."""
        del hop
        return self._header_bytes

    def send(self, node: int, packet: AirPacket) -> Onward:
        """To the next node."""
        return [Hop(None if packet.to is None else self._next(node, packet.to))]

    def hand_on(self, node: int, packet: AirPacket, way: Sequence[int]) -> Onward:
        """To the next node; nothing that was for all."""
        del way
        return () if packet.to is None else [Hop(self._next(node, packet.to), self._delay_ns(node))]

    def _next(self, node: int, to: int) -> int:
        return self._routes.get(node, {}).get(to, to)


def leads_back(routes: Mapping[str, Mapping[str, str]]) -> tuple[str, str, tuple[str, ...]] | None:
    """Node, destination and way of the first route that comes back to a node of its way; None: each leads there."""
    for start, by_destination in routes.items():
        for destination in by_destination:
            way = [start]
            while way[-1] != destination:
                way.append(routes.get(way[-1], {}).get(destination, destination))
                if way[-1] in way[:-1]:
                    return start, destination, tuple(way)
    return None
