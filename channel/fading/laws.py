"""Fading: the fast random part of the received power, from the sum of many paths; mean power gain 1."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from channel.checks import FloatArray
from channel.fading.quadrature import (
    gauss_legendre,
    split_gauss_legendre,
    split_normal_rule,
    standard_normal_rule,
    uniform_from_normal,
)
from channel.fading.scatter import Scattering
from channel.numbers import special
from channel.numbers.units import db_from_ratio, ratio_from_db
from channel.variant import Variant

ComplexArray = NDArray[np.complex128]
Coherence = Literal["packet", "block", "doppler"]
SMALLEST_DRAW = 2.0**-53
"""Uniform draws end half a cell before 0 and 1."""
LOWEST_GAIN = 1e-20
"""Power gains are held above -200 dB, so that their logarithm is finite."""
GAIN_LIMIT_DB = 300.0
"""Gains beyond are as rare as this one."""
NAKAGAMI_STEP_DB = 0.02
NAKAGAMI_RANGE_DB = (-120.0, 20.0)
"""Of the Rayleigh powers for which the Nakagami law is tabulated; the first 1e-12 of them lie below."""


class FadingModel(Protocol):
    """A random power gain, given as a function of two uniform variables.

    A law may say `max_gain_db`, the largest gain that any draw gives: packets that it does not save cost no draw. It
    may have `chance_below`, its distribution function of gain in dB and elevation, and `split_rule`, which is `rule`
    with more borders, at gains of shape (links, breaks): averages of what jumps there are exact by them. With the
    coherence `doppler` it may say `scattering` (`ring` unless it does), and have `gain_of_scatter_db`, see
    `scatter_gain_db`.
    """

    @property
    def is_random(self) -> bool:
        """Whether there is anything to draw."""
        ...

    @property
    def by_elevation(self) -> bool:
        """Whether the law depends on the elevation angle."""
        ...

    @property
    def coherence(self) -> Coherence:
        """Whether each packet draws anew, or each coherence time, or the gain goes with the ways of the ends."""
        ...

    @property
    def max_coherence_s(self) -> float:
        """Coherence time of ends that stand still, s."""
        ...

    def gain_db(self, first: FloatArray, second: FloatArray, elevation_deg: FloatArray) -> FloatArray:
        """Return the power gain in dB for u1, u2 ~ U(0, 1) and an elevation angle in degrees; broadcasts."""
        ...

    def rule(self, elevation_deg: FloatArray, panels: int) -> tuple[FloatArray, FloatArray]:
        """Return gains in dB and weights, shape (..., nodes), with E f(gain) = sum of weights f(gains)."""
        ...


class CoherentFading(Variant):
    """What all fading laws share: when they draw anew.

    A law of one's own derives from it, and has `gain_db` and `rule`.
    """

    coherence: Coherence = Field(
        default="packet",
        description="a new draw per packet, or per coherence time 9 c / (16 pi f v); or a gain that goes with the "
        "ways of both ends, by a sum of sinusoids",
    )
    max_coherence_s: float = Field(
        default=1.0, ge=1e-3, le=1e4, description="coherence time of ends that stand still"
    )
    scattering: Scattering = Field(
        default="ring", description="doppler: waves from all around at the horizon, or from the whole sphere"
    )

    @property
    def is_random(self) -> bool:
        """True."""
        return True

    @property
    def by_elevation(self) -> bool:
        """False, unless the law says otherwise."""
        return False


class NoFading(CoherentFading):
    """No fading."""

    model: Literal["none"] = "none"

    @property
    def is_random(self) -> bool:
        """False: there is nothing to draw."""
        return False

    def gain_db(self, first: FloatArray, _second: FloatArray, _elevation_deg: FloatArray, /) -> FloatArray:
        """Return zeros."""
        return np.zeros_like(first)

    def rule(self, _elevation_deg: FloatArray, _panels: int, /) -> tuple[FloatArray, FloatArray]:
        """Return one node at 0 dB."""
        return np.zeros(1), np.ones(1)


class Rayleigh(CoherentFading):
    """No direct path: the power gain is exponential with mean 1 (Rappaport, sec. 5.6.1)."""

    model: Literal["rayleigh"] = "rayleigh"

    @property
    def max_gain_db(self) -> float:
        """-ln of the smallest draw, dB."""
        return float(db_from_ratio(-math.log(SMALLEST_DRAW)))

    def gain_db(self, first: FloatArray, _second: FloatArray, _elevation_deg: FloatArray, /) -> FloatArray:
        """Return -ln(u) in dB."""
        return db_from_ratio(np.maximum(-np.log(first), LOWEST_GAIN))

    def rule(self, _elevation_deg: FloatArray, panels: int, /) -> tuple[FloatArray, FloatArray]:
        """Return nodes equal in the normal quantile of the gain."""
        z, weights = standard_normal_rule(panels)
        return self._at_normal_db(z), weights

    def split_rule(
        self, _elevation_deg: FloatArray, panels: int, breaks_db: FloatArray, /
    ) -> tuple[FloatArray, FloatArray]:
        """Return the same with borders at gains, shape (links, nodes)."""
        z, weights = split_normal_rule(special.ndtri(np.exp(-_gain_at(breaks_db))), panels)
        return self._at_normal_db(z), weights

    def chance_below(self, gain_db: FloatArray, _elevation_deg: FloatArray, /) -> FloatArray:
        """Return 1 - exp(-gain)."""
        return np.asarray(-np.expm1(-_gain_at(gain_db)))

    @staticmethod
    def _at_normal_db(z: FloatArray) -> FloatArray:
        return db_from_ratio(np.maximum(-np.log(uniform_from_normal(z)), LOWEST_GAIN))

    def gain_of_scatter_db(
        self, scatter: ComplexArray, _direct: ComplexArray, _elevation_deg: FloatArray, /
    ) -> FloatArray:
        """Return the gain in dB where the scattered field, of mean power 1, is `scatter`."""
        return db_from_ratio(np.maximum(_power(scatter), LOWEST_GAIN))


class Nakagami(CoherentFading):
    """The power gain is gamma-distributed, shape m, mean 1 (Nakagami 1960); m = 1 is Rayleigh."""

    model: Literal["nakagami"] = "nakagami"
    m: float = Field(ge=0.5, le=100.0, description="0.5: worse than Rayleigh; large: steady")

    @property
    def max_gain_db(self) -> float:
        """The quantile at the largest draw, dB."""
        return float(db_from_ratio(special.gammaincinv(self.m, 1.0 - SMALLEST_DRAW) / self.m))

    def gain_db(self, first: FloatArray, _second: FloatArray, _elevation_deg: FloatArray, /) -> FloatArray:
        """Return the quantile of the gamma law at u, in dB."""
        return db_from_ratio(np.maximum(special.gammaincinv(self.m, first) / self.m, LOWEST_GAIN))

    def rule(self, _elevation_deg: FloatArray, panels: int, /) -> tuple[FloatArray, FloatArray]:
        """Return nodes equal in the normal quantile of the gain."""
        z, weights = standard_normal_rule(panels)
        return self._at_normal_db(z), weights

    def split_rule(
        self, elevation_deg: FloatArray, panels: int, breaks_db: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return the same with borders at gains, shape (links, nodes)."""
        z, weights = split_normal_rule(special.ndtri(self.chance_below(breaks_db, elevation_deg)), panels)
        return self._at_normal_db(z), weights

    def chance_below(self, gain_db: FloatArray, _elevation_deg: FloatArray, /) -> FloatArray:
        """Return the distribution function of the gamma law."""
        return np.asarray(special.gammainc(self.m, self.m * _gain_at(gain_db)))

    def _at_normal_db(self, z: FloatArray) -> FloatArray:
        gain = special.gammaincinv(self.m, uniform_from_normal(z)) / self.m
        return db_from_ratio(np.maximum(gain, LOWEST_GAIN))

    def gain_of_scatter_db(
        self, scatter: ComplexArray, _direct: ComplexArray, _elevation_deg: FloatArray, /
    ) -> FloatArray:
        """Return the quantile of the gamma law at that of the scattered power (Beaulieu & Cheng, GLOBECOM 2001)."""
        low_db, high_db = NAKAGAMI_RANGE_DB
        at = (np.clip(db_from_ratio(np.maximum(_power(scatter), LOWEST_GAIN)), low_db, high_db) - low_db) * (
            1.0 / NAKAGAMI_STEP_DB
        )
        table_db = _nakagami_table_db(self.m)
        left = np.minimum(at.astype(np.intp), table_db.size - 2)
        here = table_db.take(left)
        return here + (at - left) * (table_db.take(left + 1) - here)


