"""One packet on its way over several nodes."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace
from math import isnan

from channel.access.packets import AirFate, AirFrame, AirPacket, Loss

Nearness = Callable[[AirFrame, int], float]
"""How far a frame's transmitter was from a node, m."""
Apart = Callable[[int, int, int], float]
"""How far two nodes are from each other at an instant, ns, m."""
NOWHERE = float("inf")


class Journey:
    """A packet from its sender to its receivers.

    Args:
        packet: as its sender gave it.
        receivers: whom it is for.
        distance_m: of a frame from a node.
        apart_m: of two nodes.

    Attributes:
        packet: as given.
        seen: nodes that have it.
        under_way: copies that are in a queue, on the air, or about to be.
    """

    __slots__ = ("_apart_m", "_distance_m", "_missed", "_open", "packet", "seen", "under_way")

    def __init__(
        self, packet: AirPacket, receivers: Iterable[int], distance_m: Nearness, apart_m: Apart
    ) -> None:
        self.packet, self._open = packet, set(receivers)
        self._distance_m, self._apart_m = distance_m, apart_m
        self.seen = {packet.node}
        self.under_way = 0
        self._missed: dict[int, tuple[float, AirFate]] = {}

    def came(self, fate: AirFate, leg: Leg) -> AirFate | None:
        """A node has it: what became of it there, if it is for that node and had not come yet."""
        node = fate.receiver
        if node not in self._open:
            return None
        self._open.discard(node)
        attempts = leg.attempts + fate.attempts
        return replace(fate, packet=self.packet, attempts=attempts, way=leg.way)

    def missed(self, fate: AirFate, leg: Leg) -> None:
        """A copy was lost at a node: this tells why it did not come, unless another was nearer.

        A copy for all is lost to the node that missed it; one for a next node to whom the packet is for.
        """
        distance_m = NOWHERE if fate.frame is None else self._distance_m(fate.frame, fate.receiver)
        distance_m = NOWHERE if isnan(distance_m) else distance_m
        lost_to = self._open if fate.packet.to is not None else self._open & {fate.receiver}
        attempts = leg.attempts + fate.attempts
        for node in lost_to:
            known = self._missed.get(node)
            if known is None or distance_m <= known[0]:
                found = replace(
                    fate,
                    packet=self.packet,
                    receiver=node,
                    attempts=attempts,
                    met_at=fate.receiver,
                    way=leg.way,
                )
                self._missed[node] = distance_m, found

    def stopped(self, loss: Loss, at_ns: int, last: AirFate | None, leg: Leg | None) -> None:
        """A node does not send it on: this tells why it did not come where that node is nearer than what was lost.

        `last` brought it there, None: it is its sender.
        """
        if last is None or leg is None:
            holder, found = self.packet.node, AirFate(self.packet, -1, at_ns, -1, -1, 0, loss)
        else:
            holder, attempts = last.receiver, leg.attempts + last.attempts
            found = replace(
                last, packet=self.packet, attempts=attempts, loss=loss, met_at=holder, way=leg.way
            )
        for node in self._open:
            distance_m, known = self._apart_m(holder, node, at_ns), self._missed.get(node)
            if known is None or distance_m < known[0]:
                self._missed[node] = distance_m, replace(found, receiver=node)

    def ended(self, now_ns: int) -> Iterator[AirFate]:
        """No copy is under way any more: what became of it where it did not come."""
        for node in sorted(self._open):
            _, fate = self._missed.get(node) or (NOWHERE, self._never(node))
            yield replace(fate, at_ns=now_ns)
        self._open.clear()

    def _never(self, node: int) -> AirFate:
        """No transmission was meant for it."""
        return AirFate(self.packet, node, -1, -1, -1, 0, Loss.NO_PEER)


@dataclass(frozen=True, slots=True)
class Leg:
    """One transmission of a journey.

    Attributes:
        journey: whose.
        way: who transmitted it, from its sender on, this one too.
        attempts: on the legs before it.
        copy: the how-manieth that its node transmits: a newer packet of the same key takes its place, not another copy.
    """

    journey: Journey
    way: tuple[int, ...]
    attempts: int
    copy: int = 0


@dataclass(slots=True)
class Cargo:
    """What a packet of the medium carries, and at how many nodes that is open.

    Attributes:
        leg: of a journey; None: it carries a notice.
        content: of the notice.
        open: nodes that have no fate of it yet.
        attempts: how often it was on the air when that was decided.
        frame_ns: how long each time; 0: it never was.
    """

    leg: Leg | None = None
    content: object = None
    open: int = 0
    attempts: int = 0
    frame_ns: int = 0


@dataclass(frozen=True, slots=True)
class HopPacket(AirPacket):
    """A packet as the medium gets it from a node that sends it, or hands it on.

    Attributes:
        cargo: what it carries.
    """

    cargo: Cargo = field(default_factory=Cargo, compare=False, repr=False)

    @property
    def is_from_above(self) -> bool:
        """Notices are routing's own."""
        return self.cargo.leg is not None

    @property
    def order(self) -> int:
        """As its first sender numbered it: an older packet may come over a longer way after a newer one."""
        return self.number if self.cargo.leg is None else self.cargo.leg.journey.packet.number
