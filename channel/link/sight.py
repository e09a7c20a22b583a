"""Line of sight as a random state: delivery is the mixture over both, each with its own loss and shadowing."""

from __future__ import annotations

import math
from typing import NamedTuple, Protocol, cast

import numpy as np
from numpy.typing import NDArray

from channel.checks import ChannelInputError, FloatArray
from channel.config import RadioConfig
from channel.fading.shadowing import ShadowingModel
from channel.geometry import Path
from channel.link.expectation import Expectation
from channel.link.tables.lengths import Lengths
from channel.numbers import special
from channel.numbers.units import db_from_ratio, ratio_from_db
from channel.phy.error_model import Band
from channel.propagation.air_to_ground import SightState

SIGMA_RATIO = 1.02
"""Between the sigmas that are tabulated; in between, averages go linearly with its logarithm, within 2e-5."""


class _Propagation(Protocol):
    @property
    def sight_decorrelation_m(self) -> float: ...

    def sight_states(self, path: Path) -> tuple[SightState, SightState]: ...

    def path_loss_db(self, path: Path) -> FloatArray: ...


class State(NamedTuple):
    """One state of links.

    Attributes:
        chance: its probability.
        excess_db: its path loss less that of the link budget, which is the mean in dB over the states.
        sigma_db: of its shadowing.
    """

    chance: FloatArray
    excess_db: FloatArray
    sigma_db: FloatArray


