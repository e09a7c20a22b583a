"""Questions about a run and their answers: how likely it is if nothing is wrong, and what would have been seen."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

from channel.numbers import special

LEVEL = 2e-4
"""Of each check: with eight that count, the verdict fails in fewer than two of a thousand runs with nothing wrong."""
ENOUGH = 0.9
"""Power from which on a check is said to see something."""
NO_SKEW = 1e-4
"""Less than this makes no difference to the chances, and its gamma law no number."""


class Check(NamedTuple):
    """One question about a run.

    Attributes:
        name: what is judged.
        size: of how many packets, bins, places or pairs of packets.
        found: the statistic.
        chance: of one at least as far off, if nothing is wrong.
        wrong: a defect to measure the check by.
        power: probability with which the check fails if there is this defect.
    """

    name: str
    size: int
    found: float
    chance: float
    wrong: str = "any"
    power: float = 1.0

    @property
    def passed(self) -> bool:
        """Whether the chance is not below the level."""
        return self.chance >= LEVEL

    @property
    def plain(self) -> dict[str, Any]:
        """All of it, for JSON."""
        return self._asdict() | {"passed": self.passed, "sees": self.sees}

    @property
    def sees(self) -> bool:
        """Whether there was enough to see the defect."""
        return self.power >= ENOUGH


BASE_LOSS: Final = "base loss"
"""Name of the check of what a radio loses whatever the channel does."""


class Unjudged(NamedTuple):
    """A question that a run says too little about, and why."""

    name: str
    why: str


@dataclass(frozen=True, slots=True)
class Verdict:
    """What the checks say together; a run too short for any of them says nothing."""

    checks: tuple[Check, ...]
    unjudged: tuple[Unjudged, ...] = ()

    @property
    def judged(self) -> bool:
        """Whether there is anything to judge."""
        return bool(self.checks)

    @property
    def passed(self) -> bool:
        """Whether all checks passed."""
        return all(check.passed for check in self.checks)


def exact_check(name: str, size: int, off: int) -> Check:
    """Return a check that one deviation is enough to fail."""
    return Check(name, size, float(off), float(off == 0))


def normal_check(name: str, size: int, z: float, wrong: str, shift: float) -> Check:
    """Return a check of z, which is N(0, 1), or N(shift, 1) with the defect."""
    edge = -float(special.ndtri(LEVEL / 2.0))
    power = float(special.ndtr(shift - edge) + special.ndtr(-shift - edge))
    return Check(name, size, z, 2.0 * float(special.ndtr(-abs(z))), wrong, power)


def count_check(
    name: str, size: int, off: float, moments: Sequence[float], wrong: str, shift: float
) -> Check:
    """Return a check of how many of `size` independent trials came out, the Pearson type III law of three moments.

    The normal law has the wrong tails for few and rare ones: 15 of 116 with a chance of 0.05 each, or more, come 7
    times in 10,000, and 0.4 times by it.

    Args:
        name: what is judged.
        size: of how many.
        off: the count less its mean.
        moments: the sums of p (1 - p) and of p (1 - p) (1 - 2 p): variance and third central moment of the count.
        wrong: a defect.
        shift: of the count, with the defect.
    """
    variance, third = moments
    spread = math.sqrt(variance)
    above = _upper_tail((off - 0.5) / spread, third / spread**3)
    below = _upper_tail((-off - 0.5) / spread, -third / spread**3)
    found = normal_check(name, size, off / spread, wrong, shift / spread)
    return found._replace(chance=min(1.0, 2.0 * min(above, below)))


def _upper_tail(z: float, skew: float) -> float:
    """Return the chance of at least z, of mean 0 and variance 1: a gamma variable, shifted; mirrored if skew < 0."""
    if abs(skew) < NO_SKEW:
        return float(special.ndtr(-z))
    shape = 4.0 / skew**2
    at = max(0.0, shape + (z if skew > 0.0 else -z) * math.sqrt(shape))
    return float(special.gammaincc(shape, at) if skew > 0.0 else special.gammainc(shape, at))


def spread_check(name: str, size: int, variance: float, freedom: float, wrong: str, ratio: float) -> Check:
    """Return a check of a variance that should be 1, on both sides.

    Args:
        name: what is judged.
        size: of how many.
        variance: as found; `freedom` times it follows chi-squared with so many degrees of freedom.
        freedom: need not be whole: of a mean whose variance is 2 / freedom (Satterthwaite, Biometrics 2 (1946)).
        wrong: a defect.
        ratio: of the variance, with the defect.
    """
    square = variance * freedom
    least, most = (float(special.chdtri(freedom, share)) for share in (1.0 - LEVEL / 2.0, LEVEL / 2.0))
    power = float(special.chdtr(freedom, least / ratio) + special.chdtrc(freedom, most / ratio))
    below, above = float(special.chdtr(freedom, square)), float(special.chdtrc(freedom, square))
    return Check(name, size, variance, min(1.0, 2.0 * min(below, above)), wrong, power)
