"""Climbing a log-likelihood, and finding where its profile falls below a threshold.

The end of an interval is the farthest point, along one parameter, of the region where the likelihood is above the
threshold: found directly, by moving to where a quadratic model of the likelihood has it (Venzon & Moolgavkar, Applied
Statistics 37 (1988)). Where that does not settle, the profile itself is climbed for trial values within a bracket.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from channel.checks import FloatArray
from channel.fit.likelihood import NATURAL_HIGH, NATURAL_LOW, Likelihood, Parameters, Point

Mask = NDArray[np.bool_]
MAX_CLIMB = 80
MAX_MOVES = 40
MAX_TRIALS = 40
TOLERANCE = 1e-4
"""Of a maximum: the gain that the next step still promises."""
END_TOLERANCE = 0.01
"""Of an interval's end, in log-likelihood."""
FLAT_SHARE = 0.25
"""Of a parameter's range: with a standard error greater than this, a quadratic model leads nowhere."""
NO_INFORMATION = 1e-3
"""Of a parameter, over its range squared: with less it is left where it is."""
DAMPINGS = 10
HIGHER = 0.01
FAR = 5.0
"""Of the deviance's root at the end of an interval: further than that the secant is no guide."""


class HigherError(Exception):
    """The search for the end of an interval came higher than the maximum it started from."""

    def __init__(self, point: Point) -> None:
        super().__init__("not the maximum")
        self.point = point


@dataclass(frozen=True, slots=True)
class Side:
    """One end of one interval.

    Attributes:
        index: of the parameter.
        sign: -1 for the lower end, 1 for the upper.
        target: log-likelihood at the end.
        ceiling: higher than this, and the maximum was none.
        limit: end of the parameter's range on this side.
    """

    index: int
    sign: float
    target: float
    ceiling: float
    limit: float

    def checked(self, point: Point) -> Point:
        """Return the point.

        Raises:
            HigherError: it is above the ceiling.
        """
        if point.value > self.ceiling:
            raise HigherError(point)
        return point


def climb(likelihood: Likelihood, start: Parameters, free: Mask) -> Point:
    """Return the maximum over the free parameters: Fisher scoring within the limits, damped as Levenberg's."""
    here, damping = likelihood.point(likelihood.inside(start)), 1e-10
    for _ in range(MAX_CLIMB):
        moving = _moving(likelihood, here, free)
        if not moving.any():
            return here
        if 0.5 * here.gradient[moving] @ _solve(here, moving, 0.0) < TOLERANCE:
            return here
        for _ in range(DAMPINGS):
            there = _stepped(likelihood, here, moving, _solve(here, moving, damping))
            if there.value > here.value:
                break
            damping = max(damping, 1e-6) * 20.0
        else:
            return here
        if there.value - here.value < 0.01 * TOLERANCE:
            return there
        here, damping = there, damping / 100.0
    return here


def interval_end(
    likelihood: Likelihood, best: Point, free: Mask, side: Side, known: Sequence[Point] = ()
) -> float:
    """Return where the profile falls to the side's target: infinite if nowhere within the limits.

    Args:
        likelihood: what is searched.
        best: its maximum.
        free: what may move.
        side: which end.
        known: other places; the interval has to hold those above the target.

    Raises:
        HigherError: there is a better maximum than `best`.
    """
    inside = [side.checked(point) for point in known if point.value > side.target]
    farthest = max((best, *inside), key=lambda point: side.sign * point.at[side.index])
    found = _direct(likelihood, best, free, side)
    if found is None or side.sign * (farthest.at[side.index] - found) > 0.0:
        found = _by_profile(likelihood, best, farthest, free, side)
    if found is None:
        natural = side.sign < 0.0 and NATURAL_LOW[side.index]
        return side.limit if natural else side.sign * math.inf
    return found


def at_our_limit(likelihood: Likelihood, point: Point, free: Mask) -> bool:
    """Return whether a free parameter stands at an end of its range that is ours, not nature's."""
    low = (point.at <= likelihood.low) & ~NATURAL_LOW
    high = (point.at >= likelihood.high) & ~NATURAL_HIGH
    return bool(np.any(free & (low | high)))


def _moving(likelihood: Likelihood, point: Point, free: Mask) -> Mask:
    """Return the free parameters but those that a limit holds back, and those that change nothing."""
    low = (point.at <= likelihood.low) & (point.gradient <= 0.0)
    high = (point.at >= likelihood.high) & (point.gradient >= 0.0)
    counts = np.diag(point.information) * np.square(likelihood.high - likelihood.low) > NO_INFORMATION
    return free & ~low & ~high & counts


def _damped(point: Point, moving: Mask, damping: float) -> FloatArray:
    matrix = point.information[np.ix_(moving, moving)]
    scale = np.maximum(np.diag(matrix), 1e-9)
    return np.asarray(matrix + np.diag((damping + 1e-12) * scale))


def _solve(point: Point, moving: Mask, damping: float) -> FloatArray:
    return np.asarray(np.linalg.solve(_damped(point, moving, damping), point.gradient[moving]))


def _stepped(likelihood: Likelihood, here: Point, moving: Mask, step: FloatArray) -> Point:
    there = here.at.copy()
    there[moving] += step
    return likelihood.point(likelihood.inside(there))


