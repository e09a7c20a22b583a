"""Averages that UA find by exchanging numbers, over links that lose packets; no I/O, no clock, no draws.

Numbers may be of any kind that adds and divides: floats in flight, fractions in tests.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

Numbers = tuple[Any, ...]


class Averaging(Protocol):
    """One UA's part: `hear` what others broadcast, and at each step broadcast what `step` gives."""

    @property
    def estimate(self) -> Numbers:
        """What it believes the average to be."""

    def step(self) -> Numbers:
        """Go on by one step; gives what is to be broadcast."""

    def hear(self, sender: str, number: int, told: Numbers) -> None:
        """Take the broadcast of a step of another UA; steps are numbered upwards."""


class RunningSums:
    """Ratio consensus by running sums: finds the average of all values whatever packets are lost.

    Each UA has mass: its value, and a weight of 1. At a step it keeps one of ``nodes`` equal shares of its mass, and
    gives one to each other UA. It does not broadcast the share, but the sum of all shares so far: who misses a
    broadcast gets what was in it with the next one. So mass is never lost, at worst it is on its way, and the
    quotient of mass and weight tends to the average as long as each link delivers again and again.

    Source: Vaidya, Hadjicostis and Dominguez-Garcia, "Robust average consensus over packet dropping links: analysis via
    coefficients of ergodicity", IEEE CDC 2012; Hadjicostis, Vaidya and Dominguez-Garcia, "Robust distributed average
    consensus via exchange of running sums", IEEE Trans. Automatic Control 61(6), 2016.

    Args:
        values: what it brings in.
        nodes: how many UA there are.

    Attributes:
        mass: its values, and behind them its weight.
        sums: what it has given to each other UA so far, likewise.
        heard: of each other UA, number and sums of the newest broadcast.
    """

    def __init__(self, values: Sequence[Any], nodes: int) -> None:
        self.nodes = nodes
        self.mass: Numbers = (*values, 1)
        self.sums: Numbers = (0,) * len(self.mass)
        self.heard: dict[str, tuple[int, Numbers]] = {}

    @property
    def estimate(self) -> Numbers:
        """Mass over weight."""
        *values, weight = self.mass
        return tuple(value / weight for value in values)

    def step(self) -> Numbers:
        """Keep a share, give one to each other UA; gives the sums."""
        self.mass = tuple(each / self.nodes for each in self.mass)
        self.sums = tuple(so_far + share for so_far, share in zip(self.sums, self.mass, strict=True))
        return self.sums

    def hear(self, sender: str, number: int, told: Numbers) -> None:
        """Take what was given since the newest broadcast heard; an older one has nothing new."""
        newest, before = self.heard.get(sender, (-1, (0,) * len(told)))
        if number > newest:
            given = (now - then for now, then in zip(told, before, strict=True))
            self.mass = tuple(own + more for own, more in zip(self.mass, given, strict=True))
            self.heard[sender] = (number, told)


class Naive:
    """Averages its estimate with those that it heard since the last step.

    If every packet arrives, the average of all estimates stays as it is. If A hears B but B misses A, it moves: the UA
    agree, but not on the average.

    Args:
        values: what it brings in.
        nodes: how many UA there are.
    """

    def __init__(self, values: Sequence[Any], nodes: int) -> None:
        self.nodes = nodes
        self.estimate: Numbers = tuple(values)
        self.heard: dict[str, tuple[int, Numbers]] = {}

    def step(self) -> Numbers:
        """Go an ``nodes``-th of the way to each that was heard; gives the new estimate."""
        heard = [self.heard[sender][1] for sender in sorted(self.heard)]
        self.estimate = tuple(
            own + sum(other[axis] - own for other in heard) / self.nodes
            for axis, own in enumerate(self.estimate)
        )
        self.heard.clear()
        return self.estimate

    def hear(self, sender: str, number: int, told: Numbers) -> None:
        """Keep the newest of each."""
        if sender not in self.heard or number > self.heard[sender][0]:
            self.heard[sender] = (number, told)


SCHEMES: dict[str, type[RunningSums] | type[Naive]] = {"running_sums": RunningSums, "naive": Naive}
