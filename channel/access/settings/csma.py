"""IEEE 802.11's DCF: ``medium: {model: csma, rate_mbps: 6}``."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

from pydantic import Field, model_validator

from channel.access.air import Hearing
from channel.access.media.csma import Csma, DcfSettings
from channel.access.media.medium import AccessMedium
from channel.access.settings.base import Shared, Surroundings
from channel.access.timing import NS_PER_S, Wifi, wifi_a, wifi_b, wifi_g
from channel.numbers.units import SPEED_OF_LIGHT_MPS

CCA_OFDM_NS, CCA_DSSS_NS = 4_000, 15_000
"""aCCATime of 802.11a and g, and of b (IEEE 802.11-2020, tables 17-21 and 16-4): until a carrier is sensed.

That of OFDM is in channels of 20 MHz; it is 8 us in those of 10 MHz and 16 us in those of 5 MHz.
"""
ENERGY_OFDM_DBM = {1.0: -62.0, 0.5: -65.0, 0.25: -68.0}
"""By clock, 17.3.10.6: 20 dB above the least sensitivity that 20, 10 and 5 MHz have to have."""
ENERGY_DSSS_DBM = -73.0
"""Of 802.11b with 50 to 100 mW, 16.3.8.5: above it is -76 dBm, below -70 dBm; the power is not known here."""


def standard_energy_dbm(standard: str, clock: float = 1.0) -> float:
    """Return the power from which on the standard has any energy sensed as a carrier, dBm."""
    return ENERGY_DSSS_DBM if standard == "11b" else ENERGY_OFDM_DBM[clock]


class CsmaMedium(Shared):
    """IEEE 802.11 DCF without an access point."""

    model: Literal["csma"] = "csma"
    standard: Literal["11b", "11a", "11g"] = "11g"
    rate_mbps: float = Field(
        default=6.0,
        gt=0.0,
        description="of unicasts: how long they last; their errors are those of the radio's bit_rate_bps",
    )
    basic_rate_mbps: float | None = Field(
        default=None, gt=0.0, description="of broadcasts and control frames; the lowest unless given"
    )
    clock: float = Field(default=1.0, description="of the symbols: 0.5 and 0.25 are channels of 10 and 5 MHz")
    header_bytes: int = Field(
        default=0,
        ge=0,
        le=1000,
        description="of the layers above, within the MAC's frame of each packet; 28 are those of IPv4 and UDP",
    )
    short_preamble: bool = Field(default=False, description="of 11b")
    attempts_max: int = Field(default=7, ge=1, le=255, description="of a unicast, then it is given up")
    rts_from_bytes: int | None = Field(
        default=None, ge=0, description="unicasts whose packets are so long, or longer, are announced"
    )
    reach_m: float = Field(
        default=3000.0,
        ge=0.0,
        le=1e6,
        description="acknowledgements are waited for from so far (coverage class)",
    )
    energy_dbm: float | None = Field(
        default=None,
        ge=-200.0,
        le=100.0,
        description="any power from here on is a carrier; 20 dB above preamble_dbm if that is given, else the "
        "standard's: -62 of 11a and 11g, -65 and -68 at clock 0.5 and 0.25, and -73 of 11b",
    )

    @model_validator(mode="after")
    def _has_a_timing(self) -> CsmaMedium:
        self.timing()
        return self

    @property
    def listens_first(self) -> bool:
        """Always."""
        return True

    @property
    def max_length_bytes(self) -> int:
        """The longest packet."""
        return self.timing().max_length_bytes - self.header_bytes

    def timing(self) -> Wifi:
        """Of frames, slots and windows."""
        lowest = 1.0 if self.standard == "11b" else 6.0
        basic_mbps = lowest if self.basic_rate_mbps is None else self.basic_rate_mbps
        if self.standard == "11b":
            timing = wifi_b(self.rate_mbps, basic_mbps, short_preamble=self.short_preamble)
        elif self.standard == "11a":
            timing = wifi_a(self.rate_mbps, basic_mbps, clock=self.clock)
        else:
            timing = wifi_g(self.rate_mbps, basic_mbps)
        if self.clock != 1.0 and self.standard != "11a":
            raise ValueError(f"clock {self.clock:g} is for 11a only")
        if self.short_preamble and self.standard != "11b":
            raise ValueError("short_preamble is for 11b only")
        return timing

    def senses_from_dbm(self, noise_floor_dbm: float) -> float:
        """The weakest power that is sensed as a carrier whatever it is, dBm: the standard's, if nothing is given."""
        if self.energy_dbm is None and self.preamble_dbm is None:
            return standard_energy_dbm(self.standard, self.clock)
        return super().senses_from_dbm(noise_floor_dbm)

    def hearing(self, surroundings: Surroundings) -> Hearing:
        """How stations hear."""
        cca_ns = CCA_DSSS_NS if self.standard == "11b" else round(CCA_OFDM_NS / self.clock)
        return replace(super().hearing(surroundings), cca_ns=cca_ns)

    def open(self, surroundings: Surroundings) -> AccessMedium:
        """Make the medium."""
        reach_ns = round(2.0 * self.reach_m / SPEED_OF_LIGHT_MPS * NS_PER_S)
        settings = DcfSettings(
            self.attempts_max, self.rts_from_bytes, reach_ns=reach_ns, header_bytes=self.header_bytes
        )
        return Csma(
            surroundings.world,
            self.timing(),
            seed=surroundings.seed,
            settings=settings,
            limits=self.queue.limits,
            hearing=self.hearing(surroundings),
        )

    def capacity_bps(self, length_bytes: int, bit_rate_bps: float) -> float:  # noqa: ARG002
        """Bits of broadcasts of a length per second, if one station sends them back to back."""
        timing = self.timing()
        frame_ns = timing.broadcast_ns(length_bytes + self.header_bytes)
        cycle_ns = timing.difs_ns + timing.cw_min / 2 * timing.slot_ns + frame_ns
        return 8 * length_bytes * NS_PER_S / cycle_ns
