"""One node of a mesh: which messages it sends and hands on, and what it knows of others."""

from __future__ import annotations

from channel.routing.mesh.originator import TQ_MAX, TTL, Ogm, after_hop
from channel.routing.mesh.ranking import Ranking, slid


class MeshStation:
    """One node.

    Args:
        node: who.
        hop_penalty: of TQ_MAX.
        purge_ns: a neighbour is forgotten after so long in silence, an originator after twice that.
    """

    def __init__(self, node: int, hop_penalty: int, purge_ns: int) -> None:
        self.node, self._purge_ns = node, purge_ns
        self._sequence = 0
        self._echoes: dict[int, int] = {}
        """Of own messages, by who handed them on; the newest in bit 0."""
        self._neighbours_ns: dict[int, int] = {}
        """When a message of each neighbour's own last came from itself."""
        own = Ranking(TQ_MAX, hop_penalty, self._echoed)
        others = Ranking(after_hop(TQ_MAX, hop_penalty), hop_penalty, self._echoed)
        self._own, self._others = own, others
        """For its own packets; for others' packets and what neighbours are told, for which the radio is used twice."""

    def next_to(self, node: int) -> int | None:
        """The next node to another; None: it knows none."""
        return self._own.router(node)

    def onward_to(self, node: int) -> int | None:
        """Likewise for a packet that it hands on (`batadv_find_router` with the interface that it came from)."""
        return self._others.router(node)

    def quality_of(self, originator: int, neighbour: int) -> int:
        """The mean quality of the way to an originator over a neighbour."""
        known = self._own.known.get(originator)
        return (
            0
            if known is None or neighbour not in known.by_neighbour
            else known.by_neighbour[neighbour].average
        )

    def knows(self, node: int) -> bool:
        """Whether it heard messages of a node."""
        return node in self._own.known

    def has_others(self, originator: int, sender: int | None) -> bool:
        """Whether it has neighbours but the originator and the sender of a packet (`batadv_hardif_no_broadcast`)."""
        return len(self._neighbours_ns) > 1 or bool(self._neighbours_ns.keys() - {originator, sender})

    def message(self, now_ns: int) -> Ogm:
        """Its next own message."""
        self._purge(now_ns)
        self._sequence += 1
        self._echoes = {node: slid(echoes, 1) for node, echoes in self._echoes.items()}
        return Ogm(self.node, self._sequence, TTL, TQ_MAX, self.node)

    def take(self, sender: int, ogm: Ogm, now_ns: int) -> Ogm | None:
        """Take in what a neighbour transmitted; the message to hand on, None: none (`batadv_iv_ogm_process`)."""
        if ogm.originator == self.node:
            self._came_back(sender, ogm)
            return None
        if ogm.previous == self.node or not ogm.is_best:
            return None
        self._echoes.setdefault(ogm.originator, 0)
        if ogm.originator == sender:
            self._neighbours_ns[sender] = now_ns
        self._own.take(sender, ogm, now_ns)
        return self._others.take(sender, ogm, now_ns)

    def _came_back(self, sender: int, ogm: Ogm) -> None:
        """A neighbour handed one of its messages on, which it had from this node itself."""
        behind = self._sequence - ogm.sequence
        if ogm.is_direct and sender in self._echoes:
            self._echoes[sender] |= slid(1, behind)

    def _echoed(self, node: int) -> int:
        return self._echoes.get(node, 0).bit_count()

    def _purge(self, now_ns: int) -> None:
        """Forget who has not been heard for long."""
        since_ns = now_ns - self._purge_ns
        for ranking in (self._own, self._others):
            ranking.purge(since_ns, since_ns - self._purge_ns)
        self._neighbours_ns = {n: at_ns for n, at_ns in self._neighbours_ns.items() if at_ns >= since_ns}
        self._echoes = {n: echoes for n, echoes in self._echoes.items() if n in self._own.known}
