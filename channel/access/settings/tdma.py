"""Slots: ``medium: {model: tdma, slot_s: 0.01}``."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Literal

from pydantic import Field, model_validator

from channel.access.media.medium import AccessMedium
from channel.access.media.schedule import Schedule, Slot
from channel.access.media.tdma import Tdma
from channel.access.settings.base import Serial, Surroundings
from channel.access.settings.slots import SlotSchedule
from channel.access.timing import NS_PER_S


class TdmaMedium(Serial):
    """Each node transmits in its slots."""

    model: Literal["tdma"] = "tdma"
    slot_s: float | None = Field(
        default=None, gt=0.0, le=10.0, description="how long each lasts, its guard time included"
    )
    guard_s: float = Field(default=0.0, ge=0.0, le=1.0, description="at the end of each")
    slots: tuple[str, ...] = Field(default=(), description="whose each is; one each, as listed, unless given")
    schedule: SlotSchedule | None = Field(
        default=None,
        description="of slots that differ, in the place of the three; or schedule_file, a YAML file",
    )

    @model_validator(mode="after")
    def _has_slots(self) -> TdmaMedium:
        if (self.slot_s is None) == (self.schedule is None):
            raise ValueError("has to have either slot_s or schedule")
        if self.schedule is not None:
            beside = [key for key in ("guard_s", "slots", "channels") if getattr(self, key)]
            if beside:
                raise ValueError(f"{', '.join(beside)}: the slots of a schedule have their own")
        elif self.slot_s is not None and self.guard_s >= self.slot_s:
            raise ValueError(f"slots of {self.slot_s:g} s with a guard of {self.guard_s:g} s have no room")
        return self

    def _by_id(self, nodes: Iterable[str]) -> Schedule[str]:
        """The schedule; generated, if it is not spelt out."""
        if self.schedule is not None:
            return self.schedule.by_id
        slot_ns = round((self.slot_s or 0.0) * NS_PER_S)
        return _equal(self.slots or tuple(nodes), slot_ns, round(self.guard_s * NS_PER_S))

    def has_slot(self, node: str) -> bool:
        """Whether a node, by its id, has a slot; one without only listens."""
        return any(node in slot.nodes for slot in self._by_id((node,)).slots)

    @property
    def rates_bps(self) -> tuple[float, ...]:
        """The bit rates of slots that have one of their own, rising."""
        slots = () if self.schedule is None else self.schedule.slots
        return tuple(sorted({slot.bit_rate_bps for slot in slots if slot.bit_rate_bps is not None}))

    def channels_used(self) -> frozenset[int]:
        """Those of its slots, too."""
        of_slots = self._by_id(()).channels if self.schedule is not None else frozenset()
        return super().channels_used() | of_slots

    def open(self, surroundings: Surroundings) -> AccessMedium:
        """Make the medium.

        Raises:
            ValueError: a slot of a node that is not there, or slots too short for any packet.
        """
        timing, hearing = self.timings(surroundings), self.hearing(surroundings)
        try:
            schedule = self._by_id(surroundings.nodes).placed(surroundings.place)
            return Tdma(surroundings.world, timing, schedule, self.queue.limits, hearing)
        except ValueError as error:
            if self.schedule is None or not self.schedule.read_from:
                raise
            raise ValueError(f"{self.schedule.read_from}: {error}") from error

    def capacity_bps(self, length_bytes: int, bit_rate_bps: float) -> float:
        """Bits of packets of a length per second, if every slot is filled with what fits in it; 0 if none does."""
        schedule = self._by_id(("",))
        return self._carried_bps(length_bytes, bit_rate_bps, schedule.slots, schedule.round_ns)

    def node_capacity_bps(
        self, node: str, nodes: Sequence[str], length_bytes: int, bit_rate_bps: float, priority: int | None
    ) -> float:
        """Bits of packets of a length per second in the slots of one node.

        Args:
            node: its id.
            nodes: all ids, in their order.
            length_bytes: of each packet.
            bit_rate_bps: of the radio.
            priority: of the packets; None: of any.
        """
        schedule = self._by_id(nodes)
        own = [
            replace(slot, nodes=(node,))
            for slot in schedule.slots
            if node in slot.nodes and (priority is None or slot.takes(priority))
        ]
        return self._carried_bps(length_bytes, bit_rate_bps, own, schedule.round_ns)

    def _carried_bps(
        self, length_bytes: int, bit_rate_bps: float, slots: Iterable[Slot[str]], round_ns: int
    ) -> float:
        packets = 0
        for slot in slots:
            at_rate = self.model_copy(update={"bit_rate_bps": slot.bit_rate_bps or self.bit_rate_bps})
            frame_ns = max(1, round(at_rate.duration_s(length_bytes, bit_rate_bps) * NS_PER_S))
            packets += len(slot.nodes) * (slot.room_ns // frame_ns)
        return 8 * length_bytes * packets * NS_PER_S / round_ns


@lru_cache(maxsize=16)
def _equal(owners: tuple[str, ...], slot_ns: int, guard_ns: int) -> Schedule[str]:
    """Slots of one length: those of a large fleet are asked for with each kind of packet."""
    return Schedule.equal(owners, slot_ns, guard_ns)
