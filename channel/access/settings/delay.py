"""A way from end to end, known by its rate and its delays: ``medium: {model: delay}``."""

from __future__ import annotations

from typing import ClassVar, Literal

from pydantic import Field, model_validator

from channel.access.media.delay import LONGEST_S, Delay, DelaySettings, WayDelay
from channel.access.media.medium import AccessMedium
from channel.access.settings.base import Queue, Surroundings
from channel.access.timing import NS_PER_S
from channel.variant import Variant


class DelayMedium(Variant):
    """LTE, satellites: delays, a rate, an outage that comes and goes; nodes do not disturb each other."""

    takes_time: ClassVar[bool] = True
    is_shared: ClassVar[bool] = False
    model: Literal["delay"] = "delay"
    queue: Queue = Field(default_factory=Queue)
    least_s: float = Field(ge=0.0, le=60.0, description="no packet is faster")
    median_s: float = Field(ge=0.0, le=60.0, description="half are at most so late")
    most_s: float = Field(ge=0.0, le=60.0, description="95 % are at most so late; as median_s: all are")
    rate_bps: float = Field(gt=0.0, le=1e12, description="at which a node's packets enter the network")
    header_bytes: int = Field(default=0, ge=0, le=1000, description="that each packet gets")
    good_s: float = Field(default=60.0, gt=0.0, le=LONGEST_S, description="mean time of service of a node")
    bad_s: float = Field(default=0.0, ge=0.0, le=LONGEST_S, description="mean time of outage; 0: none")
    keeps_order: bool = Field(default=True, description="no packet of a sender overtakes another")
    max_length_bytes: int = Field(default=65_535, ge=1, description="the longest packet")

    @model_validator(mode="after")
    def _is_a_delay(self) -> DelayMedium:
        self._delay()
        return self

    def _delay(self) -> WayDelay:
        return WayDelay(*(round(each * NS_PER_S) for each in (self.least_s, self.median_s, self.most_s)))

    def open(self, surroundings: Surroundings) -> AccessMedium:
        """Make the medium."""
        settings = DelaySettings(
            self._delay(),
            self.rate_bps,
            header_bytes=self.header_bytes,
            good_s=self.good_s,
            bad_s=self.bad_s,
            keeps_order=self.keeps_order,
        )
        return Delay(
            surroundings.world,
            settings,
            seed=surroundings.seed,
            limits=self.queue.limits,
            max_length_bytes=self.max_length_bytes,
        )

    def carriers(self) -> None:
        """Only the way from end to end is known: other networks neither hear it nor disturb it."""

    def capacity_bps(self, length_bytes: int, bit_rate_bps: float) -> float:  # noqa: ARG002
        """Bits of packets of a length per second, of each sender."""
        return self.rate_bps * length_bytes / (length_bytes + self.header_bytes)
