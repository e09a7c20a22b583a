"""What an RF sensor is, its radio aside: as data that costs nothing to import."""

from __future__ import annotations

from typing import Literal, Self

from pydantic import Field, model_validator

from sitl_configs.settings import Settings, refused

NS_PER_S = 1e9
Identifies = Literal["id", "frequency", "none"]


class SensorSettings(Settings):
    """How often a sensor measures what, and what it reports of it."""

    rate_hz: float = Field(default=4.0, gt=0.0, le=1000.0, description="measurements per second of sim time")
    band_hz: tuple[float, float] | None = Field(
        default=None, description="emitters within are measured; its radio's carrier +- half the bandwidth"
    )
    averages: int = Field(
        default=1000, ge=1, le=10**9, description="independent samples of signal and noise in a reading"
    )
    threshold_db: float = Field(
        default=3.0,
        ge=-100.0,
        le=200.0,
        description="readings less than this over the noise are not reported",
    )
    step_db: float = Field(default=0.5, ge=0.001, le=20.0, description="readings are rounded to whole steps")
    identifies: Identifies = Field(
        default="id", description="what is reported of whose power it is: its id, its frequency, or nothing"
    )

    @model_validator(mode="after")
    def _is_a_band(self) -> Self:
        if self.band_hz is not None and not 0.0 < self.band_hz[0] < self.band_hz[1]:
            raise refused("the lower end comes first, above 0", "band_hz")
        return self

    @property
    def period_ns(self) -> int:
        """Sim time between two measurements, ns."""
        return max(round(NS_PER_S / self.rate_hz), 1)
