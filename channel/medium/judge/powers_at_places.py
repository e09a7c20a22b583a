"""Powers at places far from each other, each as where in its law it lies.

With F the distribution function of the law, a power that is written as p, to one step, was in the cell from p - half a
step to p + half a step. So u = F(low) + v (F(high) - F(low)) with v uniform is uniform over (0, 1), whether the law is
smooth or has steps (the randomised probability integral transform: Brockwell, Statistics & Probability Letters 77
(2007)), and z = Phi^-1(u) is N(0, 1).
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from channel.checks import FloatArray
from channel.draws import Draws
from channel.link.gain_law import chance_of_less
from channel.medium.judge.changes import apart_ns
from channel.medium.judge.check import Check, Unjudged, normal_check, spread_check
from channel.medium.judge.heard import CELL_DB, HeardPower
from channel.medium.judge.spots import Spots
from channel.numbers import special

LEVEL_OF_POWERS, SPREAD_OF_POWERS = "level of the powers", "spread of the powers"
APART = 3.0
"""Places are so many decorrelation distances apart."""
LEAST_PLACES = 8
OFF_DB = 2.0
"""The checks are measured by powers, and a spread of them, that are off by this."""
FARTHEST = 8.0


class PowersAtPlaces:
    """Collects powers and asks for their level and their spread.

    Args:
        draws: whose seed v comes from.
    """

    def __init__(self, draws: Draws) -> None:
        self._draws = draws
        self._spots = Spots(APART)
        self._normal: list[FloatArray] = []
        self._crowding = np.zeros(2)

    def take(self, look: HeardPower) -> int:
        """Keep a power if its place is new; returns how long its link is left alone, ns."""
        crowding = self._spots.crowding(look)
        if crowding is not None:
            self._crowding += crowding
            v = float(look.uniforms(self._draws, "place", 1)[0])
            self._normal.append(normal_of(look, v, np.array([0.0, OFF_DB, -OFF_DB])))
        return apart_ns(look.radio)

    def checks(self) -> Iterator[Check | Unjudged]:
        """Yield what there is to say."""
        count = len(self._normal)
        if count < LEAST_PLACES:
            why = f"{count} of {LEAST_PLACES} places"
            yield from (Unjudged(name, why) for name in (LEVEL_OF_POWERS, SPREAD_OF_POWERS))
            return
        normal, higher, lower = np.array(self._normal).T
        wrong = f"{OFF_DB:g} dB off"
        # the mean of correlated variables varies by the sum of all their correlations
        level, spread = self._crowding.tolist()
        weight = count / math.sqrt(count + 2.0 * level)
        shift = min(float((higher - normal).mean()), float((normal - lower).mean()))
        mean = float(normal.mean())
        yield normal_check(LEVEL_OF_POWERS, count, mean * weight, wrong, shift * weight)
        around = float(np.square(normal - mean).sum()) / (count - 1)
        ratio = (1.0 + max(shift, 0.0)) ** 2
        freedom = (count - 1) / (
            1.0 + 2.0 * spread / count
        )  # likewise that of their squares, by the squares of these
        yield spread_check(SPREAD_OF_POWERS, count, around, freedom, wrong, ratio)


def normal_of(look: HeardPower, v: float, off_db: FloatArray) -> FloatArray:
    """Return z of a power that is off by so much, same shape.

    Args:
        look: the power.
        v: uniform over (0, 1).
        off_db: added to the power.
    """
    gain_db = look.gain_db + off_db
    edges_db = np.concatenate((gain_db - CELL_DB, gain_db + CELL_DB))
    low, high = chance_of_less(look.radio, look.path, edges_db).reshape(2, -1)
    return np.clip(special.ndtri(low + v * (high - low)), -FARTHEST, FARTHEST)
