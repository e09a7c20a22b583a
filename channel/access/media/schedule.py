"""Slots: who transmits when, at what rate and on which channel, and who listens there."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

from channel.access.timing import NS_PER_S

N = TypeVar("N", bound=Hashable)
"""What names a node: its id, or its place."""
M = TypeVar("M", bound=Hashable)


@dataclass(frozen=True, slots=True)
class Slot(Generic[N]):
    """A stretch of each round.

    Attributes:
        nodes: who may transmit in it; of several, each as if it were alone.
        start_ns: from the begin of the round.
        duration_ns: its guard time included.
        guard_ns: at its end, in which nobody transmits.
        bit_rate_bps: of its frames; None: that of the medium.
        channel: on which its nodes transmit.
        priority: of the packets that it takes; None: of all.
        listeners: who listens on its channel; empty: all that no other slot keeps busy at the time.
    """

    nodes: tuple[N, ...]
    start_ns: int
    duration_ns: int
    guard_ns: int = 0
    bit_rate_bps: float | None = None
    channel: int = 0
    priority: int | None = None
    listeners: tuple[N, ...] = ()

    @property
    def room_ns(self) -> int:
        """For transmissions, from its start on."""
        return self.duration_ns - self.guard_ns

    @property
    def end_ns(self) -> int:
        """From the begin of the round."""
        return self.start_ns + self.duration_ns

    def takes(self, priority: int) -> bool:
        """Whether packets of a priority may be sent in it."""
        return self.priority is None or self.priority == priority


@dataclass(frozen=True, slots=True)
class Schedule(Generic[N]):
    """Slots that come again and again from instant 0.

    Attributes:
        slots: in the order of their starts.
        round_ns: until the same slot comes again.

    Raises:
        ValueError: no slots, one without room, one beyond the round, or two at once that exclude each other.
    """

    slots: tuple[Slot[N], ...]
    round_ns: int

    def __post_init__(self) -> None:
        if not self.slots:
            raise ValueError("slots: at least one")
        for index, slot in enumerate(self.slots):
            if not 0 <= slot.guard_ns < slot.duration_ns:
                text = f"a slot of {_s(slot.duration_ns)} with a guard of {_s(slot.guard_ns)} has no room"
                raise ValueError(f"slots.{index}: {text}")
            if not 0 <= slot.start_ns <= slot.end_ns <= self.round_ns:
                ends, round_ends = _s(slot.end_ns), _s(self.round_ns)
                text = f"from {_s(slot.start_ns)} to {ends} is not within the round of {round_ends}"
                raise ValueError(f"slots.{index}: {text}")
        for here, there in _at_once(self.slots):
            if clash := _clash(self.slots[here], self.slots[there]):
                raise ValueError(f"slots.{there}: it runs at the time of slots.{here}: {clash}")

    @classmethod
    def equal(cls, owners: Sequence[N], slot_ns: int, guard_ns: int = 0) -> Schedule[N]:
        """Slots of one length, one after the other, each with one owner."""
        slots = (Slot((owner,), index * slot_ns, slot_ns, guard_ns) for index, owner in enumerate(owners))
        return cls(tuple(slots), len(owners) * slot_ns)

    def placed(self, place: Callable[[N], M]) -> Schedule[M]:
        """The same with other names of nodes."""
        return Schedule(
            tuple(
                Slot(
                    tuple(map(place, slot.nodes)),
                    slot.start_ns,
                    slot.duration_ns,
                    slot.guard_ns,
                    slot.bit_rate_bps,
                    slot.channel,
                    slot.priority,
                    tuple(map(place, slot.listeners)),
                )
                for slot in self.slots
            ),
            self.round_ns,
        )

    @property
    def nodes(self) -> frozenset[N]:
        """All that it names."""
        return frozenset(node for slot in self.slots for node in (*slot.nodes, *slot.listeners))

    @property
    def channels(self) -> frozenset[int]:
        """All that its slots are on."""
        return frozenset(slot.channel for slot in self.slots)

    def tunings(self, nodes: Iterable[N]) -> list[tuple[int, Mapping[N, int]]]:
        """When in the round radios turn to which channels: at each start and end of a slot.

        Who neither transmits nor listens by name is on the channel of the slot that names no listeners; without
        one it stays where it was.
        """
        everybody = tuple(nodes)
        borders = {border for slot in self.slots for border in (slot.start_ns, slot.end_ns)}
        instants = sorted(borders - {self.round_ns})
        return [(at_ns, self._tuned(everybody, at_ns)) for at_ns in instants]

    def _tuned(self, everybody: Sequence[N], at_ns: int) -> Mapping[N, int]:
        running = [slot for slot in self.slots if slot.start_ns <= at_ns < slot.end_ns]
        tuned: dict[N, int] = {}
        for slot in running:
            if not slot.listeners:
                tuned.update(dict.fromkeys(everybody, slot.channel))
        for slot in running:
            tuned.update(dict.fromkeys((*slot.nodes, *slot.listeners), slot.channel))
        return tuned


def _s(time_ns: int) -> str:
    return f"{time_ns / NS_PER_S:g} s"


def _at_once(slots: Sequence[Slot[N]]) -> Iterator[tuple[int, int]]:
    """Places of any two that run at some instant together, the smaller first."""
    running: list[int] = []
    for place in sorted(range(len(slots)), key=lambda place: slots[place].start_ns):
        running = [other for other in running if slots[other].end_ns > slots[place].start_ns]
        yield from ((min(other, place), max(other, place)) for other in running)
        running.append(place)


def _clash(one: Slot[N], other: Slot[N]) -> str:
    """Why two slots cannot run at once; empty if they can."""
    both = {*one.nodes, *one.listeners} & {*other.nodes, *other.listeners}
    if both:
        return f"{', '.join(sorted(map(str, both)))} cannot be in both"
    if one.channel == other.channel:
        return f"both are on channel {one.channel}; nodes that are to share a slot stand in its nodes"
    if not one.listeners and not other.listeners:
        return "only one of them can be without listeners"
    return ""
