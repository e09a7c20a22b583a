"""Bursts: losses that come in runs, whatever the range (Gilbert 1960, Elliott 1963)."""

from __future__ import annotations

import bisect
from typing import Literal, Protocol

import numpy as np
from pydantic import Field

from channel.draws import Draws, uniform_from_words
from channel.variant import Variant

NS_PER_S = 1e9
SOJOURNS_AT_ONCE = 64


class BurstModel(Protocol):
    """A process in sim time that loses packets."""

    @property
    def mean_loss(self) -> float:
        """Share of packets lost in the long run."""
        ...

    def loss_at(self, timeline: Timeline, sim_time_ns: int) -> float:
        """Return the probability of loss at an instant."""
        ...


class NoBursts(Variant):
    """No bursts."""

    model: Literal["none"] = "none"

    @property
    def mean_loss(self) -> float:
        """0."""
        return 0.0

    def loss_at(self, _timeline: Timeline, _sim_time_ns: int, /) -> float:
        """Return 0."""
        return 0.0


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

    def loss_at(self, timeline: Timeline, sim_time_ns: int) -> float:
        """Return the loss of the state at an instant."""
        return self.loss_bad if timeline.is_bad(self, sim_time_ns) else self.loss_good


class Timeline:
    """The states of one directed link over sim time: fixed by the seed, laid out as far as somebody looks.

    Args:
        draws: the run's draws.
        tx: transmitting node.
        rx: receiving node.
    """

    def __init__(self, draws: Draws, tx: str, rx: str) -> None:
        self._draws = draws
        self._names = (tx, rx, "bursts")
        self._ends_ns: list[float] = []
        self._starts_bad = False

    def is_bad(self, model: GilbertElliott, sim_time_ns: int) -> bool:
        """Return whether the link is in its bad state at an instant; before 0 it is as at 0."""
        while not self._ends_ns or self._ends_ns[-1] <= sim_time_ns:
            self._extend(model)
        return (bisect.bisect_right(self._ends_ns, max(sim_time_ns, 0)) % 2 == 1) != self._starts_bad

    def _extend(self, model: GilbertElliott) -> None:
        first = len(self._ends_ns)
        words = self._draws.words(self._names, first, SOJOURNS_AT_ONCE)
        uniform = uniform_from_words(words[:, :2])
        if first == 0:
            self._starts_bad = bool(uniform[0, 1] < model.bad_share)
        bad = (np.arange(first, first + SOJOURNS_AT_ONCE) % 2 == 1) != self._starts_bad
        lengths_ns = -np.log(uniform[:, 0]) * np.where(bad, model.mean_bad_s, model.mean_good_s) * NS_PER_S
        start_ns = self._ends_ns[-1] if self._ends_ns else 0.0
        whole_ns = np.rint(lengths_ns)  # sums of whole numbers are exact: no last bit of a logarithm adds up
        self._ends_ns += (start_ns + np.cumsum(whole_ns)).tolist()