class Rician(CoherentFading):
    """A direct path and many weak ones; K is the ratio of their powers (Rappaport, sec. 5.6.2).

    K may rise with elevation, linearly in dB between `k_db` at 0 and `k_overhead_db` at 90 degrees.
    """

    model: Literal["rician"] = "rician"
    k_db: float = Field(ge=-40.0, le=40.0)
    k_overhead_db: float | None = Field(default=None, ge=-40.0, le=40.0)

    @model_validator(mode="after")
    def _rises(self) -> Rician:
        if self.k_overhead_db is not None and self.k_overhead_db < self.k_db:
            raise ValueError("k_overhead_db has to be at least k_db")
        return self

    @property
    def by_elevation(self) -> bool:
        """Whether K rises with elevation."""
        return self.k_overhead_db is not None

    @property
    def max_gain_db(self) -> float:
        """Both parts at their largest, at the elevation where that is most, dB."""
        elevation = np.linspace(0.0, 90.0, 901)
        smallest, largest = np.array(SMALLEST_DRAW), np.array(1.0 - SMALLEST_DRAW)
        return float(np.max(self.gain_db(largest, smallest, elevation)))

    def k_ratio(self, elevation_deg: FloatArray) -> FloatArray:
        """Return K as a ratio at an elevation angle in degrees."""
        rise = 0.0 if self.k_overhead_db is None else self.k_overhead_db - self.k_db
        return ratio_from_db(self.k_db + rise * np.divide(elevation_deg, 90.0))

    def gain_db(self, first: FloatArray, second: FloatArray, elevation_deg: FloatArray) -> FloatArray:
        """Return |sqrt(K / (K + 1)) + (x + i y) / sqrt(2 (K + 1))|^2 in dB, x and y normal."""
        k = self.k_ratio(elevation_deg)
        spread = np.sqrt(0.5 / (k + 1.0))
        in_phase = np.sqrt(k / (k + 1.0)) + spread * special.ndtri(first)
        gain = np.square(in_phase) + np.square(spread * special.ndtri(second))
        return db_from_ratio(np.maximum(gain, LOWEST_GAIN))

    def gain_of_scatter_db(
        self, scatter: ComplexArray, direct: ComplexArray, elevation_deg: FloatArray
    ) -> FloatArray:
        """Return |sqrt(K) direct + scatter|^2 / (K + 1) in dB; `direct` has the phase of the direct path."""
        k = self.k_ratio(elevation_deg)
        gain = _power(np.sqrt(k) * direct + scatter) / (k + 1.0)
        return db_from_ratio(np.maximum(gain, LOWEST_GAIN))

    def rule(self, elevation_deg: FloatArray, panels: int) -> tuple[FloatArray, FloatArray]:
        """Return nodes in the amplitude, within 8.3 sigma of the direct path, weighted by the Rician density."""
        return self._weighted(elevation_deg, *gauss_legendre(panels))

    def split_rule(
        self, elevation_deg: FloatArray, panels: int, breaks_db: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return the same with borders at gains, shape (links, nodes)."""
        _, _, low, high = self._amplitudes(elevation_deg)
        borders = (np.sqrt(_gain_at(breaks_db)) - low) / (high - low)
        return self._weighted(elevation_deg, *split_gauss_legendre(borders, panels))

    def chance_below(self, gain_db: FloatArray, elevation_deg: FloatArray) -> FloatArray:
        """Return the distribution function, by that of the non-central chi-squared law with two degrees of freedom."""
        k = self.k_ratio(elevation_deg)
        return np.asarray(special.chndtr(2.0 * (k + 1.0) * _gain_at(gain_db), 2.0, 2.0 * k))

    def _amplitudes(self, elevation_deg: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Return that of the direct path, its spread, and the least and the largest, shape (..., 1)."""
        k = self.k_ratio(elevation_deg)[..., np.newaxis]
        direct, spread = np.sqrt(k / (k + 1.0)), np.sqrt(0.5 / (k + 1.0))
        return direct, spread, np.maximum(direct - 8.3 * spread, 0.0), direct + 8.3 * spread

    def _weighted(
        self, elevation_deg: FloatArray, t: FloatArray, weights: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        direct, spread, low, high = self._amplitudes(elevation_deg)
        amplitude = low + (high - low) * t
        density = amplitude / spread**2 * np.exp(-0.5 * ((amplitude - direct) / spread) ** 2)
        density = density * special.i0e(amplitude * direct / spread**2)
        gain_db = db_from_ratio(np.maximum(amplitude**2, LOWEST_GAIN))
        return gain_db, weights * (high - low) * density


def scatter_gain_db(
    model: FadingModel, scatter: ComplexArray, direct: ComplexArray, elevation_deg: FloatArray
) -> FloatArray:
    """Return the gain in dB of a law for a scattered field of mean power 1, same shape.

    A user's law that says nothing of scatter gets the two uniform variables that power and phase of it are.

    Args:
        model: the law.
        scatter: circularly normal.
        direct: exp(2 pi i d / lambda).
        elevation_deg: broadcasts.
    """
    of_scatter = getattr(model, "gain_of_scatter_db", None)
    if of_scatter is not None:
        return np.asarray(of_scatter(scatter, direct, elevation_deg))
    first = np.clip(np.exp(-_power(scatter)), 1e-300, 1.0 - 2.0**-53)
    second = np.clip(np.angle(scatter) / (2.0 * math.pi) + 0.5, 2.0**-53, 1.0 - 2.0**-53)
    return model.gain_db(first, second, elevation_deg)


def _gain_at(gain_db: FloatArray) -> FloatArray:
    """Return the ratio, within what can be."""
    return ratio_from_db(np.clip(gain_db, -GAIN_LIMIT_DB, GAIN_LIMIT_DB))


def _power(field: ComplexArray) -> FloatArray:
    return np.asarray(np.square(field.real) + np.square(field.imag))


@lru_cache(maxsize=16)
def _nakagami_table_db(m: float) -> FloatArray:
    """Return Nakagami gains in dB at Rayleigh powers in steps of `NAKAGAMI_STEP_DB`."""
    low_db, high_db = NAKAGAMI_RANGE_DB
    power = ratio_from_db(np.linspace(low_db, high_db, round((high_db - low_db) / NAKAGAMI_STEP_DB) + 1))
    low = special.gammaincinv(m, -np.expm1(-power))
    gain = np.where(power < 1.0, low, special.gammainccinv(m, np.exp(-power))) / m
    return db_from_ratio(np.maximum(gain, LOWEST_GAIN))
