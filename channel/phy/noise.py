"""The noise floor at a receiver."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field

from channel import checks
from channel.checks import FloatArray
from channel.numbers.units import BOLTZMANN_J_PER_K, db_from_ratio, dbm_from_watt, ratio_from_db
from channel.validity import RangedVariant
from channel.variant import Variant

STANDARD_TEMPERATURE_K = 290.0
"""T0 of the noise figure's definition (IEEE)."""


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


class NoiseModel(Variant):
    """What a receiver hears when nobody transmits. One of a user's own has `noise_floor_dbm`."""

    def noise_floor_dbm(self, bandwidth_hz: float, frequency_hz: float, /) -> float:
        """Return the noise power in `bandwidth_hz` about a carrier, dBm."""
        raise NotImplementedError

    def behind_cable_dbm(self, bandwidth_hz: float, frequency_hz: float, _cable_loss_db: float, /) -> float:
        """Return the noise power at the receiver's input, which a cable of some loss joins to the antenna, dBm.

        That beside the antenna, unless the model is of noise that comes by it.
        """
        return self.noise_floor_dbm(bandwidth_hz, frequency_hz)


class FixedNoise(NoiseModel):
    """A noise floor that somebody measured or printed; the bandwidth does not matter."""

    model: Literal["fixed"] = "fixed"
    floor_dbm: float = Field(description="noise power at the receiver")

    def noise_floor_dbm(self, _bandwidth_hz: float, _frequency_hz: float, /) -> float:
        """Return the floor as configured, dBm."""
        return self.floor_dbm


class ThermalNoise(NoiseModel):
    """k T B plus the receiver's noise figure."""

    model: Literal["thermal"] = "thermal"
    noise_figure_db: float = Field(default=6.0, ge=0.0, le=60.0)
    temperature_k: float = Field(default=STANDARD_TEMPERATURE_K, gt=0.0)

    def noise_floor_dbm(self, bandwidth_hz: float, _frequency_hz: float, /) -> float:
        """Return 10 log10(k T B / 1 mW) + NF, dBm."""
        return float(thermal_noise_dbm(bandwidth_hz, self.noise_figure_db, self.temperature_k))


MAN_MADE = {
    "city": (76.8, 27.7, 0.3e6, 250e6),
    "residential": (72.5, 27.7, 0.3e6, 250e6),
    "rural": (67.2, 27.7, 0.3e6, 250e6),
    "quiet-rural": (53.6, 28.6, 0.3e6, 250e6),
    "business": (44.3, 12.3, 200e6, 900e6),
}
"""c and d of the median Fam = c - d log10(f / 1 MHz), and where it holds: ITU-R P.372, sec. on man-made noise.

The first four are of all editions (table 1, 0.3 to 250 MHz; for `quiet-rural`, curve D, no range is named, and galactic
noise, 52 - 23 log10(f / 1 MHz), is above it from 2 MHz on), `business` is of P.372-8 (200 to 900 MHz).
"""


class ManMadeNoise(RangedVariant, NoiseModel):
    """Man-made noise at a receiver near the ground by ITU-R P.372, and the receiver's own: k T0 B (fa + fr - 1).

    Behind a cable of loss lt it is k T0 B ((fa - 1) / lt + fr): the system's noise factor of P.372, sec. 2,
    fa + (fc - 1) + lc (ft - 1) + lc lt (fr - 1), for a lossless antenna (lc = fc = 1) and a cable at T0 (ft = lt),
    taken from the antenna's terminals to the receiver's input, where the received power is: divided by lt.
    """

    model: Literal["man-made"] = "man-made"
    environment: Literal["city", "residential", "rural", "quiet-rural", "business"] = Field(
        description="where the receiver is; above 250 MHz there is `business` only"
    )
    noise_figure_db: float = Field(default=6.0, ge=0.0, le=60.0, description="of the receiver")

    @property
    def frequencies_hz(self) -> tuple[float, float]:
        """The carriers for which it was made."""
        _, _, low_hz, high_hz = MAN_MADE[self.environment]
        return low_hz, high_hz

    def noise_floor_dbm(self, bandwidth_hz: float, frequency_hz: float, /) -> float:
        """Return the median noise power at a receiver beside its antenna, dBm."""
        return self.behind_cable_dbm(bandwidth_hz, frequency_hz, 0.0)

    def behind_cable_dbm(self, bandwidth_hz: float, frequency_hz: float, cable_loss_db: float, /) -> float:
        """Return the median noise power at the receiver's input behind a cable, dBm."""
        at_one_mhz_db, slope, _, _ = MAN_MADE[self.environment]
        counted_hz = self.within_frequencies(frequency_hz)
        external_db = at_one_mhz_db - slope * np.log10(counted_hz / 1e6)
        outside = (ratio_from_db(external_db) - 1.0) / ratio_from_db(cable_loss_db)
        factor = outside + ratio_from_db(self.noise_figure_db)
        return float(thermal_noise_dbm(bandwidth_hz) + db_from_ratio(factor))
