"""Shadowing: the slow random part of the loss, one value per packet and link, in dB."""

from __future__ import annotations

import math
from typing import Literal, Protocol

import numpy as np
from pydantic import Field

from channel import special
from channel.checks import FloatArray
from channel.fading.shadow_field import WAVES
from channel.variant import Variant

MAX_NORMAL = 8.209536151601387
"""The farthest from 0 that a draw of a standard normal variable gets: uniform draws end half a cell before 0 and 1."""


class ShadowingModel(Protocol):
    """A random loss, given as a function of one standard normal variable.

    A law may say `max_gain_db`, the largest gain that any draw gives: packets that it does not save cost no draw.
    """

    @property
    def is_random(self) -> bool:
        """Whether the loss varies at all."""
        ...

    @property
    def decorrelation_m(self) -> float | None:
        """How far an end has to move for the loss to change; None: it is drawn anew for each packet."""
        ...

    @property
    def spread_db(self) -> float:
        """Loss per unit of |z|, dB."""
        ...

    def loss_db(self, standard_normal: FloatArray) -> FloatArray:
        """Return the loss in dB for draws z ~ N(0, 1), same shape."""
        ...

    def chance_below(self, loss_db: FloatArray) -> FloatArray:
        """Return the distribution function of the loss, same shape."""
        ...


class _PerPacket(Variant):
    """Shadowing that is drawn anew for each packet, as the paper's is."""

    @property
    def decorrelation_m(self) -> None:
        """None."""
        return


class NoShadowing(_PerPacket):
    """No shadowing."""

    model: Literal["none"] = "none"

    @property
    def is_random(self) -> bool:
        """False: there is nothing to draw."""
        return False

    @property
    def spread_db(self) -> float:
        """0."""
        return 0.0

    @property
    def max_gain_db(self) -> float:
        """0."""
        return 0.0

    def loss_db(self, standard_normal: FloatArray) -> FloatArray:
        """Return zeros."""
        return np.zeros_like(standard_normal)

    def chance_below(self, loss_db: FloatArray) -> FloatArray:
        """Return a step at 0 dB."""
        return normal_below(loss_db, 0.0)


class OneSidedNormalShadowing(_PerPacket):
    """|v| with v ~ N(0, sigma^2): shadowing can only cost (Moon et al. 2020, eq. 4)."""

    model: Literal["one-sided-normal"] = "one-sided-normal"
    sigma_db: float = Field(ge=0.0, le=60.0, description="standard deviation of v, not of |v|")

    @property
    def is_random(self) -> bool:
        """Whether sigma is above zero."""
        return self.sigma_db > 0.0

    @property
    def spread_db(self) -> float:
        """Sigma."""
        return self.sigma_db

    @property
    def max_gain_db(self) -> float:
        """0: shadowing can only cost."""
        return 0.0

    def loss_db(self, standard_normal: FloatArray) -> FloatArray:
        """Return sigma |z|."""
        return self.sigma_db * np.abs(standard_normal)

    def chance_below(self, loss_db: FloatArray) -> FloatArray:
        """Return 2 Phi(loss / sigma) - 1, and 0 below 0 dB."""
        return one_sided_below(loss_db, self.sigma_db)


class NormalShadowing(_PerPacket):
    """v ~ N(0, sigma^2): log-normal shadowing (Rappaport, eq. 4.69)."""

    model: Literal["normal"] = "normal"
    sigma_db: float = Field(ge=0.0, le=60.0, description="standard deviation")

    @property
    def is_random(self) -> bool:
        """Whether sigma is above zero."""
        return self.sigma_db > 0.0

    @property
    def spread_db(self) -> float:
        """Sigma."""
        return self.sigma_db

    @property
    def max_gain_db(self) -> float:
        """Sigma times the largest draw."""
        return MAX_NORMAL * self.sigma_db

    def loss_db(self, standard_normal: FloatArray) -> FloatArray:
        """Return -sigma z: a loss for negative draws, a gain for positive ones."""
        return -self.sigma_db * standard_normal

    def chance_below(self, loss_db: FloatArray) -> FloatArray:
        """Return Phi(loss / sigma)."""
        return normal_below(loss_db, self.sigma_db)


class CorrelatedShadowing(Variant):
    """v ~ N(0, sigma^2), correlated over the way that either end has moved (Gudmundson 1991).

    Reciprocal: both directions of a pair are shadowed alike. See `shadow_field`.
    """

    model: Literal["gudmundson"] = "gudmundson"
    sigma_db: float = Field(ge=0.0, le=60.0, description="standard deviation")
    decorrelation_m: float = Field(gt=0.0, description="distance at which the correlation is 1/e")

    @property
    def is_random(self) -> bool:
        """Whether sigma is above zero."""
        return self.sigma_db > 0.0

    @property
    def spread_db(self) -> float:
        """Sigma."""
        return self.sigma_db

    @property
    def max_gain_db(self) -> float:
        """Sigma times the field where all its waves meet."""
        return math.sqrt(2.0 * WAVES) * self.sigma_db

    def loss_db(self, standard_normal: FloatArray) -> FloatArray:
        """Return -sigma z."""
        return -self.sigma_db * standard_normal

    def chance_below(self, loss_db: FloatArray) -> FloatArray:
        """Return Phi(loss / sigma)."""
        return normal_below(loss_db, self.sigma_db)


def standard_normal_from_uniform(uniform: FloatArray) -> FloatArray:
    """Return z with the standard normal law for u ~ U(0, 1), the open interval."""
    return np.asarray(special.ndtri(uniform))


def normal_below(loss_db: FloatArray, sigma_db: float) -> FloatArray:
    """Return the distribution function of N(0, sigma^2); a step at 0 if sigma is 0."""
    if sigma_db == 0.0:
        return np.asarray(loss_db >= 0.0, dtype=np.float64)
    return np.asarray(special.ndtr(loss_db / sigma_db))


def one_sided_below(loss_db: FloatArray, sigma_db: float) -> FloatArray:
    """Return the distribution function of |v|, v ~ N(0, sigma^2)."""
    if sigma_db == 0.0:
        return normal_below(loss_db, sigma_db)
    return np.maximum(2.0 * normal_below(loss_db, sigma_db) - 1.0, 0.0)
