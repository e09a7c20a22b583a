"""Models of one's own for a radio: a class per model, named in YAML as `class: my_models.py:Name`.

    lostlink link --radio corrected --ground-distance 400 \\
        --set propagation.class=examples/models/my_models.py:ThroughForest

Methods take and return arrays; `channel/propagation/path_loss.py`, `channel/fading/` (`laws.py`, `shadowing.py`,
`bursts.py`), `channel/phy/noise.py`, `channel/antenna.py` and `channel/phy/error_model.py` say what each kind of model
needs. Fields are the keys of the YAML, checked by pydantic.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from channel.checks import FloatArray
from channel.fading.laws import CoherentFading
from channel.fading.link_words import Words
from channel.fading.quadrature import gauss_legendre
from channel.fading.shadowing import PerPacketShadowing
from channel.geometry import Path
from channel.numbers.special import ndtr
from channel.phy.error_model import Band, Smooth
from channel.phy.noise import thermal_noise_dbm
from channel.propagation.path_loss import FreeSpace
from channel.variant import Variant


class ThroughForest(Variant):
    """Free space and what trees take: Weissberger's exponential decay, 230 MHz to 95 GHz, 14 to 400 m of dry trees."""

    depth_m: float = Field(default=50.0, ge=14.0, le=400.0)

    def path_loss_db(self, path: Path) -> FloatArray:
        """Return free space + 1.33 f^0.284 depth^0.588, f in GHz."""
        ghz = np.divide(path.frequency_hz, 1e9)
        return FreeSpace().path_loss_db(path) + 1.33 * np.power(ghz, 0.284) * self.depth_m**0.588


class Cardioid(Variant):
    """A patch on the nose: (1 + cos angle) / 2 in amplitude, never below 20 dB under its peak."""

    gain_db: float = 5.0

    @property
    def needs_direction(self) -> bool:
        """True."""
        return True

    def towards_db(self, direction_frd: FloatArray, /) -> FloatArray:
        """Return the gain towards unit vectors in body axes (forward, right, down), dB."""
        amplitude = 0.5 * (1.0 + direction_frd[..., 0])
        return np.asarray(self.gain_db + 20.0 * np.log10(np.maximum(amplitude, 0.1)))


class Logistic(Smooth):
    """A packet error rate that falls with the SNR as a logistic curve, whatever the length."""

    half_db: float = 5.0
    width_db: float = Field(default=1.0, gt=0.0)

    def ber(self, snr_db: FloatArray, band: Band, /) -> FloatArray:
        """Return the packet error rate of one bit."""
        return self.per(snr_db, 0.125, band)

    def per(self, snr_db: FloatArray, _length_bytes: FloatArray | float, _band: Band, /) -> FloatArray:
        """Return 1 / (1 + exp((snr - half) / width))."""
        return np.asarray(
            1.0 / (1.0 + np.exp(np.clip((snr_db - self.half_db) / self.width_db, -700.0, 700.0)))
        )


class Laplacian(PerPacketShadowing):
    """Shadowing with more deep losses than a normal law: Laplace's, of standard deviation sigma."""

    sigma_db: float = Field(ge=0.0, le=60.0)

    @property
    def spread_db(self) -> float:
        """Sigma."""
        return self.sigma_db

    def loss_db(self, standard_normal: FloatArray) -> FloatArray:
        """Return the quantile of Laplace's law at that of each draw."""
        tail = 2.0 * ndtr(-np.abs(standard_normal))
        return np.asarray(np.sign(standard_normal) * self.sigma_db / math.sqrt(2.0) * -np.log(tail))

    def chance_below(self, loss_db: FloatArray) -> FloatArray:
        """Return its distribution function."""
        tail = 0.5 * np.exp(-math.sqrt(2.0) * np.abs(loss_db) / self.sigma_db)
        return np.where(loss_db < 0.0, tail, 1.0 - tail)


class Weibull(CoherentFading):
    """Amplitudes by Weibull's law, mean power 1; shape 2 is Rayleigh. `coherence` says when it draws anew."""

    shape: float = Field(ge=1.0, le=20.0)

    def gain_db(self, first: FloatArray, _second: FloatArray, _elevation_deg: FloatArray, /) -> FloatArray:
        """Return the gain whose chance to be exceeded is `first`."""
        power = 2.0 / self.shape
        return np.asarray(10.0 * np.log10(np.power(-np.log(first), power) / math.gamma(1.0 + power)))

    def rule(self, elevation_deg: FloatArray, panels: int) -> tuple[FloatArray, FloatArray]:
        """Return gains and weights for averages over the law: at evenly spread draws."""
        first, weights = gauss_legendre(panels)
        return self.gain_db(first, first, elevation_deg), weights


class RooftopNoise(Variant):
    """Thermal noise, and what a town adds at some height."""

    town_db: float = Field(default=10.0, ge=0.0)

    def noise_floor_dbm(self, bandwidth_hz: float, _frequency_hz: float, /) -> float:
        """Return the noise power in a bandwidth, dBm."""
        return float(thermal_noise_dbm(bandwidth_hz)) + self.town_db


class Radar(Variant):
    """A radar that turns: for a while in each of its turns, nothing gets through."""

    period_s: float = Field(default=2.5, gt=0.0)
    lost_s: float = Field(default=0.1, ge=0.0)

    @property
    def mean_loss(self) -> float:
        """Share of time."""
        return self.lost_s / self.period_s

    def loss_at(self, _words: Words, sim_time_ns: NDArray[np.int64], /) -> FloatArray:
        """Return 1 while it looks this way, else 0; the words would distinguish links."""
        return np.where(sim_time_ns / 1e9 % self.period_s < self.lost_s, 1.0, 0.0)
