"""A study by setting: each number's mean over the seeds, and the mean's standard error."""

from __future__ import annotations

import math
import statistics
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

SEED: Final = "seed"
ALWAYS: Final = ("delivery", "age_mean_s", "separation_min_m")
"""Shown after the study's own numbers and those of expectations."""
ROUNDING: Final = 1e-12
"""Of a value: by so little the same numbers differ."""
LEFT_OUT: Final = frozenset(("sim_duration_s", "sent", "delivered", "age_peak_s"))


@dataclass(frozen=True, slots=True)
class Mean:
    """Of those runs of a setting that did not fail and have the number; of one run alone ``error`` is nan."""

    value: float
    error: float
    count: int

    def __str__(self) -> str:
        if not self.count:
            return ""
        if math.isnan(self.error):
            return f"{self.value:.4g}"
        if self.error <= ROUNDING * abs(self.value):
            return f"{self.value:.4g} ± 0"
        decimals = 1 - int(f"{self.error:.1e}".partition("e")[2])  # two digits of the error
        value, error = (f"{round(each, decimals):.{max(0, decimals)}f}" for each in (self.value, self.error))
        return f"{value} ± {error}"


@dataclass(frozen=True, slots=True)
class BySetting:
    """The runs of one setting.

    Attributes:
        labels: what varies between settings, without the seed.
        runs: how many there are.
        passed: how many of them passed, and were measured.
        failed: how many did not come to their end, or could not be measured.
        means: by column.
    """

    labels: Mapping[str, Any]
    runs: int
    passed: int
    failed: int
    means: Mapping[str, Mean]


def by_setting(
    rows: Sequence[Mapping[str, Any]],
    labels: Sequence[str],
    links: Collection[str] = (),
    whole: Sequence[Mapping[str, Any]] | None = None,
) -> list[BySetting]:
    """The settings of a study, in the order of its table.

    Args:
        rows: the study's table.
        labels: its columns that say which run a row is.
        links: its columns of single links, which are left out: there may be hundreds.
        whole: if ``rows`` are only some of the study's, all of them: what varies between these is shown.
    """
    among = rows if whole is None else whole
    varies = [name for name in labels if name != SEED and len({str(row.get(name)) for row in among}) > 1]
    columns = _columns(rows, LEFT_OUT.union(labels, links))
    groups: dict[tuple[str, ...], list[Mapping[str, Any]]] = {}
    for row in rows:
        groups.setdefault(tuple(str(row.get(name)) for name in varies), []).append(row)
    return [
        BySetting(
            {name: group[0].get(name) for name in varies},
            len(group),
            sum(row.get("passed") is True and not row.get("failure") for row in group),
            sum(bool(row.get("failure")) for row in group),
            {name: mean_of([row.get(name) for row in group if not row.get("failure")]) for name in columns},
        )
        for group in groups.values()
    ]


def _columns(rows: Sequence[Mapping[str, Any]], left_out: Collection[str]) -> list[str]:
    """Those with numbers: of expectations and the study's own, then what every run has."""
    names = dict.fromkeys(name for row in rows for name, value in row.items() if _number(value) is not None)
    own = [name for name in names if name not in left_out and name not in ALWAYS]
    return [*own, *(name for name in ALWAYS if name in names)]


def _number(value: object) -> float | None:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        return None
    return float(value)


def mean_of(values: Sequence[object]) -> Mean:
    """Mean of those that are finite numbers."""
    numbers = [number for value in values if (number := _number(value)) is not None]
    if not numbers:
        return Mean(math.nan, math.nan, 0)
    error = statistics.stdev(numbers) / math.sqrt(len(numbers)) if len(numbers) > 1 else math.nan
    return Mean(statistics.fmean(numbers), error, len(numbers))
