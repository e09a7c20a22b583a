"""What an emitter sends out, antenna aside: as data that costs nothing to import."""

from __future__ import annotations

from pydantic import Field

from sitl_configs.settings import Settings

NS_PER_S = 1_000_000_000


class Emission(Settings):
    """A carrier with a power, on all the time or in slots that are drawn on or off."""

    frequency_hz: float = Field(ge=1e6, le=1e12, description="carrier, Hz: 2412 MHz are 2.412e+9")
    power_dbm: float = Field(ge=-200.0, le=200.0, description="into the antenna")
    bandwidth_hz: float = Field(default=1e3, gt=0.0, le=1e11, description="its power is flat within")
    duty: float = Field(default=1.0, ge=0.0, le=1.0, description="share of slots in which it transmits")
    slot_s: float = Field(default=0.01, ge=1e-6, le=1e6, description="length of a slot, sim time")

    @property
    def slot_ns(self) -> int:
        """Length of a slot, ns of sim time."""
        return max(round(self.slot_s * NS_PER_S), 1)
