"""Bursts: losses that come in runs, whatever the range (Gilbert 1960, Elliott 1963)."""

from __future__ import annotations

from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from channel.checks import FloatArray
from channel.draws import LinkDraws, uniform_from_words
from channel.variant import Variant

NS_PER_S = 1e9
SOJOURNS_AT_ONCE = 64
Indices = NDArray[np.intp]
Times = NDArray[np.int64]


class BurstModel(Protocol):
    """A process in sim time that loses packets."""

    @property
    def mean_loss(self) -> float:
        """Share of packets lost in the long run."""
        ...

    def loss(self, timelines: Timelines, tx: Indices, rx: Indices, sim_time_ns: Times) -> FloatArray:
        """Return the probability of loss on links at instants, all of shape (L,)."""
        ...


class NoBursts(Variant):
    """No bursts."""

    model: Literal["none"] = "none"

    @property
    def mean_loss(self) -> float:
        """0."""
        return 0.0

    def loss(self, _timelines: Timelines, _tx: Indices, _rx: Indices, sim_time_ns: Times, /) -> FloatArray:
        """Return zeros."""
        return np.zeros(len(sim_time_ns))


class GilbertElliott(Variant):
    """Two states in turn, each for an exponential time; in each, packets are lost with its own probability."""

    model: Literal["gilbert-elliott"] = "gilbert-elliott"
    mean_good_s: float = Field(gt=0.0)
    mean_bad_s: float = Field(gt=0.0)
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

    def loss(self, timelines: Timelines, tx: Indices, rx: Indices, sim_time_ns: Times) -> FloatArray:
        """Return the loss of the states at instants."""
        return np.where(timelines.are_bad(self, tx, rx, sim_time_ns), self.loss_bad, self.loss_good)


class Timelines:
    """The states of all directed links over sim time: fixed by the seed, laid out as far as somebody looks.

    Args:
        draws: of the run's links.
    """

    def __init__(self, draws: LinkDraws) -> None:
        self._draws = draws
        links = len(draws.nodes) ** 2
        self._row = np.full(links, -1, dtype=np.intp)
        self._ends_ns = np.empty((0, SOJOURNS_AT_ONCE))
        self._laid = np.empty(0, dtype=np.intp)
        self._starts_bad = np.empty(0, dtype=bool)
        self._at = np.empty(0, dtype=np.intp)

    def are_bad(
        self, model: GilbertElliott, tx: Indices, rx: Indices, sim_time_ns: Times
    ) -> NDArray[np.bool_]:
        """Return whether links are in their bad state at instants; before 0 they are as at 0."""
        rows = self._rows(tx, rx)
        times = np.maximum(sim_time_ns, 0)
        while True:
            short = self._ends_ns[rows, self._laid[rows] - 1] <= times
            short |= self._laid[rows] == 0
            if not short.any():
                break
            _, first = np.unique(rows[short], return_index=True)
            self._extend(model, rows[short][first], tx[short][first], rx[short][first])
        at = self._at[rows]
        while True:  # seldom more than a step from where the link was last
            step = np.where(self._ends_ns[rows, at] <= times, 1, 0)
            step -= (at > 0) & (self._ends_ns[rows, np.maximum(at - 1, 0)] > times)
            if not step.any():
                break
            at = at + step
        self._at[rows] = at
        bad: NDArray[np.bool_] = (at % 2 == 1) != self._starts_bad[rows]
        return bad

    def _rows(self, tx: Indices, rx: Indices) -> Indices:
        """Return the row of each link; links seen for the first time get one."""
        link = tx * len(self._draws.nodes) + rx
        new = np.unique(link[self._row[link] < 0])
        if new.size:
            old = len(self._laid)
            self._row[new] = old + np.arange(new.size)
            blank = np.zeros(new.size, dtype=np.intp)
            room = np.full((new.size, self._ends_ns.shape[1]), np.inf)
            self._ends_ns = np.concatenate((self._ends_ns, room))
            self._laid, self._at = np.concatenate((self._laid, blank)), np.concatenate((self._at, blank))
            self._starts_bad = np.concatenate((self._starts_bad, blank.astype(bool)))
        rows: Indices = self._row[link]
        return rows

    def _extend(self, model: GilbertElliott, rows: Indices, tx: Indices, rx: Indices) -> None:
        """Lay out further states of links, each row once."""
        counts = self._laid[rows][:, np.newaxis] + np.arange(SOJOURNS_AT_ONCE)
        if counts[:, -1].max() >= self._ends_ns.shape[1]:
            self._ends_ns = np.concatenate((self._ends_ns, np.full_like(self._ends_ns, np.inf)), axis=1)
        each = np.repeat(np.arange(rows.size), SOJOURNS_AT_ONCE)
        words = self._draws.words(("bursts",), tx[each], rx[each], counts.ravel())
        length, start = uniform_from_words(words[:2]).reshape(2, *counts.shape)
        fresh = self._laid[rows] == 0
        self._starts_bad[rows[fresh]] = start[fresh, 0] < model.bad_share
        bad = (counts % 2 == 1) != self._starts_bad[rows][:, np.newaxis]
        lengths_ns = -np.log(length) * np.where(bad, model.mean_bad_s, model.mean_good_s) * NS_PER_S
        start_ns = np.where(fresh, 0.0, self._ends_ns[rows, self._laid[rows] - 1])
        whole_ns = np.rint(lengths_ns)  # sums of whole numbers are exact: no last bit of a logarithm adds up
        self._ends_ns[rows[:, np.newaxis], counts] = start_ns[:, np.newaxis] + np.cumsum(whole_ns, axis=1)
        self._laid[rows] += SOJOURNS_AT_ONCE
