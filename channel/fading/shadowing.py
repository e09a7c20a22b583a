"""Shadowing: the slow random part of the loss, one value per packet and link, in dB."""

from __future__ import annotations

import math
from typing import Literal, Protocol, Self

import numpy as np
from pydantic import Field

from channel.checks import ChannelInputError, FloatArray
from channel.fading.place_field import FARTHEST, MAX_FIELD
from channel.numbers import special
from channel.variant import Variant

MAX_NORMAL = 8.209536151601387
"""The farthest from 0 that a draw of a standard normal variable gets: uniform draws end half a cell before 0 and 1."""


class ShadowingModel(Protocol):
    """A random loss, given as a function of one standard normal variable.

    A law may say `max_gain_db`, the largest gain that any draw gives: packets that it does not save cost no draw. With
    a decorrelation distance it may say `surroundings` (`own` unless it does) and `shared_ends` (0), see
    `CorrelatedShadowing`.
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

    def in_sight(self, seen: bool, /) -> float | None:
        """Return sigma with or without line of sight, dB; None: that of the propagation model's table."""
        ...

    def with_sigma(self, sigma_db: float, /) -> ShadowingModel:
        """Return the same law with another sigma, whatever the line of sight."""
        ...


class PerPacketShadowing(Variant):
    """Shadowing that is drawn anew for each packet, as the paper's is, whatever the line of sight.

    A law of one's own derives from it, and has a field `sigma_db`, `spread_db`, `loss_db` and `chance_below`. With a
    `decorrelation_m` that is a number the draws are correlated over the way of the ends.
    """

    @property
    def is_random(self) -> bool:
        """Whether the spread is above zero."""
        return self.spread_db > 0.0

    def in_sight(self, _seen: bool, /) -> float:
        """Return sigma."""
        return self.spread_db

    def with_sigma(self, sigma_db: float) -> Self:
        """Return the same law with another sigma."""
        return self.model_copy(update={"sigma_db": sigma_db})

    @property
    def spread_db(self) -> float:
        """Loss per unit of |z|, dB."""
        raise NotImplementedError

    @property
    def decorrelation_m(self) -> float | None:
        """None."""
        return None


class NoShadowing(PerPacketShadowing):
    """No shadowing."""

    model: Literal["none"] = "none"

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


class OneSidedNormalShadowing(PerPacketShadowing):
    """|v| with v ~ N(0, sigma^2): shadowing can only cost (Moon et al. 2020, eq. 4)."""

    model: Literal["one-sided-normal"] = "one-sided-normal"
    sigma_db: float = Field(ge=0.0, le=60.0, description="standard deviation of v, not of |v|")

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


class _Normal(Variant):
    """v ~ N(0, sigma^2), with a sigma for each state of the line of sight."""

    sigma_db: float | None = Field(
        default=None,
        ge=0.0,
        le=60.0,
        description="standard deviation; if not given, that of the propagation model's own table (uma-av, rma-av)",
    )
    sigma_without_sight_db: float | None = Field(
        default=None, ge=0.0, le=60.0, description="without line of sight; sigma_db if not given"
    )

    @property
    def is_random(self) -> bool:
        """Whether a sigma is above zero."""
        return self.in_sight(True) != 0.0 or self.in_sight(False) != 0.0

    @property
    def spread_db(self) -> float:
        """Sigma."""
        if self.sigma_db is None:
            raise ChannelInputError("sigma_db", None, "a number, but for propagation with a table of its own")
        return self.sigma_db

    def in_sight(self, seen: bool, /) -> float | None:
        """Return sigma with or without line of sight, dB; None: that of the propagation model's table."""
        if seen or self.sigma_without_sight_db is None:
            return self.sigma_db
        return self.sigma_without_sight_db

    def with_sigma(self, sigma_db: float) -> Self:
        """Return the same law with another sigma, whatever the line of sight."""
        return self.model_copy(update={"sigma_db": sigma_db, "sigma_without_sight_db": None})

    @property
    def max_gain_db(self) -> float:
        """The larger sigma times the largest draw; inf if the propagation model says how large it is."""
        sigmas_db = [self.in_sight(seen) for seen in (True, False)]
        return max(math.inf if each is None else self.max_normal * each for each in sigmas_db)

    @property
    def max_normal(self) -> float:
        """The farthest from 0 that z gets."""
        return MAX_NORMAL

    def loss_db(self, standard_normal: FloatArray) -> FloatArray:
        """Return -sigma z: a loss for negative draws, a gain for positive ones."""
        return -self.spread_db * standard_normal

    def chance_below(self, loss_db: FloatArray) -> FloatArray:
        """Return Phi(loss / sigma)."""
        return normal_below(loss_db, self.spread_db)


class NormalShadowing(_Normal):
    """v ~ N(0, sigma^2), drawn anew for each packet: log-normal shadowing (Rappaport, eq. 4.69)."""

    model: Literal["normal"] = "normal"

    @property
    def decorrelation_m(self) -> None:
        """None."""
        return


class CorrelatedShadowing(_Normal):
    """v ~ N(0, sigma^2), correlated over the way that either end has moved (Gudmundson 1991).

    Reciprocal: both directions of a pair are shadowed alike. See `place_field`. What stands in the way is there for
    everybody: with `surroundings: shared` the shadowing is one field over the places of both ends (as in Agrawal &
    Patwari, IEEE Trans. Wireless Commun. 8 (2009), links are correlated by where they are, not by whose they are), so
    that UA side by side are shadowed alike. With `own` each pair has a field of its own.

    With `shared_ends` = r the surroundings of each end, common to all its links, have the share r of the variance,
    so that two links with an end in common are correlated by r. r = 1/2 is the model of Viterbi et al. (IEEE J.
    Sel. Areas Commun. 12 (1994)), and what 3GPP evaluates with (TR 36.814, annex A.2.1), for both ends alike.
    """

    model: Literal["gudmundson"] = "gudmundson"
    decorrelation_m: float = Field(gt=0.0, description="distance at which the correlation is 1/e")
    surroundings: Literal["shared", "own"] = Field(
        default="shared",
        description="one field over the places of both ends for all pairs; or one for each pair",
    )
    shared_ends: float = Field(
        default=0.0, ge=0.0, le=0.5, description="correlation of two links that have one end in common"
    )

    @property
    def max_normal(self) -> float:
        """The field where all its waves meet; and those of the surroundings."""
        share = self.shared_ends
        of_both = FARTHEST if self.surroundings == "shared" else MAX_FIELD
        return MAX_FIELD * 2.0 * math.sqrt(share) + of_both * math.sqrt(1.0 - 2.0 * share)


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
