"""ExpressLRS with MAVLink: ``medium: {model: elrs}``."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar, Literal

from pydantic import Field, field_validator

from channel.access.elrs_modes import ELRS_MODES
from channel.access.media.elrs import Elrs, ElrsSettings
from channel.access.media.medium import AccessMedium
from channel.access.reception.carriers import Carriers
from channel.access.settings.base import Surroundings, two_by_two
from channel.variant import Variant


class ElrsMedium(Variant):
    """ExpressLRS with MAVLink: a transmitter module and a receiver take turns."""

    takes_time: ClassVar[bool] = True
    is_shared: ClassVar[bool] = False
    model: Literal["elrs"] = "elrs"
    mode: str = Field(default="lora-500", description=f"one of {', '.join(ELRS_MODES)}")
    pairs: tuple[tuple[str, str], ...] = Field(
        default=(), description="ids, the transmitter module's first; two by two as listed unless given"
    )
    has_rc: bool = Field(default=True, description="a remote control has every second slot up")
    buffer_bytes: int = Field(default=1024, ge=1, le=1 << 20, description="that wait at each end")

    @field_validator("mode")
    @classmethod
    def _is_known(cls, mode: str) -> str:
        if mode not in ELRS_MODES:
            raise ValueError(f"has to be one of: {', '.join(ELRS_MODES)}")
        return mode

    @property
    def max_length_bytes(self) -> int:
        """The longest packet."""
        return self.buffer_bytes

    def links(self, nodes: Sequence[str]) -> dict[str, tuple[str, ...]]:
        """Who hears whom: pairs by number, the transmitter module's first.

        Args:
            nodes: all ids, in their order.
        """
        return {
            f"pair {number}": pair for number, pair in enumerate(self.pairs or two_by_two(nodes), start=1)
        }

    def open(self, surroundings: Surroundings) -> AccessMedium:
        """Make the medium.

        Raises:
            ValueError: a pair of a node that is not there.
        """
        pairs = tuple((surroundings.place(one), surroundings.place(other)) for one, other in self.pairs)
        settings = ElrsSettings(ELRS_MODES[self.mode], pairs, self.has_rc, self.buffer_bytes)
        return Elrs(surroundings.world, settings, seed=surroundings.seed)

    def carriers(self) -> Carriers:
        """Where it is on the air."""
        return ELRS_MODES[self.mode].carriers

    def capacity_bps(self, length_bytes: int, bit_rate_bps: float) -> float:  # noqa: ARG002
        """User bits a second of a stream down, in full chunks."""
        return 8 * ELRS_MODES[self.mode].user_bytes_per_s

    def node_capacity_bps(self, node: str, nodes: Sequence[str]) -> float:
        """User bits a second of a stream from one node, in full chunks: up from a transmitter module, else down.

        Args:
            node: its id.
            nodes: all ids, in their order.
        """
        mode = ELRS_MODES[self.mode]
        if any(node == transmitter for transmitter, _ in self.links(nodes).values()):
            return 8 * mode.user_bytes_up_per_s(has_rc=self.has_rc)
        return 8 * mode.user_bytes_per_s
