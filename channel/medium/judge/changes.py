"""Powers that follow each other on a link, as where in its law their difference lies: correlation in place and time.

How the terms of two packets are correlated is known from their places and times (`correlation`). So the difference of
two powers is compared with `DRAWS` others that are drawn from their joint law: its rank among them, ties broken at
random, is uniform whatever the law (Besag & Clifford, Biometrika 76 (1989)). As a normal score v, its mean square is 1;
it is less where powers go together more than they should, and more where they go together less. The level, which is
common to both, is not judged here. How far the mean of the squares may be from 1 is known from the same correlations:
changes of one link go together (`_together`), and all links of a run have the waves of one field (`_of_place_waves`).

Two questions are asked so: over a decorrelation distance of shadowing (or line of sight), and from packet to packet.
The power of each is found by draws with other correlations: see `Question`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from channel.checks import FloatArray
from channel.draws import Draws
from channel.fading import place_field, scatter
from channel.fading.blocks import CLARKE
from channel.fading.waves import PLACE_STEPS_PER_M, TABLE_BITS, TIME_STEP_S
from channel.link.radio import Radio
from channel.medium.judge.check import Check, Unjudged, spread_check
from channel.medium.judge.correlation import (
    Correlations,
    correlations,
    lasting_m,
    of_changes,
    shadowing_lasts,
)
from channel.medium.judge.heard import HeardPower, HeardPowers
from channel.medium.judge.spots import Spots
from channel.medium.judge.two_powers import ROWS, change_in_steps, changes_in_steps
from channel.numbers import special
from channel.numbers.units import SPEED_OF_LIGHT_MPS

DRAWS = 127
"""For each pair; the size of the test holds with any number."""
LEAST_PAIRS = 8
MAX_TOLERATED = 1000
"""Pairs from which the tolerance for the sum of waves is found."""
MAX_OF_LINK = 200
"""Pairs of a link from which is found how much they go together."""
FACTOR = 4.0
MOST_OVER = 2.0
"""A pair that is over this many times the way wanted is not taken."""
APART_NS = 2_000_000_000
COHERENCES_APART = 3.0
FINEST = 0.02
"""Of a decorrelation distance: over shorter ways a sum of few waves is smoother than the law that it stands for."""
MOST_MOVED = 0.25
"""By which the mean square of such a pair may depend on whether shadowing changes at all; else it is not taken."""
RESOLVED = 8.0
"""Steps of the channel's fading by which it changes within a pair, rms, so that rounding adds a part in 384 at most."""
UNCHANGED = 1e-12
"""Mean square change of the scattered field of which the steps show none."""
STEP_NS = 250_000_000
"""At which pairs are looked at until they are over their way."""
NEVER_NS = 1 << 62
SIDES: tuple[Literal["left", "right"], ...] = ("left", "right")


@dataclass(frozen=True, slots=True)
class PowerChange:
    """Two powers as judged.

    Attributes:
        normal: v.
        ratio: mean of its square with the defect.
        slope: of its mean square, by the correlation of shadowing, or else of the line of sight.
        way: of both ends, in decorrelation distances, shape (2, 3).
        radio: of the link.
        link: its number.
        sim_time_ns: of the two packets, shape (2,).
        ends_ned_m: of both ends then, shape (2, 2, 3).
    """

    normal: float
    ratio: float
    slope: float
    way: FloatArray
    radio: Radio
    link: int
    sim_time_ns: NDArray[np.int64]
    ends_ned_m: FloatArray


@dataclass(frozen=True)
class Question:
    """Which powers are compared, and what a defect would be.

    Attributes:
        name: of the check.
        wrong: the defect.
        apart: of pairs, in decorrelation distances.
        over: of the packets of a pair, likewise; 0: they follow each other.
        applies: whether a radio's law says anything of it.
        defect: the correlations with the defect.
        tolerance: variance of the mean square that the channel's sums of waves add.
    """

    name: str
    wrong: str
    apart: float
    over: float
    applies: Callable[[Radio], bool]
    defect: Callable[[Radio, Correlations], Correlations]
    tolerance: Callable[[list[PowerChange]], float]


