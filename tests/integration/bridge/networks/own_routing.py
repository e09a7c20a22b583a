"""A way of routing of one's own, as docs/reference/routing.md shows it: what is for one node goes over a hub."""

from collections.abc import Mapping, Sequence

from channel.access.packets import AirPacket
from channel.draws import Draws
from channel.routing.router import Hop, HopRouter, Onward
from channel.routing.settings import Relaying


class Star(HopRouter):
    """Sends to the hub, which sends on."""

    hub = 0

    def send(self, node: int, packet: AirPacket) -> Onward:
        """Nodes are places in the order of the scenario; ``to`` is None of packets for several."""
        is_direct = packet.to is None or self.hub in (node, packet.to)
        return [Hop(packet.to if is_direct else self.hub)]

    def hand_on(self, node: int, packet: AirPacket, way: Sequence[int]) -> Onward:
        """Called with a packet that came to a node, and is not for it alone."""
        return () if packet.to is None else [Hop(packet.to, self._delay_ns(node))]


class StarRouting(Relaying):
    """Its settings: the times of `processing_s` and `jitter_s`, and the hub."""

    hub: str

    def open(self, nodes: Mapping[str, int], draws: Draws) -> HopRouter:
        """Make the router; nodes are those of the network, by id."""
        router = Star(tuple(nodes), draws, self.forwarding)
        router.hub = nodes[self.hub]
        return router
