"""How good each neighbour is as the next node to each originator, and which is chosen."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from enum import Enum, auto

from channel.routing.mesh.originator import (
    BIDIRECTIONAL_LEAST,
    GLOBAL_WINDOW,
    LOCAL_WINDOW,
    TTL_SIMILAR,
    Ogm,
    after_hop,
    combined,
)

_WINDOW_MASK = (1 << LOCAL_WINDOW) - 1
Echoed = Callable[[int], int]
"""How many of one's own messages in the window came back from a node."""


class Seen(Enum):
    """What a message's number says."""

    NEW = auto()
    FROM_ANOTHER = auto()
    """Another neighbour brought it before."""
    FROM_THIS = auto()
    """This neighbour brought it before."""
    OLD = auto()
    """From before the window."""


def slid(window: int, by: int) -> int:
    """A window of sequence numbers, the newest in bit 0, after as many more."""
    return (window << by) & _WINDOW_MASK if by < LOCAL_WINDOW else 0


@dataclass(slots=True)
class NextNode:
    """A neighbour as the next node to an originator.

    Attributes:
        window: which of the originator's messages came from it, the newest in bit 0.
        qualities: of the last GLOBAL_WINDOW messages; 0: it did not bring one.
        average: of those that are not 0.
        seen_ns: when it last brought a message that counted; of the originator itself, any.
    """

    window: int = 0
    qualities: list[int] = field(default_factory=lambda: [0] * GLOBAL_WINDOW)
    average: int = 0
    seen_ns: int = 0

    def rate(self, quality: int) -> None:
        """Take in the quality of one more message."""
        self.qualities = [*self.qualities[1:], quality]
        known = [each for each in self.qualities if each]
        self.average = sum(known) // len(known) if known else 0


@dataclass(slots=True)
class Destination:
    """An originator, as a node knows it.

    Attributes:
        by_neighbour: all over whom it was heard.
        router: the next node that is chosen; None: none yet.
        sequence: the newest message.
        ttl: with which that came first.
        seen_ns: when a message of it last counted, or it came to be known.
    """

    by_neighbour: dict[int, NextNode] = field(default_factory=dict)
    router: int | None = None
    sequence: int = 0
    ttl: int = 0
    seen_ns: int = 0

    def mark(self, sender: int, sequence: int) -> Seen:
        """Take note of a message's number (`batadv_iv_ogm_update_seqnos`)."""
        ahead = sequence - self.sequence
        if self.by_neighbour and ahead <= -LOCAL_WINDOW:
            return Seen.OLD
        seen = Seen.NEW
        for node, each in self.by_neighbour.items():
            had = ahead <= 0 and bool(each.window >> -ahead & 1)
            if had and seen is not Seen.FROM_THIS:
                seen = Seen.FROM_THIS if node == sender else Seen.FROM_ANOTHER
            if ahead > 0:
                each.window = slid(each.window, ahead)
            if node == sender:
                each.window |= 1 << max(-ahead, 0)
        if self.by_neighbour and ahead > 0:
            self.sequence = sequence
        return seen

    def rank(self, node: int) -> int:
        """The lower the better."""
        return -self.by_neighbour[node].average

    def received(self, node: int) -> int:
        """How many messages in the window came from a neighbour."""
        return self.by_neighbour[node].window.bit_count() if node in self.by_neighbour else 0


class Ranking:
    """One node's choice of next nodes.

    Args:
        interface: as of `combined`.
        hop_penalty: of TQ_MAX.
        echoed: of the node.
    """

    def __init__(self, interface: int, hop_penalty: int, echoed: Echoed) -> None:
        self._interface, self._hop_penalty, self._echoed = interface, hop_penalty, echoed
        self.known: dict[int, Destination] = {}

    def router(self, originator: int | None) -> int | None:
        """The next node to an originator."""
        known = None if originator is None else self.known.get(originator)
        return None if known is None else known.router

    def take(self, sender: int, ogm: Ogm, now_ns: int) -> Ogm | None:
        """Take a message in; the one to hand on, None: none (`batadv_iv_ogm_process_per_outif`)."""
        to = self._destination(ogm.originator, now_ns)
        seen = to.mark(sender, ogm.sequence)
        if seen is Seen.OLD or not ogm.quality or self._may_loop(to, ogm):
            return None
        router = to.router
        is_best = router == sender and router in to.by_neighbour and to.by_neighbour[router].average > 0
        is_direct = sender == ogm.originator
        neighbour = to if is_direct else self._destination(sender, now_ns)
        if not is_direct and neighbour.router is None:
            return None
        itself, to.seen_ns = neighbour.by_neighbour.setdefault(sender, NextNode(seen_ns=now_ns)), now_ns
        if is_direct:
            itself.seen_ns = now_ns
        received = neighbour.received(sender)
        quality = combined(ogm.quality, received, self._echoed(sender), self._interface)
        is_both_ways = quality >= BIDIRECTIONAL_LEAST
        again = to.sequence == ogm.sequence and to.ttl - TTL_SIMILAR <= ogm.ttl
        if is_both_ways and (seen is Seen.NEW or again):
            to.by_neighbour.setdefault(sender, NextNode()).seen_ns = now_ns
            self._rank(to, sender, quality, ogm.ttl, is_new=seen is Seen.NEW)
        if not is_direct and (not is_both_ways or seen is Seen.FROM_THIS):
            return None
        if ogm.ttl <= 1 or not (is_best or is_direct):
            return None
        onward = after_hop(quality, self._hop_penalty)
        return Ogm(ogm.originator, ogm.sequence, ogm.ttl - 1, onward, sender, is_direct, is_best)

    def _destination(self, node: int, now_ns: int) -> Destination:
        """What is known of a node; one that was not is known from now on (`batadv_orig_node_new`)."""
        return self.known.setdefault(node, Destination(seen_ns=now_ns))

    def _may_loop(self, to: Destination, ogm: Ogm) -> bool:
        """Whether its transmitter had it from one's own next node, who is one's neighbour."""
        router = to.router
        is_from_router = router is not None and router == ogm.previous != ogm.originator
        return is_from_router and self.router(router) == router

    def _rank(self, to: Destination, sender: int, quality: int, ttl: int, *, is_new: bool) -> None:
        """Rate who brought a message, and those who did not; choose the best (`batadv_iv_ogm_orig_update`)."""
        if is_new:
            for node, other in to.by_neighbour.items():
                if node != sender:
                    other.rate(0)
            to.ttl = ttl
        mine = to.by_neighbour[sender]
        mine.rate(quality)
        router = to.router
        if router == sender:
            return
        if router is not None:
            average = to.by_neighbour[router].average
            if average > mine.average:
                return
            if average == mine.average and self._echoed(router) >= self._echoed(sender):
                return
        to.router = sender

    def purge(self, silent_since_ns: int, gone_since_ns: int) -> None:
        """Forget neighbours and originators that were last heard before these instants (`batadv_purge_orig_node`).

        Where a neighbour is forgotten the best of the others is chosen.
        """
        for originator in [each for each, to in self.known.items() if to.seen_ns < gone_since_ns]:
            del self.known[originator]
        for to in self.known.values():
            silent = [node for node, each in to.by_neighbour.items() if each.seen_ns < silent_since_ns]
            for node in silent:
                del to.by_neighbour[node]
            if silent:
                ranked = sorted(to.by_neighbour, key=to.rank)
                to.router = ranked[0] if ranked else None