def _direct(likelihood: Likelihood, best: Point, free: Mask, side: Side) -> float | None:
    """Return the end by steps to where the quadratic model has it; None if they do not settle."""
    here = best
    flat = (FLAT_SHARE * (likelihood.high - likelihood.low)[side.index]) ** 2
    for _ in range(MAX_MOVES):
        moving = _moving(likelihood, here, free)
        moving[side.index] = True
        matrix, gradient = _damped(here, moving, 0.0), here.gradient[moving]
        place = int(np.count_nonzero(moving[: side.index]))
        unit = np.zeros(gradient.size)
        unit[place] = 1.0
        along, newton = np.linalg.solve(matrix, np.stack((unit, gradient), axis=-1)).T
        if not 0.0 < along[place] < flat:
            return None
        gain = 0.5 * max(gradient @ newton - newton[place] ** 2 / along[place], 0.0)
        """What the other parameters, at their best, would still add."""
        if gain < END_TOLERANCE and abs(here.value + gain - side.target) < END_TOLERANCE:
            return None if at_our_limit(likelihood, here, free) else float(here.at[side.index])
        room = 2.0 * (here.value + 0.5 * gradient @ newton - side.target) / along[place]
        step = newton + side.sign * math.sqrt(max(room, 0.0)) * along
        there = _cautious(likelihood, here, moving, step, side)
        if there is None or side.sign * (there.at[side.index] - side.limit) >= 0.0:
            return None
        here = there
    return None


def _cautious(
    likelihood: Likelihood, here: Point, moving: Mask, step: FloatArray, side: Side
) -> Point | None:
    """Return where the step, or a half or quarter ... of it, leads without falling far below the target."""
    floor = min(here.value, side.target) - 2.0
    for _ in range(8):
        there = side.checked(_stepped(likelihood, here, moving, step))
        if there.value > floor:
            return there
        step = 0.5 * step
    return None


def _by_profile(likelihood: Likelihood, best: Point, near: Point, free: Mask, side: Side) -> float | None:
    """Return the end within a bracket of trial values, the other parameters climbed anew at each; None: nowhere.

    The bracket begins at `near`, a place above the target.

    The root of the deviance is nearly linear in the parameter: trials follow the secant.
    """
    others = free.copy()
    others[side.index] = False
    if side.sign * (near.at[side.index] - side.limit) >= 0.0:
        return None
    moving = _moving(likelihood, near, free)
    moving[side.index] = True
    way = _way(likelihood, near, moving, side.index)
    goal = math.sqrt(2.0 * (best.value - side.target))
    inside, outside, outside_root = float(near.at[side.index]), math.nan, math.nan
    inside_root = math.sqrt(max(2.0 * (best.value - near.value), 0.0))
    step = float(way[side.index])
    for _ in range(MAX_TRIALS):
        if math.isnan(outside):
            target = inside + side.sign * step
        else:
            share = (goal - inside_root) / max(outside_root - inside_root, 1e-12)
            # A far outside may be a place from which the climb did not come up: then the middle says more.
            share = min(max(share, 0.05), 0.95) if outside_root < FAR * goal else 0.5
            target = inside + share * (outside - inside)
        hit = side.sign * (target - side.limit) >= 0.0
        target = side.limit if hit else target
        start = likelihood.shifted(near.at, (target - near.at[side.index]) / way[side.index] * way)
        start[side.index] = target
        there = side.checked(climb(likelihood, start, others))
        if (
            there.value <= side.target
        ):  # the way may have led astray: is it the end from where we know it is not?
            start = near.at.copy()
            start[side.index] = target
            there = max(there, side.checked(climb(likelihood, start, others)), key=lambda point: point.value)
        root = math.sqrt(max(2.0 * (best.value - there.value), 0.0))
        if root > goal:
            outside, outside_root = target, root
        elif hit or at_our_limit(likelihood, there, others):
            return None
        else:
            share = (goal - root) / max(root - inside_root, 0.02)
            step = min(max(1.2 * abs(target - inside) * share, 1.2 * step), 4.0 * step)
            inside, inside_root, near = target, root, there
        if abs(root - goal) < END_TOLERANCE or abs(outside - inside) < 1e-9:
            break
    return float(inside if math.isnan(outside) else outside)


def _way(likelihood: Likelihood, best: Point, moving: Mask, index: int) -> FloatArray:
    """Return how all parameters go along with one of them, by the information at the maximum.

    A standard error long, or a fiftieth of its range if that is less. A parameter that changes nothing goes alone.
    """
    place = int(np.count_nonzero(moving[:index]))
    matrix = _damped(best, moving, 0.0)
    unit = np.zeros(len(matrix))
    unit[place] = 1.0
    span = float((likelihood.high - likelihood.low)[index])
    way = np.zeros(best.at.size)
    along = np.linalg.solve(matrix, unit)
    if matrix[place, place] * span**2 < NO_INFORMATION or not along[place] > 0.0:
        way[index] = 0.02 * span
    else:
        way[moving] = along / along[place] * min(math.sqrt(along[place]), 0.02 * span)
    return way
