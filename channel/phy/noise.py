"""The noise floor at a receiver."""

from __future__ import annotations

from typing import Literal, Protocol

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field

from channel import checks
from channel.checks import FloatArray
from channel.units import BOLTZMANN_J_PER_K, dbm_from_watt
from channel.variant import Variant

STANDARD_TEMPERATURE_K = 290.0
"""T0 of the noise figure's definition (IEEE)."""


class NoiseModel(Protocol):
    """What a receiver hears when nobody transmits."""

    def noise_floor_dbm(self, bandwidth_hz: float, /) -> float:
        """Return the noise power in `bandwidth_hz`, dBm."""
        ...


def thermal_noise_dbm(
    bandwidth_hz: ArrayLike,
    noise_figure_db: ArrayLike = 0.0,
    temperature_k: ArrayLike = STANDARD_TEMPERATURE_K,
) -> FloatArray:
    """Return k T B + NF in dBm: -173.98 dBm/Hz at 290 K (Pozar, Microwave Engineering, sec. 10.1).

    Raises:
        ChannelInputError: bandwidth or temperature not positive, noise figure negative, not finite.
    """
    bandwidth = checks.finite("bandwidth_hz", bandwidth_hz, 0.0, low_open=True)
    figure = checks.finite("noise_figure_db", noise_figure_db, 0.0)
    temperature = checks.finite("temperature_k", temperature_k, 0.0, low_open=True)
    return np.add(dbm_from_watt(BOLTZMANN_J_PER_K * temperature * bandwidth), figure)


class FixedNoise(Variant):
    """A noise floor that somebody measured or printed; the bandwidth does not matter."""

    model: Literal["fixed"] = "fixed"
    floor_dbm: float = Field(description="noise power at the receiver")

    def noise_floor_dbm(self, _bandwidth_hz: float, /) -> float:
        """Return the floor as configured, dBm."""
        return self.floor_dbm


class ThermalNoise(Variant):
    """k T B plus the receiver's noise figure."""

    model: Literal["thermal"] = "thermal"
    noise_figure_db: float = Field(default=6.0, ge=0.0, le=60.0)
    temperature_k: float = Field(default=STANDARD_TEMPERATURE_K, gt=0.0)

    def noise_floor_dbm(self, bandwidth_hz: float, /) -> float:
        """Return 10 log10(k T B / 1 mW) + NF, dBm."""
        return float(thermal_noise_dbm(bandwidth_hz, self.noise_figure_db, self.temperature_k))
