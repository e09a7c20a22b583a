"""A medium of slots: each belongs to a node, which sends in it what fits."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

from channel.access.agenda import ACTS
from channel.access.air import Hearing
from channel.access.media.plain import PlainMedium
from channel.access.packets import AirPacket, Loss
from channel.access.queue import QueueLimits
from channel.access.timing import FrameTiming
from channel.access.world import World


@dataclass(frozen=True, slots=True)
class Schedule:
    """Slots that come again and again from instant 0.

    Attributes:
        owners: whose each slot is.
        slot_ns: how long each lasts, its guard time included.
        guard_ns: at the end of each, in which nobody transmits.
    """

    owners: tuple[int, ...]
    slot_ns: int
    guard_ns: int = 0

    def __post_init__(self) -> None:
        if not self.owners or not 0 <= self.guard_ns < self.slot_ns:
            raise ValueError(
                f"{len(self.owners)} slots of {self.slot_ns} ns with a guard of {self.guard_ns} ns: at least one slot, "
                "longer than its guard"
            )

    @property
    def round_ns(self) -> int:
        """Until the same slot comes again."""
        return len(self.owners) * self.slot_ns


class Tdma(PlainMedium):
    """Time division: nothing collides while clocks agree, which they do here.

    Args:
        world: nodes, powers, delays.
        timing: of frames; a packet whose frame is longer than a slot without its guard is too long.
        schedule: of slots; a node without one only listens: no slot has room for its packets.
        limits: of queues.
        hearing: how receivers hear.

    Raises:
        ValueError: a slot of a node that is not there, or a slot too short for any packet.
    """

    def __init__(
        self,
        world: World,
        timing: FrameTiming,
        schedule: Schedule,
        limits: QueueLimits | None = None,
        hearing: Hearing | None = None,
    ) -> None:
        unknown = set(schedule.owners) - set(world.nodes)
        if unknown:
            raise ValueError(f"slots of nodes {sorted(unknown)}, which are not on this network")
        super().__init__(world, timing, limits, hearing)
        self._schedule = schedule
        self._room_ns = schedule.slot_ns - schedule.guard_ns
        if timing.duration_ns(0) > self._room_ns:
            raise ValueError(
                f"slots of {schedule.slot_ns} ns: an empty frame takes {timing.duration_ns(0)} ns"
            )
        self._slots = {
            node: [index for index, owner in enumerate(schedule.owners) if owner == node]
            for node in world.nodes
        }
        self._waits: set[int] = set()
        """Nodes whose next slot is planned, or that are in one with something to send."""

    def _enter(self, packet: AirPacket) -> None:
        duration_ns = self._timing.duration_ns(min(packet.length_bytes, self._max_length_bytes))
        if duration_ns > self._room_ns or not self._slots[packet.node]:
            self._lost(packet, Loss.TOO_LONG)
        else:
            super()._enter(packet)

    def _wake(self, node: int) -> None:
        if node not in self._waits:
            self._waits.add(node)
            self.agenda.at(self._next_slot_ns(node, self.agenda.now_ns), ACTS, node, self._slot, node)

    def _next_slot_ns(self, node: int, from_ns: int) -> int:
        """The start of a node's next slot, at or after an instant."""
        schedule = self._schedule
        begin_ns = from_ns // schedule.round_ns * schedule.round_ns
        starts = [begin_ns + index * schedule.slot_ns for index in self._slots[node]]
        return next((at for at in starts if at >= from_ns), starts[0] + schedule.round_ns)

    def _slot(self, node: int) -> None:
        """A slot of a node begins."""
        self._send(node, self.agenda.now_ns + self._room_ns)

    def _send(self, node: int, until_ns: int) -> None:
        """Send the next packet if it fits, else wait for the next slot."""
        packet = self._first(node)
        if packet is None:
            self._waits.discard(node)
            return
        now_ns = self.agenda.now_ns
        if now_ns + self._timing.duration_ns(packet.length_bytes) > until_ns:
            self.agenda.at(self._next_slot_ns(node, now_ns + 1), ACTS, node, self._slot, node)
            return
        self._next(node)
        self._transmit(packet, partial(self._sent, node, until_ns))

    def _sent(self, node: int, until_ns: int) -> None:
        self.agenda.at(self.agenda.now_ns, ACTS, node, self._send, node, until_ns)
