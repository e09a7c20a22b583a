"""A mesh: nodes find routes by originator messages, as B.A.T.M.A.N. IV does; packets for all are flooded."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from channel.access.packets import AirPacket, Loss
from channel.access.timing import NS_PER_S
from channel.draws import Draws
from channel.routing.mesh.originator import (
    BROADCAST_BYTES,
    BROADCAST_GAP_S,
    BROADCASTS,
    CONTROL_PRIORITY,
    HOP_PENALTY,
    INTERVAL_S,
    JITTER_S,
    OGM_BYTES,
    PURGE_S,
    TTL,
    UNICAST_BYTES,
    Ogm,
)
from channel.routing.mesh.station import MeshStation
from channel.routing.router import Forwarding, Hop, HopRouter, Notice, Onward

_GAP_NS = round(BROADCAST_GAP_S * NS_PER_S)
_JITTER_NS = round(JITTER_S * NS_PER_S)


@dataclass(frozen=True, slots=True)
class MeshNumbers:
    """What can be set of a mesh.

    Attributes:
        interval_s: between two messages of a node.
        hop_penalty: of 255, at each hop.
        purge_s: a neighbour is forgotten after so long in silence.
        broadcasts: how often each node transmits a packet for all.
        ogm_bytes: of an originator message.
        ogm_priority: of these in the queue.
    """

    interval_s: float = INTERVAL_S
    hop_penalty: int = HOP_PENALTY
    purge_s: float = PURGE_S
    broadcasts: int = BROADCASTS
    ogm_bytes: int = OGM_BYTES
    ogm_priority: int = CONTROL_PRIORITY


class Mesh(HopRouter):
    """The nodes of a network, each of which knows what it hears.

    Nodes begin one by one: the first message of each comes at an instant that is drawn from the first interval. What
    neighbours hand on is not aggregated (`aggregated_ogms 0`).

    Args:
        nodes: their ids.
        draws: of the network.
        forwarding: how long a node takes to hand a packet on.
        numbers: what is set.
    """

    def __init__(
        self, nodes: Sequence[str], draws: Draws, forwarding: Forwarding, numbers: MeshNumbers | None = None
    ) -> None:
        super().__init__(nodes, draws, forwarding)
        self._numbers = numbers or MeshNumbers()
        self.notice_priority = self._numbers.ogm_priority
        self._interval_ns = round(self._numbers.interval_s * NS_PER_S)
        purge_ns = round(self._numbers.purge_s * NS_PER_S)
        self.stations = [MeshStation(node, self._numbers.hop_penalty, purge_ns) for node in range(len(nodes))]

    def header_bytes(self, hop: Hop) -> int:
        """Of batman-adv, and of the Ethernet frame that it carries."""
        return BROADCAST_BYTES if hop.to is None else UNICAST_BYTES

    def send(self, node: int, packet: AirPacket) -> Onward:
        """To the next node; what is for several, three times to all."""
        if packet.to is None:
            return self._broadcasts(0) if self.stations[node].has_others(node, None) else Loss.NO_ROUTE
        return _to_next(self.stations[node].next_to(packet.to), 0)

    def hand_on(self, node: int, packet: AirPacket, way: Sequence[int]) -> Onward:
        """Likewise; what is for all only if there is a neighbour who may not have it."""
        if len(way) >= TTL:
            return Loss.HOP_LIMIT
        if packet.to is None:
            if not self.stations[node].has_others(packet.node, way[-1]):
                return ()
            return self._broadcasts(self._delay_ns(node))
        return _to_next(self.stations[node].onward_to(packet.to), self._delay_ns(node))

    def refuses(self, node: int, packet: AirPacket) -> Loss | None:
        """What is for all, of a sender that it never heard of (`batadv_recv_bcast_packet`)."""
        is_known = packet.to is not None or self.stations[node].knows(packet.node)
        return None if is_known else Loss.NO_ROUTE

    def first_notice_ns(self, node: int) -> int:
        """Drawn from the first interval."""
        return int(self._words[node].next_uniform() * self._interval_ns)

    def notices(self, node: int, now_ns: int) -> tuple[Sequence[Notice], int]:
        """Its own message; the next comes an interval later, give or take the jitter."""
        jitter_ns = int((2.0 * self._words[node].next_uniform() - 1.0) * _JITTER_NS)
        ogm = self.stations[node].message(now_ns)
        return [Notice(ogm, self._numbers.ogm_bytes)], now_ns + self._interval_ns + jitter_ns

    def take(self, node: int, sender: int, content: object, now_ns: int) -> Sequence[Notice]:
        """Take a message in; it is handed on after up to half the jitter."""
        assert isinstance(content, Ogm), "nodes of a mesh tell each other originator messages"
        ogm = self.stations[node].take(sender, content, now_ns)
        if ogm is None:
            return ()
        delay_ns = int(self._words[node].next_uniform() * _JITTER_NS / 2)
        return [Notice(ogm, self._numbers.ogm_bytes, delay_ns)]

    def _broadcasts(self, delay_ns: int) -> Sequence[Hop]:
        return [Hop(None, delay_ns + number * _GAP_NS) for number in range(self._numbers.broadcasts)]


def _to_next(following: int | None, delay_ns: int) -> Onward:
    return Loss.NO_ROUTE if following is None else [Hop(following, delay_ns)]
