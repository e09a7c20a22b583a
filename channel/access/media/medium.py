"""What all media have in common: packets in, outcomes out, one queue per node."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from math import inf
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from channel.access.agenda import ACTS, Agenda, WholeAgenda
from channel.access.packets import AirFate, AirFates, AirFrame, AirPacket, Loss, Outcome, Reply
from channel.access.queue import QueueLimits, TransmitQueue
from channel.access.world import Foreseeing, Identified, Parted, Rows, Switched, World
from sitl_configs.own_code import is_own

if TYPE_CHECKING:
    from channel.access.air import Air


class AccessMedium(ABC):
    """One radio network: who is on it transmits when its rules allow.

    Args:
        world: its nodes, and what lies between them.
        limits: of each node's queue.
        max_length_bytes: the longest packet.

    `offer` packets in any order, each not before the instant that `run` came to, then `run`: the outcomes come in the
    order of their instants, then of their packets and receivers. Each packet has one `AirFate` per receiver: the node
    that it is for, all others, or those of a group.

    Attributes:
        ids: of its nodes, by number: by them they draw, and come one after the other at one instant.
        agenda: what happens when.
        air: what its receivers hear; None: they sense no carrier.
    """

    air: Air | None = None

    def __init__(self, world: World, limits: QueueLimits, max_length_bytes: int) -> None:
        self.world = world
        self.ids, order = _ids(world)
        self.agenda = WholeAgenda(order) if is_own(type(self)) else Agenda(order)
        self._outboxes = {node: TransmitQueue(limits) for node in sorted(world.nodes)}
        self._max_length_bytes = max_length_bytes
        self._outcomes: list[Outcome | AirFates] = []
        self._listener: Callable[[Outcome], object] | None = None
        self._foresees = world if isinstance(world, Foreseeing) else None
        self._switched = world if isinstance(world, Switched) else None
        self._parted = world if isinstance(world, Parted) else None
        self._offered: list[AirPacket] = []
        """Packets that have not entered yet, for a world that foresees."""

    def foresees_nothing(self) -> None:
        """Its world looks at frames one by one: others are run with it, whom nobody asks to forget."""
        self._foresees = None

    def tells(self, listener: Callable[[Outcome], object]) -> None:
        """Give each outcome to a listener as it comes, at its instant; `run` has none then. Nothing was run yet."""
        self._listener = listener
        self.foresees_nothing()
        if self.air is not None:
            self.air.passes_singly()

    def offer(self, packet: AirPacket) -> None:
        """Have a packet enter its sender's radio at its instant.

        Raises:
            ValueError: a node that is not on this network, or an instant that has passed.
        """
        for node in (packet.node,) if packet.to is None else (packet.node, packet.to):
            if node not in self._outboxes:
                raise ValueError(f"node {node} is not on this network: {', '.join(map(str, self._outboxes))}")
        if packet.to == packet.node:
            raise ValueError(f"node {packet.node} sends to itself")
        self.agenda.at(packet.at_ns, ACTS, packet.node, self._is_given, packet)
        if self._foresees is not None:
            self._offered.append(packet)

    def run(self, until_ns: int) -> list[Outcome]:
        """Let the network live until an instant; what came of packets since the last call."""
        singly: list[Outcome] = []
        for outcome in self.live(until_ns):
            singly += outcome.singly() if isinstance(outcome, AirFates) else (outcome,)
        return sorted(singly, key=_order)

    def live(self, until_ns: int) -> list[Outcome | AirFates]:
        """As `run`, in no order, and fates of one frame together where it passed receivers as a whole."""
        if self._foresees is not None:
            entering = [packet for packet in self._offered if packet.at_ns <= until_ns]
            self._offered = [packet for packet in self._offered if packet.at_ns > until_ns]
            self._foresees.forget()
            self._foresee(self._foresees, entering)
        self.agenda.run(until_ns)
        outcomes, self._outcomes = self._outcomes, []
        return outcomes

    def is_off(self, node: int, at_ns: int) -> bool:
        """Whether a node's radio is off at an instant."""
        return self._switched is not None and self._switched.is_off(node, at_ns)

    def are_apart(self, node: int, other: int, at_ns: int) -> bool:
        """Whether a partition is between two nodes at an instant."""
        return self._parted is not None and self._parted.are_apart(node, other, at_ns)

    def queued(self, node: int) -> tuple[int, int]:
        """How many packets of a node wait, and their bytes; one of which a part was sent waits with what is left."""
        outbox, beside_bytes = self._outboxes[node], self._beside_bytes(node)
        return len(outbox) + (beside_bytes > 0), outbox.length_bytes + beside_bytes

    def waiting_bytes(self, node: int) -> int:
        """All bytes of a node that wait."""
        return self.queued(node)[1]

    def receivers_of(self, packet: AirPacket) -> tuple[int, ...]:
        """Who has a fate of it."""
        if packet.to is not None:
            return (packet.to,)
        return tuple(node for node in self._outboxes if packet.is_for(node))

    def _foresee(self, world: Foreseeing, entering: Sequence[AirPacket]) -> None:
        """Have the world look together at frames that are likely to come of packets that enter now.

        A wrong guess costs time and changes nothing.
        """
        del world, entering

    @abstractmethod
    def _wake(self, node: int) -> None:
        """Something is in a queue that may have been empty."""

    def _beside_bytes(self, node: int) -> int:
        """What is left of a packet that a node has begun to send: it waits beside the queue."""
        del node
        return 0

    def _is_given(self, packet: AirPacket) -> None:
        if self.is_off(packet.node, self.agenda.now_ns):
            self._lost(packet, Loss.RADIO_OFF)
        else:
            self._enter(packet)

    def _enter(self, packet: AirPacket) -> None:
        if packet.length_bytes > self._max_length_bytes:
            self._lost(packet, Loss.TOO_LONG)
            return
        outbox, beside_bytes = self._outboxes[packet.node], self._beside_bytes(packet.node)
        for lost, loss in outbox.put(packet, self.agenda.now_ns, beside_bytes):
            self._lost(lost, loss)
        self._wake(packet.node)

    def _next(self, node: int, priority: int | None = None) -> AirPacket | None:
        """The packet that leaves a node's queue now, of a priority if one is given."""
        packet, expired = self._outboxes[node].take(self.agenda.now_ns, priority)
        self._expired(expired)
        return packet

    def _first(self, node: int, priority: int | None = None) -> AirPacket | None:
        """The packet that would leave next, and stays; of a priority if one is given."""
        packet, expired = self._outboxes[node].look(self.agenda.now_ns, priority)
        self._expired(expired)
        return packet

    def _expired(self, packets: list[AirPacket]) -> None:
        for packet in packets:
            self._lost(packet, Loss.EXPIRED)

    def _book(
        self,
        packet: AirPacket,
        receiver: int,
        frame: AirFrame | None,
        attempts: int,
        loss: Loss | None,
        parts: int = 1,
    ) -> None:
        """What became of a packet at a node, if it is for that; by the frame that decided, None if there was none."""
        if not packet.is_for(receiver):
            return
        now_ns = self.agenda.now_ns
        started_ns, ended_ns = (-1, -1) if frame is None else (frame.started_ns, frame.ended_ns)
        at_ns = max(now_ns, ended_ns)
        self._tell(AirFate(packet, receiver, at_ns, started_ns, ended_ns, attempts, loss, frame, parts=parts))

    def _tell(self, outcome: Outcome) -> None:
        if self._listener is None:
            self._outcomes.append(outcome)
        else:
            self._listener(outcome)

    def _book_all(
        self, frame: AirFrame, receiver: Rows, at_ns: NDArray[np.int64], came: NDArray[np.bool_]
    ) -> None:
        """What became of a packet to all, or to a group, at several nodes; of those that it is for."""
        packet = frame.packet
        assert packet is not None
        if packet.members is not None:
            own = np.isin(receiver, list(packet.members))
            receiver, at_ns, came = receiver[own], at_ns[own], came[own]
        if receiver.size:
            self._outcomes.append(AirFates(packet, frame, receiver, at_ns, came))

    def _lost(self, packet: AirPacket, loss: Loss) -> None:
        """Lost before it was on the air, for all that it was for."""
        for receiver in self.receivers_of(packet):
            self._book(packet, receiver, None, 0, loss)
        if packet.to is not None:
            self._tell(Reply(packet, self.agenda.now_ns, acknowledged=False, attempts=0))


def _ids(world: World) -> tuple[Mapping[int, str], Mapping[int, int]]:
    """The id of each node, and its place by these; its number where it has none."""
    nodes = list(world.nodes)
    if not isinstance(world, Identified):
        return {node: str(node) for node in nodes}, {}
    ids = dict(zip(nodes, world.ids, strict=True))
    places = sorted(nodes)
    return ids, dict(zip(sorted(nodes, key=ids.__getitem__), places, strict=True))


def _order(outcome: Outcome) -> tuple[int, int, int, float]:
    """What a sender learns comes after what happened."""
    receiver = outcome.receiver if isinstance(outcome, AirFate) else inf
    return outcome.at_ns, outcome.packet.node, outcome.packet.number, receiver
