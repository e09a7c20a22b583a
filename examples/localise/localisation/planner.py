"""Where to measure next: the way, of some, after which the emitters' places are expected to be known best.

Each candidate is two straight legs over the horizon, flown at constant speed. Of what would be measured along it,
given what was measured nearby already and what the companions said they would, the expected Fisher information of
each emitter's north, east and power follows in closed form, at places that stand for its posterior. The best has the
least mean trace of the bound on north and east.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from localisation.estimator import Estimate
from localisation.model import Floats, MeanPower, Spread, slopes

REMEMBERED = 24
"""Own readings that a candidate's would be correlated with: the nearest to where the UA is."""


@dataclass(frozen=True, slots=True)
class Fence:
    """Where a UA may fly: a rectangle, m.

    Attributes:
        north_m: least and most.
        east_m: likewise.
    """

    north_m: tuple[float, float]
    east_m: tuple[float, float]

    def beyond_m(self, places_m: Floats) -> Floats:
        """How far places (..., 2) are outside; 0 inside."""
        low = np.array([self.north_m[0], self.east_m[0]])
        high = np.array([self.north_m[1], self.east_m[1]])
        return np.sqrt(np.sum(np.maximum(np.maximum(low - places_m, places_m - high), 0.0) ** 2, axis=-1))


@dataclass(frozen=True, slots=True)
class PlannerSettings:
    """How to plan.

    Attributes:
        fence: where to fly.
        speed_mps: over ground.
        altitude_m: above the fleet's origin.
        horizon_s: the paper's T: how far ahead.
        spacing_m: between readings along a way.
        separation_m: least horizontal distance from where companions will be.
        headings: of first legs, evenly around.
        turns_deg: of the second leg against the first.
        most_turn_deg: of the first leg against the present course: 180 for copters, less for fixed wing.
        height_m: of emitters.
    """

    fence: Fence
    speed_mps: float
    altitude_m: float
    horizon_s: float = 20.0
    spacing_m: float = 12.5
    separation_m: float = 40.0
    headings: int = 16
    turns_deg: tuple[float, ...] = (-80.0, -40.0, 0.0, 40.0, 80.0)
    most_turn_deg: float = 180.0
    height_m: float = 2.0


class Way(NamedTuple):
    """Positions at instants, from now: s, shape (K,); north and east, m, shape (K, 2)."""

    after_s: Floats
    places_m: Floats

    def at(self, after_s: Floats) -> Floats:
        """Where it is at instants, straight between its points; at its ends before and after."""
        return np.stack([np.interp(after_s, self.after_s, axis) for axis in self.places_m.T], axis=-1)


class Situation(NamedTuple):
    """What a plan is made from.

    Attributes:
        place_m: own north and east, shape (2,).
        course_rad: own, from north over east.
        estimates: of emitters.
        own_ned_m: where readings were taken, shape (n, 3); the same place may come more than once.
        companions: their announced ways, from now.
        companion_down_m: heights of the companions' ways.
    """

    place_m: Floats
    course_rad: float
    estimates: Sequence[Estimate]
    own_ned_m: Floats
    companions: Sequence[Way] = ()
    companion_down_m: Sequence[float] = ()


