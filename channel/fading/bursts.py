"""Bursts: losses that come in runs, whatever the range (Gilbert 1960, Elliott 1963)."""

from __future__ import annotations

import math
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from channel.checks import FloatArray
from channel.draws import uniform_from_words
from channel.fading.link_words import Words, counted
from channel.variant import Variant

NS_PER_S = 1e9
LEAST_S, LONGEST_S = 1e-6, 1e9
"""Of a state in the mean: instants are counted in whole nanoseconds of 64 bits."""
CELL_EVENTS = 2.0
"""Mean number of renewals in a cell of time."""


class BurstModel(Protocol):
    """A process in sim time that loses packets."""

    @property
    def mean_loss(self) -> float:
        """Share of packets lost in the long run."""
        ...

    def loss_at(self, words: Words, sim_time_ns: NDArray[np.int64]) -> FloatArray:
        """Return the probability of loss of links with these words at instants, shape (L,)."""
        ...


class NoBursts(Variant):
    """No bursts."""

    model: Literal["none"] = "none"

    @property
    def mean_loss(self) -> float:
        """0."""
        return 0.0

    def loss_at(self, _words: Words, sim_time_ns: NDArray[np.int64], /) -> FloatArray:
        """Return zeros."""
        return np.zeros(np.shape(sim_time_ns))


class GilbertElliott(Variant):
    """Two states in turn, each for an exponential time; in each, packets are lost with its own probability.

    The chain is drawn as its renewals: at the rate 1 / mean_good_s + 1 / mean_bad_s the state is drawn anew, bad with
    its share of time. That is the same process, and any instant can be computed alone: time is cut into cells, whose
    renewals depend on the link and the cell's number, and the state is that of the last renewal before.
    """

    model: Literal["gilbert-elliott"] = "gilbert-elliott"
    mean_good_s: float = Field(ge=LEAST_S, le=LONGEST_S)
    mean_bad_s: float = Field(ge=LEAST_S, le=LONGEST_S)
    loss_good: float = Field(default=0.0, ge=0.0, le=1.0)
    loss_bad: float = Field(default=1.0, ge=0.0, le=1.0)

    @property
    def bad_share(self) -> float:
        """Share of time in the bad state."""
        return self.mean_bad_s / (self.mean_good_s + self.mean_bad_s)

    @property
    def mean_loss(self) -> float:
        """Share of packets lost in the long run."""
        return self.bad_share * self.loss_bad + (1.0 - self.bad_share) * self.loss_good

    def loss_at(self, words: Words, sim_time_ns: NDArray[np.int64]) -> FloatArray:
        """Return the loss of the state at each instant, shape (L,)."""
        return np.where(self.is_bad(words, sim_time_ns), self.loss_bad, self.loss_good)

    def is_bad(self, words: Words, sim_time_ns: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Return whether links are in their bad state at instants, shape (L,)."""
        gap_ns = NS_PER_S / (1.0 / self.mean_good_s + 1.0 / self.mean_bad_s)
        cell_ns = max(math.ceil(CELL_EVENTS * gap_ns), 1)
        cell, within_ns = np.divmod(np.asarray(sim_time_ns, dtype=np.int64), cell_ns)
        bad = np.zeros(cell.shape, dtype=bool)
        open_links = np.arange(len(cell))
        while open_links.size:
            cells = counted(words[open_links], cell[open_links].astype(np.uint64))
            draw = _last_renewal(cells, within_ns[open_links].astype(np.float64), gap_ns)
            bad[open_links] = draw < self.bad_share
            open_links = open_links[np.isnan(draw)]
            cell[open_links] -= 1
            within_ns[open_links] = cell_ns - 1
        return bad


def _last_renewal(cells: Words, until_ns: FloatArray, gap_ns: float) -> FloatArray:
    """Return the uniform number of each cell's last renewal up to an instant in it; NaN if there is none."""
    last = np.full(len(cells), np.nan)
    at_ns = np.zeros(len(cells))
    going = np.arange(len(cells))
    count = 0
    while going.size:
        words = cells[going]
        gaps_ns = -np.log(uniform_from_words(counted(words, 2 * count))) * gap_ns
        at_ns[going] += np.rint(gaps_ns)  # whole numbers: no last bit of a logarithm adds up
        going = going[at_ns[going] <= until_ns[going]]
        last[going] = uniform_from_words(counted(cells[going], 2 * count + 1))
        count += 1
    return last
