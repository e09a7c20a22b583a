"""What air and rain take on the way: ITU-R P.676 and P.838, by the library `itur` (the extra `lostlink[itur]`).

Below 10 GHz and over a few kilometres both are hundredths of a dB; above, rain alone can break a link.
"""

from __future__ import annotations

import importlib
from functools import lru_cache
from typing import Any, Literal

import numpy as np
from pydantic import Field, model_validator

from channel.checks import FloatArray
from channel.validity import RangedVariant
from channel.variant import Variant

EXTRA = "lostlink[itur]"
GHZ = (1.0, 1000.0)
"""Range of both recommendations."""


class NoAtmosphere(Variant):
    """Neither gases nor rain."""

    model: Literal["none"] = "none"


class ItuAtmosphere(RangedVariant):
    """Gases (ITU-R P.676, line by line) and rain (ITU-R P.838), the same along the whole way.

    Raises (at validation):
        ValueError: the library `itur` is not installed; the message names the extra.
    """

    model: Literal["itu-r"] = "itu-r"
    pressure_hpa: float = Field(default=1013.25, gt=0.0, le=1200.0, description="of the dry air")
    temperature_k: float = Field(default=288.15, gt=150.0, le=350.0)
    water_vapour_g_m3: float = Field(default=7.5, ge=0.0, le=100.0, description="density")
    rain_mm_h: float = Field(default=0.0, ge=0.0, le=300.0, description="rain rate")
    tilt_deg: float = Field(
        default=45.0, ge=0.0, le=90.0, description="polarisation: 0 horizontal, 90 vertical, 45 circular"
    )

    @model_validator(mode="after")
    def _library_is_there(self) -> ItuAtmosphere:
        try:
            importlib.import_module("itur")
        except ImportError as error:
            raise ValueError(f"needs the library itur: pip install '{EXTRA}'") from error
        return self

    @property
    def frequencies_hz(self) -> tuple[float, float]:
        """The carriers for which it was made."""
        return GHZ[0] * 1e9, GHZ[1] * 1e9

    def gas_loss_db(self, distance_m: FloatArray, frequency_hz: FloatArray | float) -> FloatArray:
        """Return what oxygen and water vapour take, dB: gamma d (ITU-R P.676, annex 1)."""
        air = self.pressure_hpa, self.water_vapour_g_m3, self.temperature_k
        return self._over_the_way(distance_m, frequency_hz, lambda ghz: _gas_db_per_km(ghz, *air))

    def rain_loss_db(self, distance_m: FloatArray, frequency_hz: FloatArray | float) -> FloatArray:
        """Return what rain takes on a level way, dB: k R^alpha d (ITU-R P.838)."""
        if self.rain_mm_h == 0.0:
            return np.zeros(np.broadcast(distance_m, frequency_hz).shape)
        rain = self.rain_mm_h, self.tilt_deg
        return self._over_the_way(distance_m, frequency_hz, lambda ghz: _rain_db_per_km(ghz, *rain))

    def _over_the_way(
        self, distance_m: FloatArray, frequency_hz: FloatArray | float, db_per_km: Any
    ) -> FloatArray:
        ghz = np.asarray(frequency_hz, dtype=np.float64) / 1e9
        ghz = self.within("frequency_ghz", ghz, *GHZ)
        each, place = np.unique(ghz, return_inverse=True)
        rates = np.array([db_per_km(float(value)) for value in each])[place].reshape(ghz.shape)
        return np.asarray(rates * np.asarray(distance_m) * 1e-3)


@lru_cache(maxsize=256)
def _gas_db_per_km(ghz: float, pressure_hpa: float, water_g_m3: float, temperature_k: float) -> float:
    model = importlib.import_module("itur.models.itu676")
    return float(model.gamma_exact(ghz, pressure_hpa, water_g_m3, temperature_k).value)


@lru_cache(maxsize=256)
def _rain_db_per_km(ghz: float, rain_mm_h: float, tilt_deg: float) -> float:
    model = importlib.import_module("itur.models.itu838")
    return float(model.rain_specific_attenuation(rain_mm_h, ghz, 0.0, tilt_deg).value)
