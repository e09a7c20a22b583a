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
from numpy.typing import NDArray

from channel import special
from channel.checks import FloatArray
from channel.draws import WORDS_PER_COUNT, LinkDraws, uniform_from_words

WAVES = 128
LINKS_AT_ONCE = 128
"""So many stay in the processor's cache; changes no result."""
Indices = NDArray[np.intp]
_AXES = 3
_NORMALS_PER_END = 4
_COUNTS = WAVES * (2 * _NORMALS_PER_END + 1) // WORDS_PER_COUNT


class ShadowField:
    """Standard normal fields, one for each unordered pair of nodes.

    Args:
        draws: of the run's links.
        decorrelation_m: distance of either end at which the correlation has fallen to 1/e.
    """

    def __init__(self, draws: LinkDraws, decorrelation_m: float) -> None:
        self._draws = draws
        self._decorrelation_m = decorrelation_m
        self._row = np.full(len(draws.nodes) ** 2, -1, dtype=np.intp)
        self._waves = np.empty((0, 2 * _AXES, WAVES))
        self._phases = np.empty((0, WAVES))
        self._held = 0

    def standard_normal(
        self, tx: Indices, rx: Indices, tx_ned_m: FloatArray, rx_ned_m: FloatArray
    ) -> FloatArray:
        """Return the field of each link's pair, shape (L,), for nodes of shape (L,) and positions of shape (L, 3)."""
        low, high = self._draws.by_name(tx, rx)
        rows, turned = self._rows(low, high), low != tx
        tx_ned_m, rx_ned_m = np.broadcast_arrays(tx_ned_m, rx_ned_m)
        first = np.where(turned, rx_ned_m.T, tx_ned_m.T)
        places = np.concatenate((first, np.where(turned, tx_ned_m.T, rx_ned_m.T)))
        out = np.empty(len(rows))
        for start in range(0, len(rows), LINKS_AT_ONCE):
            part = slice(start, start + LINKS_AT_ONCE)
            phase = self._phases[rows[part]]
            for waves, place in zip(self._waves[rows[part]].transpose(1, 0, 2), places[:, part], strict=True):
                phase += waves * place[:, np.newaxis]
            out[part] = np.cos(phase, out=phase).sum(axis=-1)
        return math.sqrt(2.0 / WAVES) * out

    def _rows(self, low: Indices, high: Indices) -> Indices:
        """Return where the waves of pairs lie, lower name first; those of new pairs are drawn."""
        pair = low * len(self._draws.nodes) + high
        new, first = np.unique(np.where(self._row[pair] < 0, pair, -1), return_index=True)
        if new.size and new[-1] >= 0:
            wanted = first[new >= 0]
            self._row[pair[wanted]] = self._held + np.arange(wanted.size)
            self._draw(low[wanted], high[wanted])
        rows: Indices = self._row[pair]
        return rows

    def _draw(self, low: Indices, high: Indices) -> None:
        """Draw wave vectors over (place of low, place of high) and phases of pairs, each pair once."""
        each = np.repeat(np.arange(low.size), _COUNTS)
        counts = np.tile(np.arange(_COUNTS), low.size)
        words = self._draws.words(("shadow field",), low[each], high[each], counts)
        uniform = uniform_from_words(words.T.reshape(-1)).reshape(low.size, WAVES, -1)
        normal = special.ndtri(uniform[..., :-1]).reshape(low.size, WAVES, 2, _NORMALS_PER_END)
        waves = normal[..., :_AXES] / np.abs(normal[..., _AXES:]) / self._decorrelation_m
        self._waves = np.concatenate((self._waves, waves.reshape(low.size, WAVES, -1).transpose(0, 2, 1)))
        self._phases = np.concatenate((self._phases, 2.0 * math.pi * uniform[..., -1]))
        self._held += low.size