class Planner:
    """Plans one UA's way.

    Args:
        settings: how.
        mean_power: the law of readings.
        spread: of readings about it.
    """

    def __init__(self, settings: PlannerSettings, mean_power: MeanPower, spread: Spread) -> None:
        self.settings, self._mean_power, self._spread = settings, mean_power, spread
        count = max(2, round(settings.horizon_s * settings.speed_mps / settings.spacing_m))
        self._after_s = settings.horizon_s * np.arange(1, count + 1) / count

    def plan(self, now: Situation) -> Way:
        """The best way from here: its start, its corner and its end."""
        corners = self._candidates(now)
        half_s = self.settings.horizon_s / 2.0
        knots_s = np.array([0.0, half_s, 2.0 * half_s])
        share = np.clip(self._after_s / half_s, 0.0, 2.0)[:, np.newaxis]
        first, second = np.minimum(share, 1.0), np.maximum(share - 1.0, 0.0)
        legs = np.diff(corners, axis=1)[:, :, np.newaxis, :]
        places = now.place_m + first * legs[:, 0] + second * legs[:, 1]
        cost = self._expected_m2(now, places) + 1e6 * self._trespass_m(now, places)
        best = int(np.argmin(cost))
        return Way(knots_s, corners[best])

    def _candidates(self, now: Situation) -> Floats:
        """Start, corner and end of each, shape (B, 3, 2)."""
        s = self.settings
        leg_m = 0.5 * s.horizon_s * s.speed_mps
        headings = now.course_rad + 2.0 * np.pi * np.arange(s.headings) / s.headings
        turned = np.abs((headings - now.course_rad + np.pi) % (2.0 * np.pi) - np.pi)
        headings = headings[turned <= np.radians(s.most_turn_deg) + 1e-9]
        second = headings[:, np.newaxis] + np.radians(s.turns_deg)
        first = np.broadcast_to(headings[:, np.newaxis], second.shape)
        start = np.broadcast_to(now.place_m, (first.size, 2))
        corner = start + leg_m * _unit(first.ravel())
        return np.stack([start, corner, corner + leg_m * _unit(second.ravel())], axis=1)

    def _trespass_m(self, now: Situation, places_m: Floats) -> Floats:
        """How far candidates go beyond the fence, and into the distance that is to be kept, shape (B,)."""
        total = np.sum(self.settings.fence.beyond_m(places_m), axis=-1)
        for way in now.companions:
            away = np.sqrt(np.sum((places_m - way.at(self._after_s)) ** 2, axis=-1))
            total = total + np.sum(np.maximum(self.settings.separation_m - away, 0.0), axis=-1)
        return total

    def _expected_m2(self, now: Situation, places_m: Floats) -> Floats:
        """Mean trace of the bound on all emitters, shape (B,)."""
        down = np.full((*places_m.shape[:-1], 1), -self.settings.altitude_m)
        ned = np.concatenate([places_m, down], axis=-1)
        past = self._nearest(now)
        together = np.concatenate([np.broadcast_to(past, (len(ned), *past.shape)), ned], axis=1)
        joint, before = self._spread.covariance(together), self._spread.covariance(past)
        total = np.zeros(len(ned))
        for estimate in now.estimates:
            points = np.concatenate(
                [estimate.points_m, np.full((len(estimate.points_m), 1), -self.settings.height_m)], axis=-1
            )
            known = estimate.information + sum(
                (
                    self._told(way, down_m, points)
                    for way, down_m in zip(now.companions, now.companion_down_m, strict=True)
                ),
                np.zeros((len(points), 3, 3)),
            )
            gained = _information(self._rates(points, together), joint) - _information(
                self._rates(points, past), before
            )
            bound = np.linalg.inv(gained + known)
            total += np.mean(bound[..., 0, 0] + bound[..., 1, 1], axis=-1)
        return total

    def _told(self, way: Way, down_m: float, points_ned_m: Floats) -> Floats:
        """Information of what a companion is going to measure, shape (P, 3, 3)."""
        ahead = self._after_s[self._after_s <= way.after_s[-1]]
        if not len(ahead):
            return np.zeros((len(points_ned_m), 3, 3))
        places = np.concatenate([way.at(ahead), np.full((len(ahead), 1), down_m)], axis=-1)
        return _information(self._rates(points_ned_m, places), self._spread.covariance(places))

    def _nearest(self, now: Situation) -> Floats:
        away = np.sqrt(np.sum((now.own_ned_m[:, :2] - now.place_m) ** 2, axis=-1))
        thinned = _thinned(now.own_ned_m[np.argsort(away, kind="stable")], 0.5 * self.settings.spacing_m)
        return thinned[:REMEMBERED]

    def _rates(self, points_ned_m: Floats, places_ned_m: Floats) -> Floats:
        """Change of readings with north, east and power, shape (..., P, n, 3)."""
        at = points_ned_m[:, np.newaxis, :]
        rates = slopes(self._mean_power, at, places_ned_m[..., np.newaxis, :, :])
        return np.concatenate([rates, np.ones((*rates.shape[:-1], 1))], axis=-1)


def way_of(now_ns: int, points: Sequence[tuple[int, float, float]]) -> Way | None:
    """An announced plan as seen from now; None if it is over."""
    if not points or points[-1][0] <= now_ns:
        return None
    table = np.array([((ns - now_ns) / 1e9, north, east) for ns, north, east in points])
    return Way(table[:, 0], table[:, 1:])


def _information(rates: Floats, covariance: Floats) -> Floats:
    """Fisher information of readings, shape (..., P, 3, 3), from (..., P, n, 3) and (..., n, n)."""
    return np.swapaxes(rates, -1, -2) @ (np.linalg.inv(covariance)[..., np.newaxis, :, :] @ rates)


def _unit(heading_rad: Floats) -> Floats:
    return np.stack([np.cos(heading_rad), np.sin(heading_rad)], axis=-1)


def _thinned(places_ned_m: Floats, least_m: float) -> Floats:
    """Places in their order without those that are close to one before."""
    kept: list[Floats] = []
    for place in places_ned_m:
        if all(np.sum((place - other) ** 2) >= least_m**2 for other in kept):
            kept.append(place)
        if len(kept) == REMEMBERED:
            break
    return np.array(kept).reshape(-1, 3)