class Changes:
    """Collects pairs of powers for one question.

    Args:
        question: what is asked.
        draws: whose seed the draws come from.
    """

    def __init__(self, question: Question, draws: Draws) -> None:
        self._question = question
        self._draws = draws
        self._spots = Spots(question.apart)
        self._first: dict[int, HeardPower] = {}
        self._pairs: list[PowerChange] = []
        self._asked = False

    def take(self, look: HeardPower) -> int:
        """Take a power; returns how long its link is left alone, ns."""
        question = self._question
        if not question.applies(look.radio):
            return NEVER_NS
        self._asked = True
        first = self._first.get(look.link)
        if first is None:
            if question.apart and self._spots.crowding(look) is None:
                return apart_ns(look.radio)
            self._first[look.link] = look
            return STEP_NS if question.over else 0
        spacing_m = lasting_m(look.radio)
        over_m = float(np.linalg.norm(look.ends_ned_m - first.ends_ned_m, axis=-1).sum())
        if over_m < question.over * spacing_m:
            return STEP_NS
        law = correlations(first, HeardPowers.of([look]))
        if not _is_resolved(first.radio, law):
            return look.sim_time_ns - first.sim_time_ns
        del self._first[look.link]
        if not question.over or over_m < MOST_OVER * question.over * spacing_m:
            pair = self._pair(first, look, law, is_fine=0.0 < over_m < FINEST * spacing_m)
            self._pairs += [pair] if pair else []
        return apart_ns(look.radio)

    def _pair(
        self, first: HeardPower, second: HeardPower, law: Correlations, is_fine: bool
    ) -> PowerChange | None:
        """Return the pair as judged; None if it turns on steps that the channel's fields over place do not resolve."""
        defect = self._question.defect(first.radio, law)
        uniform = first.uniforms(self._draws, self._question.name, (2 * ROWS + 1) * DRAWS + 1)
        rows = uniform[:-1].reshape(-1, DRAWS)
        right = np.sort(changes_in_steps(first, second, law, rows[:ROWS]))

        def mean_square(other: Correlations) -> float:
            drawn = changes_in_steps(first, second, other, rows[ROWS : 2 * ROWS])
            return float(np.square(_scores(drawn, right, rows[-1])).mean())

        way = (second.ends_ned_m - first.ends_ned_m) / (lasting_m(first.radio) or 1.0)
        slope, ratio = 0.0, mean_square(defect)
        if way.any() and lasting_m(first.radio):
            other = defect if self._question.over else _standing(law)
            changed = (ratio if other is defect else mean_square(other)) - mean_square(law)
            if is_fine and abs(changed) > MOST_MOVED:
                return None
            more = _lasting(first.radio, other) - _lasting(first.radio, law)
            slope = _within(changed, changed / more, way) if more else 0.0
        normal = _scores(np.array([change_in_steps(first, second)]), right, uniform[-1:])
        both = HeardPowers.of([first, second])
        return PowerChange(
            float(normal[0]), ratio, slope, way, first.radio, first.link, both.sim_time_ns, both.ends_ned_m
        )

    def checks(self) -> Iterator[Check | Unjudged]:
        """Yield what there is to say; nothing if no law says anything of the question."""
        question, count = self._question, len(self._pairs)
        if count >= LEAST_PAIRS:
            square = float(np.mean([pair.normal**2 for pair in self._pairs]))
            freedom = 2.0 / (2.0 * _together(self._pairs) + question.tolerance(self._pairs))
            ratio = float(np.mean([pair.ratio for pair in self._pairs]))
            yield spread_check(question.name, count, square, freedom, question.wrong, ratio)
        elif self._asked:
            yield Unjudged(question.name, f"{count} of {LEAST_PAIRS} pairs of packets")


def _scores(found: NDArray[np.int64], drawn: NDArray[np.int64], v: FloatArray) -> FloatArray:
    """Return normal scores of ranks among numbers in rising order, ties broken by v, uniform over (0, 1)."""
    low, high = (np.searchsorted(drawn, found, side=side) for side in SIDES)
    return np.asarray(special.ndtri((low + v * (high - low + 1)) / (drawn.size + 1)))


def _is_resolved(radio: Radio, law: Correlations) -> bool:
    """Return whether scattered fields change not at all, or by more than the channel's steps of place, time and phase.

    By less they change by rounding: within half a millisecond of a hover powers change twice as much as by the law.
    """
    fading = radio.config.fading
    if not fading.is_random or fading.coherence != "doppler":
        return True
    steps = (
        2.0**-TABLE_BITS,
        radio.config.frequency_hz / SPEED_OF_LIGHT_MPS / PLACE_STEPS_PER_M,
        CLARKE / fading.max_coherence_s * TIME_STEP_S,
    )
    coarse = (2.0 * math.pi * RESOLVED) ** 2 * sum(step * step for step in steps)
    changed = 2.0 * (1.0 - float(law.fading[0]))
    return changed < UNCHANGED or changed >= min(coarse, 1.0)


def _lasting(radio: Radio, law: Correlations) -> float:
    """Return the correlation of what lasts over place (`lasting_m`)."""
    return float((law.shadowing if shadowing_lasts(radio) else law.sight)[0])


