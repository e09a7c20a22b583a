"""Path loss: what the way from one antenna to the other costs, in dB, positive."""

from __future__ import annotations

import math
from typing import ClassVar, Literal

import numpy as np
from pydantic import Field

from channel.checks import FloatArray
from channel.geometry import Path
from channel.numbers.units import SPEED_OF_LIGHT_MPS
from channel.variant import Variant

_FRIIS_CONSTANT_DB = 20.0 * math.log10(4.0 * math.pi / SPEED_OF_LIGHT_MPS)


class PathLossModel(Variant):
    """A propagation law: geometry and frequency in, loss out. One of a user's own has `path_loss_db`."""

    needs_places: ClassVar[bool] = False
    """Whether it asks where the ends are, and not only how far apart and how high."""
    needs_roles: ClassVar[bool] = False
    """Whether it asks which end is a base on the ground: `Path.tx_is_base`, `Path.rx_is_base`."""
    by_rays: ClassVar[bool] = False
    """Whether it asks for `Path.reflected_gain_db`."""
    has_ground: ClassVar[bool] = False
    """Whether the reflection or clutter of flat ground is in it: the horizon then takes what is beyond its loss."""
    has_earth: ClassVar[bool] = False
    """Whether the bulge of the Earth is in it: it needs no horizon."""

    @property
    def draws_sight(self) -> bool:
        """Whether the line of sight is a random state: it has `sight_states` and `sight_decorrelation_m` then."""
        return False

    @property
    def has_sigmas(self) -> bool:
        """Whether these states have a sigma of their own, for shadowing without one."""
        return False

    def path_loss_db(self, path: Path) -> FloatArray:
        """Return the loss in dB, positive when power is lost, in the broadcast shape of `path`."""
        raise NotImplementedError


def friis_db(distance_m: FloatArray | float, frequency_hz: FloatArray | float) -> FloatArray:
    """Return the free-space loss between isotropic antennas, dB, of values above 0, in their broadcast shape.

    20 log10(4 pi d f / c); ITU-R P.525-4, eq. 3. No loss below zero is hidden: in the near field
    (d < lambda / 4 pi) the formula, and this function, give a gain.
    """
    return 20.0 * np.log10(np.multiply(distance_m, frequency_hz)) + _FRIIS_CONSTANT_DB


def spreading_db(distance_m: FloatArray | float, counted_m: FloatArray) -> FloatArray:
    """Return 20 log10(d / d'): how a law that counts d' for d goes on, by free-space spreading."""
    return np.asarray(20.0 * np.log10(distance_m / counted_m))


class FreeSpace(PathLossModel):
    """Free space between the two antennas (Friis; ITU-R P.525)."""

    model: Literal["free-space"] = "free-space"

    def path_loss_db(self, path: Path) -> FloatArray:
        """Return 20 log10(4 pi d f / c)."""
        return friis_db(path.distance_m, path.frequency_hz)


class LogDistance(PathLossModel):
    """Power law beyond a reference distance; the law that Moon et al. 2020 call Hata-Okumura (eq. 4).

    With no `reference_loss_db` the loss at the reference distance is that of free space.
    """

    model: Literal["log-distance"] = "log-distance"
    exponent: float = Field(default=2.0, ge=0.0, le=20.0, description="n in 10 n log10(d / d0)")
    reference_distance_m: float = Field(default=1.0, gt=0.0, description="d0")
    reference_loss_db: float | None = Field(default=None, description="loss at d0; free space if not given")

    def path_loss_db(self, path: Path) -> FloatArray:
        """Return the loss at d0 plus 10 n log10(d / d0)."""
        beyond_db = 10.0 * self.exponent * np.log10(path.distance_m / self.reference_distance_m)
        if self.reference_loss_db is None:
            return friis_db(self.reference_distance_m, path.frequency_hz) + beyond_db
        return self.reference_loss_db + beyond_db


class NoPathLoss(PathLossModel):
    """No loss at any distance: for the baselines that ignore the way."""

    model: Literal["none"] = "none"

    def path_loss_db(self, path: Path) -> FloatArray:
        """Return zeros in the shape of the distance."""
        return np.zeros_like(path.distance_m)
