"""A medium of slots: each belongs to a node, or several, that send in it what fits."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import partial

from channel.access.agenda import ACTS, SIGNAL_ENDS
from channel.access.air import Hearing
from channel.access.media.plain import PlainMedium
from channel.access.media.schedule import Schedule, Slot
from channel.access.packets import AirPacket, Loss
from channel.access.queue import QueueLimits
from channel.access.timing import BitRate
from channel.access.world import World

__all__ = ["Schedule", "Slot", "Tdma"]


class Tdma(PlainMedium):
    """Time division: nothing collides while clocks agree, which they do here, and each slot has one node.

    With slots on several channels, radios turn to them as the slots begin. What is still on its way to one that turns
    away is lost: a guard time has to be longer than that way.

    Args:
        world: nodes, powers, delays.
        timing: of frames, at the bit rate of slots that have none of their own: one for all, or by who transmits them.
        schedule: of slots; a packet that none of its node's slots has room for is too long.
        limits: of queues.
        hearing: how receivers hear.

    Raises:
        ValueError: a slot of a node that is not there, or a slot too short for any packet.
    """

    def __init__(
        self,
        world: World,
        timing: BitRate | Mapping[int, BitRate],
        schedule: Schedule[int],
        limits: QueueLimits | None = None,
        hearing: Hearing | None = None,
    ) -> None:
        unknown = schedule.nodes - set(world.nodes)
        if unknown:
            raise ValueError(f"slots of nodes {sorted(unknown)}, which are not on this network")
        super().__init__(world, timing, limits, hearing)
        self._round_ns = schedule.round_ns
        timings = timing if isinstance(timing, Mapping) else dict.fromkeys(world.nodes, timing)
        self._timings = {
            (slot, node): _timing_in(slot, timings[node]) for slot in schedule.slots for node in slot.nodes
        }
        for index, slot in enumerate(schedule.slots):
            empty_ns = max((self._timings[slot, node].duration_ns(0) for node in slot.nodes), default=0)
            if empty_ns > slot.room_ns:
                text = f"its {slot.room_ns} ns have no room for an empty frame, which takes {empty_ns} ns"
                raise ValueError(f"slots.{index}: {text}")
        in_order = sorted(schedule.slots, key=lambda slot: slot.start_ns)
        self._slots = {node: [slot for slot in in_order if node in slot.nodes] for node in world.nodes}
        self._waits: set[int] = set()
        """Nodes whose next slot is planned, or that are in one with something to send."""
        self._last = max(world.nodes) + 1
        """In the order of an instant: after all nodes."""
        self._tunings = schedule.tunings(world.nodes) if schedule.channels != {0} else []
        if self._tunings:
            self._plan_turn(0, 0)

    def _plan_turn(self, number: int, round_begins_ns: int) -> None:
        """Radios turn at the start of a slot, after what ends at that instant."""
        at_ns = round_begins_ns + self._tunings[number][0]
        self.agenda.at(at_ns, SIGNAL_ENDS, self._last, self._turn, number, round_begins_ns)

    def _turn(self, number: int, round_begins_ns: int) -> None:
        for node, channel in self._tunings[number][1].items():
            self._receivers[node].tune(channel)
        is_last = number + 1 == len(self._tunings)
        self._plan_turn(
            *((0, round_begins_ns + self._round_ns) if is_last else (number + 1, round_begins_ns))
        )

    def _enter(self, packet: AirPacket) -> None:
        length_bytes = min(packet.length_bytes, self._max_length_bytes)
        fitting = (
            slot.takes(packet.priority)
            and self._timings[slot, packet.node].duration_ns(length_bytes) <= slot.room_ns
            for slot in self._slots[packet.node]
        )
        if any(fitting):
            super()._enter(packet)
        else:
            self._lost(packet, Loss.TOO_LONG)

    def _wake(self, node: int) -> None:
        if node not in self._waits:
            self._waits.add(node)
            self._plan(node, self.agenda.now_ns)

    def _plan(self, node: int, from_ns: int) -> None:
        """Send in a node's next slot, which starts at or after an instant."""
        begin_ns = from_ns // self._round_ns * self._round_ns
        starts = ((begin_ns + slot.start_ns, slot) for slot in self._slots[node])
        first = self._slots[node][0]
        after = begin_ns + self._round_ns + first.start_ns, first
        at_ns, slot = next((start for start in starts if start[0] >= from_ns), after)
        self.agenda.at(at_ns, ACTS, node, self._send, node, slot, at_ns + slot.room_ns)

    def _send(self, node: int, slot: Slot[int], until_ns: int) -> None:
        """Send the next packet of the slot's class if it fits; else the node waits for its next slot, if it has any."""
        packet, now_ns = self._first(node, slot.priority), self.agenda.now_ns
        timing = self._timings[slot, node]
        if packet is not None and now_ns + timing.duration_ns(packet.length_bytes) <= until_ns:
            self._next(node, slot.priority)
            then = partial(self._sent, node, slot, until_ns)
            self._transmit(packet, then, timing, slot.bit_rate_bps)
        elif self.queued(node)[0]:
            self._plan(node, until_ns + slot.guard_ns)
        else:
            self._waits.discard(node)

    def _sent(self, node: int, slot: Slot[int], until_ns: int) -> None:
        self.agenda.at(self.agenda.now_ns, ACTS, node, self._send, node, slot, until_ns)


def _timing_in(slot: Slot[int], timing: BitRate) -> BitRate:
    """Of frames in a slot."""
    return timing if slot.bit_rate_bps is None else replace(timing, bitrate_bps=slot.bit_rate_bps)
