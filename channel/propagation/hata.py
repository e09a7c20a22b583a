"""Empirical path loss over built-up land: Okumura-Hata and its COST 231 extension.

Distances are slant distances between the antennas; the higher one is the base station's.
"""

from __future__ import annotations

from typing import ClassVar, Literal

import numpy as np
from pydantic import Field

from channel.checks import FloatArray
from channel.geometry import Path
from channel.propagation.path_loss import PathLossModel, spreading_db
from channel.validity import RangedVariant

LARGE_CITY_BORDER_MHZ = 300.0
HZ_PER_MHZ = 1e6
M_PER_KM = 1e3


class OkumuraHata(RangedVariant, PathLossModel):
    """Hata's formulas for Okumura's curves (Hata, IEEE Trans. Veh. Technol. 29 (1980); COST 231, eq. 4.4.1).

    Valid for 150 to 1500 MHz, base 30 to 200 m, mobile 1 to 10 m, 1 to 20 km.

    Over open land Hata prints 4.78 log10(f)^2; ns-3 has 4.70, which `coefficients: ns3` takes.
    """

    has_ground: ClassVar[bool] = True
    model: Literal["okumura-hata"] = "okumura-hata"
    environment: Literal["urban", "suburban", "open"] = Field(default="urban")
    city: Literal["small", "large"] = Field(default="small", description="small stands for medium, too")
    coefficients: Literal["textbook", "ns3"] = Field(
        default="textbook", description="whose numbers, where they differ"
    )

    @property
    def frequencies_hz(self) -> tuple[float, float]:
        """The carriers for which it was made."""
        return 150e6, 1500e6

    def path_loss_db(self, path: Path) -> FloatArray:
        """Return the median loss, dB."""
        f_mhz = self.within_frequencies(path.frequency_hz) / HZ_PER_MHZ
        base_m, mobile_m, distance_m = _ends(self, path)
        urban = (
            69.55
            + 26.16 * np.log10(f_mhz)
            - 13.82 * np.log10(base_m)
            - _MOBILE_CORRECTION[self.city](f_mhz, mobile_m)
            + _distance_term(base_m, distance_m)
        )
        correction_db = _ENVIRONMENT[self.environment](f_mhz, _OPEN_SQUARE_DB[self.coefficients])
        return np.asarray(urban + correction_db + spreading_db(path.distance_m, distance_m))


class Cost231Hata(RangedVariant, PathLossModel):
    """COST 231's extension of Hata's formula to 2 GHz (COST 231 final report, eq. 4.4.3).

    Valid for 1500 to 2000 MHz, base 30 to 200 m, mobile 1 to 10 m, 1 to 20 km. There is no correction for
    suburban or open land: `environment` is accepted and changes nothing; the 3 dB of a metropolitan centre
    come with `city: large`.

    For a large city ns-3 leaves out the constant of 4.97 dB in the mobile's height correction: `coefficients: ns3`.
    """

    has_ground: ClassVar[bool] = True
    model: Literal["cost231-hata"] = "cost231-hata"
    environment: Literal["urban", "suburban", "open"] = Field(default="urban", description="changes nothing")
    city: Literal["small", "large"] = Field(default="small")
    coefficients: Literal["textbook", "ns3"] = Field(
        default="textbook", description="whose numbers, where they differ"
    )

    @property
    def frequencies_hz(self) -> tuple[float, float]:
        """The carriers for which it was made."""
        return 1500e6, 2000e6

    def path_loss_db(self, path: Path) -> FloatArray:
        """Return the median loss, dB."""
        f_mhz = self.within_frequencies(path.frequency_hz) / HZ_PER_MHZ
        base_m, mobile_m, distance_m = _ends(self, path)
        left_out_db = _LEFT_OUT_DB[self.coefficients] if self.city == "large" else 0.0
        return np.asarray(
            46.3
            + 33.9 * np.log10(f_mhz)
            - 13.82 * np.log10(base_m)
            - _MOBILE_CORRECTION[self.city](f_mhz, mobile_m)
            - left_out_db
            + _distance_term(base_m, distance_m)
            + _METROPOLITAN_DB[self.city]
            + spreading_db(path.distance_m, distance_m)
        )


def _ends(model: RangedVariant, path: Path) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return height of the base, height of the mobile and distance to count with."""
    higher = np.maximum(path.height_tx_m, path.height_rx_m)
    lower = np.minimum(path.height_tx_m, path.height_rx_m)
    return (
        model.within("height of the base", higher, 30.0, 200.0),
        model.within("height of the mobile", lower, 1.0, 10.0),
        model.within("distance_m", path.distance_m, 1e3, 20e3),
    )


def _distance_term(base_m: FloatArray, distance_m: FloatArray) -> FloatArray:
    slope = 44.9 - 6.55 * np.log10(base_m)
    return np.asarray(slope * np.log10(distance_m / M_PER_KM))


def _small_city(f_mhz: FloatArray, mobile_m: FloatArray) -> FloatArray:
    log_f = np.log10(f_mhz)
    return np.asarray((1.1 * log_f - 0.7) * mobile_m - (1.56 * log_f - 0.8))


def _large_city(f_mhz: FloatArray, mobile_m: FloatArray) -> FloatArray:
    low = 8.29 * np.square(np.log10(1.54 * mobile_m)) - 1.1
    high = 3.2 * np.square(np.log10(11.75 * mobile_m)) - 4.97
    return np.where(np.less(f_mhz, LARGE_CITY_BORDER_MHZ), low, high)


def _urban(_f_mhz: FloatArray, _open_square_db: float) -> FloatArray:
    return np.zeros(())


def _suburban(f_mhz: FloatArray, _open_square_db: float) -> FloatArray:
    return np.asarray(-2.0 * np.square(np.log10(f_mhz / 28.0)) - 5.4)


def _open(f_mhz: FloatArray, open_square_db: float) -> FloatArray:
    log_f = np.log10(f_mhz)
    return np.asarray(-open_square_db * np.square(log_f) + 18.33 * log_f - 40.94)


_MOBILE_CORRECTION = {"small": _small_city, "large": _large_city}
_ENVIRONMENT = {"urban": _urban, "suburban": _suburban, "open": _open}
_OPEN_SQUARE_DB = {"ns3": 4.70, "textbook": 4.78}
_METROPOLITAN_DB = {"small": 0.0, "large": 3.0}
_LEFT_OUT_DB = {"ns3": 4.97, "textbook": 0.0}