def _together(pairs: list[PowerChange]) -> float:
    """Return the mean squared correlation of any two pairs, one and the same included: 1 / n if all are independent.

    Half the variance of the mean of squares of normal variables. Of pairs of one link scattered fields go together
    for long: those of ends that stand swing at almost one frequency.
    """
    links: dict[int, list[PowerChange]] = {}
    for pair in pairs:
        links.setdefault(pair.link, []).append(pair)
    total = 0.0
    for each in links.values():
        some = each[:: -(-len(each) // MAX_OF_LINK)]
        when_ns, ends_ned_m = (
            np.array([getattr(pair, n) for pair in some]) for n in ("sim_time_ns", "ends_ned_m")
        )
        squares = np.square(of_changes(some[0].radio.config, when_ns, ends_ned_m))
        apart = float(squares.sum() - np.trace(squares))
        total += len(each) + apart * (len(each) / len(some)) ** 2
    return total / len(pairs) ** 2


def _standing(law: Correlations) -> Correlations:
    """Return the correlations if shadowing and line of sight stayed as they are."""
    return law._replace(shadowing=np.ones(1), sight=np.ones(1))


def apart_ns(radio: Radio) -> int:
    """Return after which time fading has changed, ns."""
    fading = radio.config.fading
    lasts = fading.is_random and fading.coherence != "packet"
    return max(APART_NS, round(COHERENCES_APART * fading.max_coherence_s * 1e9) if lasts else 0)


def _too_long(_radio: Radio, law: Correlations) -> Correlations:
    """Return the correlations of a decorrelation distance that is too long."""
    return law._replace(shadowing=law.shadowing ** (1.0 / FACTOR), sight=law.sight ** (1.0 / FACTOR))


def _of_place_waves(pairs: list[PowerChange]) -> float:
    """Return the variance of the mean square over runs: each has its own waves, by which all its pairs go.

    The correlation over a way u is the mean of cos(k u) over the waves k of a run, E cos(k u) = phi(u) that of the
    law. So the correlations over two ways vary together by [(phi(u - w) + phi(u + w)) / 2 - phi(u) phi(w)] / waves.
    """
    some = pairs[:: -(-len(pairs) // MAX_TOLERATED)]
    slope, way = np.array([pair.slope for pair in some]), np.array([pair.way for pair in some])
    both = 0.5 * sum(_phi(way[:, np.newaxis] + sign * way) for sign in (-1.0, 1.0))
    varies = (both - np.outer(_phi(way), _phi(way))) / place_field.WAVES
    return float(slope @ varies @ slope) / len(some) ** 2


def _within(changed: float, slope: float, way: FloatArray) -> float:
    """Return a slope by which the waves of a run move a mean square no more than having no shadowing change does.

    Over tiny ways most runs have no wave that is short enough to change anything, and few have much of it.
    """
    spread = math.sqrt(-math.expm1(-2.0 * float(_length(way))) / (2.0 * place_field.WAVES))
    return math.copysign(min(abs(slope), abs(changed) / spread), slope)


def _phi(way: FloatArray) -> FloatArray:
    return np.asarray(np.exp(-_length(way)))


def _length(way: FloatArray) -> FloatArray:
    """Return that of both ends' ways together, shape (..., 2, 3) -> (...)."""
    return np.asarray(np.linalg.norm(way, axis=-1).sum(axis=-1))


def _swapped(radio: Radio, law: Correlations) -> Correlations:
    """Return correlations of a term that is drawn for each packet where it should last, or lasts where it should not.

    The term is the fading, or else the shadowing, or else the line of sight.
    """
    config = radio.config
    if config.fading.is_random:
        lasts = config.fading.coherence != "packet"
        return law._replace(fading=np.zeros(1) if lasts else np.ones(1))
    if config.shadowing.is_random:
        lasts = config.shadowing.decorrelation_m is not None
        return law._replace(shadowing=np.zeros(1) if lasts else np.ones(1))
    return law._replace(sight=np.zeros(1))


def _is_random(radio: Radio) -> bool:
    config = radio.config
    return config.fading.is_random or config.shadowing.is_random or radio.sight is not None


OVER_PLACE = Question(
    "powers over place",
    f"a decorrelation distance {FACTOR:g} times too long",
    apart=2.0,
    over=1.0,
    applies=lambda radio: lasting_m(radio) > 0.0,
    defect=_too_long,
    tolerance=_of_place_waves,
)
FROM_PACKET_TO_PACKET = Question(
    "powers from packet to packet",
    "terms redrawn that should last, or the reverse",
    apart=0.0,
    over=0.0,
    applies=_is_random,
    defect=_swapped,
    tolerance=lambda pairs: 1.0 / scatter.WAVES**2 + _of_place_waves(pairs),
)
