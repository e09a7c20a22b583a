"""Where the nodes of a group are: a line, a column, a grid, a ring, or anywhere in a box."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal, NamedTuple

import numpy as np
from pydantic import Field

from bridge.scenario.parts import Finite, Metres, Part, Positive
from channel.draws import stream_key, uniform_from_words
from channel.numbers.philox import philox_words

TRIES = 1000
"""Places that are drawn for a node before it is said that there is no room for it."""
DECIMALS = 3
"""Places are whole millimetres: sines of another machine give the same."""


class Spot(NamedTuple):
    """A place of a pattern, relative to the pattern's own; with a heading, if the pattern has one."""

    north_m: float
    east_m: float
    heading_deg: float | None = None


@dataclass(frozen=True, slots=True)
class PlaceDraws:
    """Where random places come from.

    Attributes:
        seed: of the run.
        group: what distinguishes the group from others: the id of its first node.
    """

    seed: int
    group: str

    def uniform(self, number: int) -> tuple[float, float]:
        """The pair of that number, each in (0, 1)."""
        key = stream_key(self.seed, "placement", self.group).reshape(2, 1)
        words = philox_words(key, np.array([number], dtype=np.int64))
        first, second = uniform_from_words(words[:2, 0]).tolist()
        return first, second


class LinePattern(Part):
    """Side by side, the first at the place itself."""

    spacing_m: Positive
    bearing_deg: Finite = 90.0

    def spots(self, count: int, _draws: PlaceDraws) -> list[Spot]:
        """The places."""
        return [_polar(self.spacing_m * index, self.bearing_deg) for index in range(count)]


class ColumnPattern(Part):
    """One behind the other, all with one heading; the first at the place itself."""

    spacing_m: Positive
    heading_deg: Finite = 0.0

    def spots(self, count: int, _draws: PlaceDraws) -> list[Spot]:
        """The places."""
        behind = (_polar(-self.spacing_m * index, self.heading_deg) for index in range(count))
        return [spot._replace(heading_deg=self.heading_deg % 360.0) for spot in behind]


class GridPattern(Part):
    """Rows to the east, one north of the other; the first at the south-west corner."""

    spacing_m: Positive
    columns: Annotated[int | None, Field(strict=True, ge=1)] = None

    def spots(self, count: int, _draws: PlaceDraws) -> list[Spot]:
        """The places; as many columns as rows, or one more, unless it says how many."""
        columns = self.columns or math.isqrt(max(count - 1, 0)) + 1
        return [
            Spot(index // columns * self.spacing_m, index % columns * self.spacing_m)
            for index in range(count)
        ]


class RingPattern(Part):
    """Evenly around the place, clockwise."""

    radius_m: Positive
    bearing_deg: Finite = 0.0
    face: Literal["outward", "inward", "along"] | None = None
    turns: ClassVar[dict[str, float]] = {"outward": 0.0, "inward": 180.0, "along": 90.0}

    def spots(self, count: int, _draws: PlaceDraws) -> list[Spot]:
        """The places."""
        return [self._spot(self.bearing_deg + 360.0 * index / count) for index in range(count)]

    def _spot(self, bearing_deg: float) -> Spot:
        heading = (
            None if self.face is None else round((bearing_deg + self.turns[self.face]) % 360.0, DECIMALS)
        )
        return _polar(self.radius_m, bearing_deg)._replace(heading_deg=heading)


class Random(Part):
    """Anywhere in a box, from the run's seed."""

    north_m: tuple[Metres, Metres]
    east_m: tuple[Metres, Metres]
    min_spacing_m: Annotated[float, Field(ge=0, allow_inf_nan=False)] = 0.0

    def spots(self, count: int, draws: PlaceDraws) -> list[Spot]:
        """The places.

        Raises:
            ValueError: there is no room for so many.
        """
        spots: list[Spot] = []
        for number in range(count * TRIES):
            if len(spots) == count:
                break
            spot = self._spot(*draws.uniform(number))
            if all(math.dist(spot[:2], other[:2]) >= self.min_spacing_m for other in spots):
                spots.append(spot)
        if len(spots) < count:
            sides = " x ".join(f"{abs(high - low):g} m" for low, high in (self.north_m, self.east_m))
            raise ValueError(
                f"only {len(spots)} of {count} nodes found room {self.min_spacing_m:g} m apart in {sides}: "
                "make the box larger, or min_spacing_m or count smaller"
            )
        return spots

    def _spot(self, north: float, east: float) -> Spot:
        (south_m, north_m), (west_m, east_m) = self.north_m, self.east_m
        place = (south_m + north * (north_m - south_m), west_m + east * (east_m - west_m))
        return Spot(round(place[0], DECIMALS), round(place[1], DECIMALS))


Pattern = LinePattern | ColumnPattern | GridPattern | RingPattern | Random
PATTERNS: dict[str, type[Pattern]] = {
    "line": LinePattern,
    "column": ColumnPattern,
    "grid": GridPattern,
    "ring": RingPattern,
    "random": Random,
}


def _polar(distance_m: float, bearing_deg: float) -> Spot:
    angle = math.radians(bearing_deg)
    north_m, east_m = distance_m * math.cos(angle), distance_m * math.sin(angle)
    return Spot(round(north_m, DECIMALS) + 0.0, round(east_m, DECIMALS) + 0.0)