class Sight:
    """The two states of a radio whose propagation draws the line of sight.

    Args:
        config: the radio.
        band: its noise bandwidth and bit rate.

    Raises:
        ChannelInputError: the shadowing has no sigma, and the propagation has none of its own.
    """

    def __init__(self, config: RadioConfig, band: Band) -> None:
        self._config = config
        self._band = band
        self._propagation = cast(_Propagation, config.propagation)
        self.decorrelation_m = self._propagation.sight_decorrelation_m
        self._expectations: dict[float, Expectation] = {}
        self._unit: ShadowingModel | None = None
        if config.shadowing.is_random:
            self._unit = config.shadowing.with_sigma(1.0)

    def states(self, path: Path) -> tuple[State, State]:
        """Return the state with line of sight and the one without."""
        mean_db = self._propagation.path_loss_db(path)
        both = self._propagation.sight_states(path)
        shape = np.shape(mean_db)
        states = []
        for seen, (chance, loss_db, published_db) in zip((True, False), both, strict=True):
            sigma_db = np.broadcast_to(self._sigma_db(seen, published_db), shape)
            states.append(State(np.broadcast_to(chance, shape), loss_db - mean_db, sigma_db))
        return states[0], states[1]

    def _sigma_db(self, seen: bool, published_db: FloatArray | None) -> FloatArray | float:
        sigma_db = self._config.shadowing.in_sight(seen)
        if sigma_db is not None:
            return sigma_db
        if published_db is None:
            raise ChannelInputError(
                "shadowing.sigma_db",
                None,
                f"a number: {getattr(self._config.propagation, 'model', 'own propagation')} has none of its own",
            )
        return published_db

    def loss_db(self, path: Path, sight_normal: FloatArray, shadow_normal: FloatArray | None) -> FloatArray:
        """Return what the drawn state and its shadowing take beyond the link budget, dB, shape (L,).

        Args:
            path: the links.
            sight_normal: the field of the line of sight, N(0, 1): there is one below its quantile of the chance.
            shadow_normal: of the shadowing, N(0, 1); None: no shadowing.
        """
        with_sight, without = self.states(path)
        seen = sight_normal < special.ndtri(with_sight.chance)
        loss_db = np.where(seen, with_sight.excess_db, without.excess_db)
        if self._unit is not None and shadow_normal is not None:
            loss_db += np.where(seen, with_sight.sigma_db, without.sigma_db) * self._unit.loss_db(
                shadow_normal
            )
        return loss_db

    def mean_gain_db(self, path: Path) -> FloatArray:
        """Return what the mean in watt over both states is above that of the link budget, dB."""
        shares = [state.chance * ratio_from_db(-state.excess_db) for state in self.states(path)]
        return np.asarray(db_from_ratio(shares[0] + shares[1]))

    def averaged(
        self,
        snr_db: FloatArray,
        length_bytes: FloatArray,
        path: Path,
        panels: int,
        least_db: FloatArray | float | None = None,
    ) -> FloatArray:
        """Return E[1 - PER] by quadrature over states, shadowing and fading.

        Args:
            snr_db: with the path loss of the link budget.
            length_bytes: as the error model counts it; broadcasts.
            path: the links.
            panels: of the quadrature rule for each random term.
            least_db: an SNR below which nothing comes; None: there is none.
        """
        arrays = np.broadcast_arrays(snr_db, length_bytes, path.elevation_deg)
        out = np.zeros(arrays[0].shape)
        least = None if least_db is None else np.broadcast_to(least_db, out.shape)
        for state in self.states(path):
            chance, excess_db, sigma_db = (np.broadcast_to(each, out.shape) for each in state)
            snr = arrays[0] - excess_db
            for sigma in np.unique(sigma_db).tolist():
                here = sigma_db == sigma
                some = None if least is None else least[here]
                each = self._expectation(sigma).averaged(
                    snr[here], arrays[1][here], arrays[2][here], panels, some
                )
                out[here] += chance[here] * each
        return out

    def from_table(
        self, snr_db: FloatArray, lengths: Lengths, path: Path, least_db: FloatArray | float | None = None
    ) -> FloatArray:
        """Return E[1 - PER] from tables: fast, within 1e-5 of the quadrature, 2e-5 for a sigma that varies.

        With ``least_db`` within 0.01.
        """
        shape = np.shape(snr_db)

        def flat(values: FloatArray) -> FloatArray:
            return np.broadcast_to(values, shape).ravel()

        elevation = flat(path.elevation_deg) if self._config.fading.by_elevation else None
        each_least = flat(least_db) if isinstance(least_db, np.ndarray) and least_db.ndim else None
        out = np.zeros(flat(snr_db).shape)
        for state in self.states(path):
            chance, excess_db, sigma_db = (flat(each) for each in state)
            for sigma, weight in _tabulated(sigma_db):
                here = np.flatnonzero(weight)
                angles = None if elevation is None else elevation[here]
                least = least_db if each_least is None else each_least[here]
                at_db = (flat(snr_db) - excess_db)[here]
                success = self._expectation(sigma).from_table(at_db, lengths.at(here), angles, least)
                out[here] += weight[here] * chance[here] * success
        return out.reshape(shape)

    def _expectation(self, sigma_db: float) -> Expectation:
        expectation = self._expectations.get(sigma_db)
        if expectation is None:
            shadowing = self._config.shadowing
            if self._unit is not None:
                shadowing = self._config.shadowing.with_sigma(sigma_db)
            config = self._config.model_copy(update={"shadowing": shadowing})
            expectation = self._expectations[sigma_db] = Expectation(config, self._band)
        return expectation


def _tabulated(sigma_db: FloatArray) -> list[tuple[float, FloatArray]]:
    """Return tabulated sigmas, each with its weight at every link, which sum up to 1."""
    if sigma_db.size == 0 or np.all(sigma_db == sigma_db.flat[0]):
        return [(float(sigma), np.ones(sigma_db.shape)) for sigma in sigma_db.flat[:1]]
    at = np.log(np.maximum(sigma_db, 1e-3)) / math.log(SIGMA_RATIO)
    low: NDArray[np.float64] = np.floor(at)
    part = at - low
    steps = np.unique(np.concatenate((low, low + 1.0), axis=None)).tolist()
    return [
        (SIGMA_RATIO**step, np.where(low == step, 1.0 - part, 0.0) + np.where(low + 1.0 == step, part, 0.0))
        for step in steps
    ]
