"""Where the two ends of a link are, over time: samples that a medium goes along linearly."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, NamedTuple

from channel.csv_rows import rows_with_headings
from channel.medium.medium import Medium

NS_PER_S: Final = 1_000_000_000
COLUMNS: Final = ("time_s", "distance_m")
TIME_MAX_S: Final = 1e9
DISTANCE_MAX_M: Final = 1e9
"""Farther than any radio of ours reaches; beyond it numbers lose their grain."""


class Sample(NamedTuple):
    """A place at an instant.

    Attributes:
        at_ns: the instant.
        position_ned_m: north, east, down, from a point on the ground.
        attitude_wxyz: body to north-east-down; None: level, the nose north.
    """

    at_ns: int
    position_ned_m: tuple[float, float, float]
    attitude_wxyz: tuple[float, float, float, float] | None = None


@dataclass(frozen=True, slots=True)
class Track:
    """Samples of one end, their instants rising. Before the first it stands there, after the last at that."""

    samples: Sequence[Sample]


class Guide:
    """Tells a medium where its nodes are, as far as it needs to know.

    Args:
        medium: whose nodes they are.
        tracks: of each node, in the order of the medium's.
    """

    def __init__(self, medium: Medium, tracks: Sequence[Track]) -> None:
        self._medium = medium
        self._left: list[tuple[str, Sequence[Sample], int]] = []
        for node, track in zip(medium.nodes, tracks, strict=True):
            if len(track.samples) == 1:
                only = track.samples[0]
                medium.place(node, only.position_ned_m, only.attitude_wxyz)
            else:
                self._left.append((node, track.samples, 0))

    def lead(self, until_ns: int) -> None:
        """Tell all samples up to the first at or after an instant."""
        for place, (node, samples, next_) in enumerate(self._left):
            while next_ < len(samples) and (next_ == 0 or samples[next_ - 1].at_ns < until_ns):
                sample = samples[next_]
                self._medium.observe(node, sample.at_ns, sample.position_ned_m, sample.attitude_wxyz)
                next_ += 1
            self._left[place] = (node, samples, next_)


def apart_over_time(
    distances: Sequence[tuple[float, float]], heights_m: tuple[float, float]
) -> tuple[Track, Track]:
    """The first end stands, the second goes away north and comes back: (time s, distance m over the ground).

    Raises:
        ValueError: no rows, or one that cannot be; the text has its number, from 0 on.
    """
    if not distances:
        raise ValueError("distances: no row")
    before_s: float | None = None
    for number, (time_s, distance_m) in enumerate(distances):
        if mistake := _mistake(time_s, distance_m, before_s):
            raise ValueError(f"distances.{number}: {mistake}")
        before_s = time_s
    ground = Track([Sample(0, (0.0, 0.0, -heights_m[0]))])
    air = [
        Sample(round(time_s * NS_PER_S), (distance_m, 0.0, -heights_m[1])) for time_s, distance_m in distances
    ]
    return ground, Track(air)


def _mistake(time_s: float, distance_m: float, before_s: float | None) -> str:
    """Why a row cannot follow one of an earlier time; empty if it can."""
    if not (0.0 <= time_s <= TIME_MAX_S and 0.0 <= distance_m <= DISTANCE_MAX_M):
        return f"{time_s:g} s, {distance_m:g} m: from 0 to {TIME_MAX_S:g} s and {DISTANCE_MAX_M:g} m"
    if before_s is not None and time_s <= before_s:
        return f"{time_s:g} s does not come after {before_s:g} s"
    return ""


def read_distances(file: Path) -> list[tuple[float, float]]:
    """The rows of a CSV file with the columns ``time_s`` and ``distance_m``.

    Raises:
        ValueError: it is no such file; the text names file and line.
        OSError: it cannot be read.
    """
    try:
        text = file.read_bytes().decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise ValueError(f"{file}: no text in UTF-8 ({error})") from error
    try:
        rows = _distances(file, text)
    except csv.Error as error:
        raise ValueError(f"{file}: not a CSV of numbers: {error}") from error
    if not rows:
        raise ValueError(f"{file}: no row below the first line")
    return rows


def _distances(file: Path, text: str) -> list[tuple[float, float]]:
    headings, read = rows_with_headings(io.StringIO(text, newline=""), COLUMNS)
    if not set(COLUMNS) <= set(headings):
        raise ValueError(f"{file}:1: the first line has to name the columns {', '.join(COLUMNS)}")
    rows: list[tuple[float, float]] = []
    for number, row in read:
        place = f"{file}:{number}"
        try:
            time_s, distance_m = (float(row[name] or "") for name in COLUMNS)
        except ValueError:
            raise ValueError(f"{place}: {', '.join(COLUMNS)} have to be numbers") from None
        if mistake := _mistake(time_s, distance_m, rows[-1][0] if rows else None):
            raise ValueError(f"{place}: {mistake}")
        rows.append((time_s, distance_m))
    return rows
