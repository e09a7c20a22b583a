"""Slots as a medium's settings or a file list them: whose each is, how long, how fast, where, for what."""

from __future__ import annotations

from functools import cached_property
from typing import Annotated, Any

from pydantic import BeforeValidator, Field, WithJsonSchema, model_validator

from channel.access.media.schedule import Schedule, Slot
from channel.access.timing import NS_PER_S
from sitl_configs.settings import Settings, id_as_text


def _ids(value: Any) -> Any:
    """One id, or several; YAML reads some as numbers."""
    several = value if isinstance(value, list | tuple) else [value]
    return tuple(map(id_as_text, several))


ONE_ID = {"type": ["string", "integer"]}
Ids = Annotated[
    tuple[str, ...],
    BeforeValidator(_ids),
    WithJsonSchema({"anyOf": [ONE_ID, {"type": "array", "items": ONE_ID}]}),
]
"""Nodes: an id, or a list of them."""


class SlotSettings(Settings):
    """One slot of each round."""

    nodes: Ids = Field(min_length=1, description="who may transmit in it: an id, or several")
    duration_s: float = Field(gt=0.0, le=10.0, description="how long it lasts, its guard time included")
    start_s: float | None = Field(
        default=None, ge=0.0, le=1000.0, description="in the round; when the slot before it ends unless given"
    )
    guard_s: float | None = Field(
        default=None, ge=0.0, le=1.0, description="at its end; the schedule's unless given"
    )
    bit_rate_bps: float | None = Field(
        default=None, gt=0.0, le=1e12, description="of air time and errors; the medium's unless given"
    )
    channel: int = Field(default=0, ge=-1000, le=1000, description="the frequency: channel_spacing_hz apart")
    priority: int | None = Field(
        default=None,
        ge=-128,
        le=127,
        description="the class: it takes packets of this priority alone; of all unless given",
    )
    listeners: Ids = Field(
        default=(), description="who listens on its channel; all that are in no other slot unless given"
    )


class SlotSchedule(Settings):
    """Slots that come again and again, from a run's instant 0 on."""

    read_from: str = Field(default="", description="the file that it was read from")
    guard_s: float = Field(default=0.0, ge=0.0, le=1.0, description="at the end of slots without one")
    round_s: float | None = Field(
        default=None,
        gt=0.0,
        le=1000.0,
        description="until all comes again; the end of the last slot unless given",
    )
    slots: tuple[SlotSettings, ...] = Field(
        min_length=1, description="in any order; two at once on two channels"
    )

    @model_validator(mode="after")
    def _is_a_schedule(self) -> SlotSchedule:
        _ = self.by_id
        return self

    @cached_property
    def by_id(self) -> Schedule[str]:
        """Its slots, with the ids of nodes.

        Raises:
            ValueError: they cannot be: as `Schedule`.
        """
        slots: list[Slot[str]] = []
        for each in self.slots:
            start_ns = _ns(each.start_s) if each.start_s is not None else slots[-1].end_ns if slots else 0
            slots.append(
                Slot(
                    each.nodes,
                    start_ns,
                    _ns(each.duration_s),
                    _ns(self.guard_s if each.guard_s is None else each.guard_s),
                    each.bit_rate_bps,
                    each.channel,
                    each.priority,
                    each.listeners,
                )
            )
        last_ns = max(slot.end_ns for slot in slots)
        return Schedule(tuple(slots), last_ns if self.round_s is None else _ns(self.round_s))


def _ns(seconds: float) -> int:
    return round(seconds * NS_PER_S)
