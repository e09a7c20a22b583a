"""A way from end to end, known by its rate and its delays: ``medium: {model: delay}``."""

from __future__ import annotations

from typing import ClassVar, Literal

from pydantic import Field, model_validator

from channel.access.media.delay import LEAST_S, LONGEST_S, Delay, DelaySettings, WayDelay
from channel.access.media.medium import AccessMedium
from channel.access.settings.base import Queue, Surroundings
from channel.access.timing import LEAST_BPS, NS_PER_S
from channel.variant import Variant
from sitl_configs.settings import refused


class DelayMedium(Variant):
    """LTE, satellites: delays, a rate, an outage that comes and goes; nodes do not disturb each other."""

    takes_time: ClassVar[bool] = True
    is_shared: ClassVar[bool] = False
    model: Literal["delay"] = "delay"
    queue: Queue = Field(default_factory=Queue)
    least_s: float = Field(ge=0.0, le=60.0, description="no packet is faster")
    median_s: float = Field(ge=0.0, le=60.0, description="half are at most so late")
    most_s: float = Field(ge=0.0, le=60.0, description="95 % are at most so late; as median_s: all are")
    rate_bps: float = Field(ge=LEAST_BPS, le=1e12, description="at which a node's packets enter the network")
    header_bytes: int = Field(default=0, ge=0, le=1000, description="that each packet gets")
    good_s: float = Field(
        default=60.0, ge=LEAST_S, le=LONGEST_S, description="mean time of service of a node"
    )
    bad_s: float = Field(default=0.0, ge=0.0, le=LONGEST_S, description="mean time of outage; 0: none")
    keeps_order: bool = Field(default=True, description="no packet of a sender overtakes another")
    max_length_bytes: int = Field(default=65_535, ge=1, description="the longest packet")

    @model_validator(mode="after")
    def _is_a_delay(self) -> DelayMedium:
        for key, lower in (("median_s", "least_s"), ("most_s", "median_s")):
            value_s, lower_s = getattr(self, key), getattr(self, lower)
            if value_s < lower_s:
                raise refused(f"has to be at least {lower}, {lower_s:g}, not {value_s:g}", key)
        least_ns, median_ns, most_ns = self._delays_ns
        if least_ns == median_ns < most_ns:
            raise refused(f"has to be above least_s, {self.least_s:g}, unless most_s is the same", "median_s")
        if 0.0 < self.bad_s < LEAST_S:
            raise refused(f"has to be 0, or at least {LEAST_S:g}, not {self.bad_s:g}", "bad_s")
        return self

    @property
    def up_share(self) -> float:
        """Share of packets that meet no outage, neither of their sender nor of their receiver."""
        return (self.good_s / (self.good_s + self.bad_s)) ** 2

    def _delay(self) -> WayDelay:
        return WayDelay(*self._delays_ns)

    @property
    def _delays_ns(self) -> tuple[int, int, int]:
        return round(self.least_s * NS_PER_S), round(self.median_s * NS_PER_S), round(self.most_s * NS_PER_S)

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
