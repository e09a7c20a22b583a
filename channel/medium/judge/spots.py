"""Places that are far from each other, so that the lasting terms of links there are nearly independent."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from channel.medium.judge.correlation import correlations, lasting_m, shared_ends
from channel.medium.judge.heard import HeardPower, HeardPowers

MAX_SPOTS = 400
"""Of one link; of all together where links share their surroundings."""
NONE = HeardPowers.of([])


class Crowding(NamedTuple):
    """How the powers at a place go together with those at others.

    Attributes:
        level: sum of their correlations.
        spread: sum of the greatest squared correlations of their terms: of scatter beside a direct path, power goes
            with the field itself.
    """

    level: float
    spread: float


class Spots:
    """Places of links, at most `MAX_SPOTS` of each.

    Args:
        apart: how far from each other, in distances over which shadowing or line of sight fall to 1/e.
    """

    def __init__(self, apart: float) -> None:
        self._apart = apart
        self._seen: dict[int, HeardPowers] = {}

    def crowding(self, look: HeardPower) -> Crowding | None:
        """Keep a place, and return how it goes together with those before it; None: it is too near to one.

        The way between two places is that of one end and of the other; where links share their surroundings, it is
        the shortest from any end to any. Where all pairs share one field, places of any pair count, in both directions.
        """
        shared = shared_ends(look.radio) > 0.0
        alike = shared or look.radio.terms_are_of_places
        key = -1 if alike else look.link
        others = self._seen.get(key, NONE)
        if len(others.link) >= MAX_SPOTS:
            return None
        crowding = Crowding(0.0, 0.0)
        if len(others.link):
            if _nearest_m(look, others, shared=shared) < self._apart * lasting_m(look.radio):
                return None
            each = correlations(look, others)
            level = np.max((each.shadowing, each.sight, np.square(each.fading)), axis=0)
            strongest = np.max(np.abs(each), axis=0)
            crowding = Crowding(float(level.sum()), float(np.square(strongest).sum()))
        self._seen[key] = others.followed_by(look)
        return crowding


def _nearest_m(look: HeardPower, others: HeardPowers, *, shared: bool) -> float:
    ways_m = np.linalg.norm(others.ends_ned_m[:, :, np.newaxis] - look.ends_ned_m, axis=-1)
    if shared:
        return float(ways_m.min())
    direct_m, turned_m = ways_m[:, 0, 0] + ways_m[:, 1, 1], ways_m[:, 0, 1] + ways_m[:, 1, 0]
    return float(np.minimum(direct_m, turned_m).min())
