"""Spatially correlated shadowing: a random field over the places of both ends, without memory.

A sum of 128 waves with random directions, lengths and phases (Cai & Giannakis, IEEE Trans. Veh. Technol. 52
(2003)). Wave vectors follow the Cauchy law in three dimensions, whose characteristic function is exp(-d / d_corr):
over the seeds the field has exactly Gudmundson's autocorrelation exp(-(d_tx + d_rx) / d_corr) (Electronics Letters
27 (1991); both ends: Wang et al., VTC 2005), and a normal law up to an excess kurtosis of -1.5 / 128.

The value depends on the places alone: not on who asked before, nor how often. A pair shares one field, so that the
link is reciprocal.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.special import ndtri

from channel.checks import FloatArray
from channel.draws import WORDS_PER_COUNT, Draws, uniform_from_words

WAVES = 128
_NORMALS_PER_END = 4
_COUNTS = WAVES * (2 * _NORMALS_PER_END + 1) // WORDS_PER_COUNT


class ShadowField:
    """Standard normal fields, one for each unordered pair of nodes.

    Args:
        draws: the run's draws.
        decorrelation_m: distance of either end at which the correlation has fallen to 1/e.
    """

    def __init__(self, draws: Draws, decorrelation_m: float) -> None:
        self._draws = draws
        self._decorrelation_m = decorrelation_m
        self._waves: dict[tuple[str, str], tuple[FloatArray, FloatArray]] = {}
        self._stacks: dict[tuple[str, tuple[str, ...]], tuple[FloatArray, FloatArray]] = {}

    def standard_normal(
        self, tx: str, receivers: tuple[str, ...], tx_ned_m: FloatArray, rx_ned_m: FloatArray
    ) -> FloatArray:
        """Return the field of each pair, shape (receivers,), for positions of shape (3,) and (receivers, 3)."""
        stack = self._stacks.get((tx, receivers))
        if stack is None:
            pairs = [self._of_pair(tx, rx) for rx in receivers]
            waves = np.stack([waves.T for waves, _ in pairs], axis=1)
            stack = waves, np.stack([phases for _, phases in pairs])
            self._stacks[tx, receivers] = stack
        places = np.concatenate((np.broadcast_to(tx_ned_m, rx_ned_m.shape), rx_ned_m), axis=-1)
        phase = stack[1]
        for k in range(
            places.shape[-1]
        ):  # in a fixed order, so that no bit depends on how many receivers there are
            phase = phase + stack[0][k] * places[:, k, np.newaxis]
        return np.asarray(math.sqrt(2.0 / WAVES) * np.cos(phase).sum(axis=-1))

    def _of_pair(self, tx: str, rx: str) -> tuple[FloatArray, FloatArray]:
        """Return wave vectors over (place of tx, place of rx), shape (waves, 6), and phases, shape (waves,)."""
        pair = (tx, rx) if tx <= rx else (rx, tx)
        if pair not in self._waves:
            words = self._draws.words((*pair, "shadow field"), 0, _COUNTS)
            uniform = uniform_from_words(words.ravel()).reshape(WAVES, -1)
            normal = ndtri(uniform[:, :-1]).reshape(WAVES, 2, _NORMALS_PER_END)
            waves = normal[:, :, :3] / np.abs(normal[:, :, 3:]) / self._decorrelation_m
            self._waves[pair] = waves, 2.0 * math.pi * uniform[:, -1]
        waves, phases = self._waves[pair]
        ordered = waves if pair == (tx, rx) else waves[:, ::-1]
        return ordered.reshape(WAVES, 6), phases
