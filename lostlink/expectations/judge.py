"""Judges the expectations of a scenario by the tables of a run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf
from pathlib import Path

from bridge.record.tables.schema import TableError
from bridge.scenario.expectations import (
    AgeExpectation,
    DeliveryExpectation,
    EndingExpectation,
    Expectation,
    HostLossesExpectation,
    PositionExpectation,
    SeparationExpectation,
)
from bridge.scenario.model import Scenario
from bridge.scenario.own_measures import FunctionExpectation, LoggedExpectation
from lostlink.expectations.measures import MeasureError, measured, share_within
from lostlink.expectations.packets import PacketFinder
from lostlink.expectations.positions import PlaceFinder


@dataclass(frozen=True, slots=True)
class Judgement:
    """What came of an expectation.

    Attributes:
        name: of the expectation.
        type: its kind.
        wanted: its bound in words.
        found: what the record has; None if it has nothing of the kind.
        unit: of ``found``: m, s, packets, or "".
        passed: whether it is as wanted.
        error: why it could not be judged: a table that cannot be read, a function that raised.
    """

    name: str
    type: str
    wanted: str
    found: float | str | None
    unit: str
    passed: bool
    error: str = ""

    def __str__(self) -> str:
        if self.error:
            return f"FAILED: {self.name}: wanted {self.wanted}, cannot be judged: {self.error}"
        found = f"{self.found:.4g}" if isinstance(self.found, float) else self.found
        told = "nothing of the kind" if self.found is None else f"{found} {self.unit}".strip()
        return f"{'ok' if self.passed else 'FAILED'}: {self.name}: wanted {self.wanted}, found {told}"


def judge(
    run: Path,
    scenario: Scenario,
    ending: str,
    expectations: Sequence[Expectation] | None = None,
    *,
    as_far_as_possible: bool = False,
) -> list[Judgement]:
    """Judge the run in directory ``run``.

    Args:
        run: a run directory, also one that was killed.
        scenario: what was flown.
        ending: how it ended, as in summary.json.
        expectations: what to judge; those of the scenario unless given.
        as_far_as_possible: what cannot be judged because a table cannot be read is not met, and says why; so is in
            any case a measure of the user's own that says nothing to judge.

    Raises:
        ValueError, OSError: a table cannot be read, unless ``as_far_as_possible``.
    """
    wanted = scenario.expectations if expectations is None else expectations
    judges = _Judge(run, scenario, PacketFinder(run, scenario, wanted), PlaceFinder(run, scenario), ending)
    return [(judges.if_possible if as_far_as_possible else judges.judgement)(each) for each in wanted]


@dataclass(frozen=True, slots=True)
class _Judge:
    run: Path
    scenario: Scenario
    packets: PacketFinder
    places: PlaceFinder
    ending: str

    def judgement(self, wanted: Expectation) -> Judgement:
        try:
            found, unit, passed = self._found(wanted)
        except MeasureError as error:
            return _unjudged(wanted, error)
        shown = round(found, 6) if isinstance(found, float) else found
        return Judgement(wanted.title, wanted.type, wanted.wanted, shown, unit, passed)

    def if_possible(self, wanted: Expectation) -> Judgement:
        try:
            return self.judgement(wanted)
        except (OSError, ValueError) as error:
            return _unjudged(wanted, error)

    def _found(self, wanted: Expectation) -> tuple[float | str | None, str, bool]:
        match wanted:
            case DeliveryExpectation():
                return self._delivery(wanted)
            case PositionExpectation():
                distance_m = self.places.distance_m(wanted)
                return distance_m, "m", distance_m is not None and distance_m <= wanted.within_m
            case AgeExpectation():
                age_s = self.packets.age_s(wanted, self.places.end_s)
                return age_s, "s", age_s is not None and age_s <= wanted.at_most_s
            case SeparationExpectation():
                return self._separation(wanted)
            case LoggedExpectation():
                share = share_within(self.run, self.scenario, wanted)
                return share, "of the values", share is not None and share >= wanted.for_
            case FunctionExpectation():
                value = measured(self.run, wanted)
                return (
                    (value, "", wanted.holds(value))
                    if wanted.has_bounds
                    else ("yes" if value else "no", "", bool(value))
                )
            case HostLossesExpectation():
                lost = self.packets.lost_by_host()
                return float(lost), "packets", lost <= wanted.at_most
            case EndingExpectation():
                return self.ending or "no end", "", self.ending == wanted.ending
        raise TableError(f"no such expectation: {wanted!r}")  # pragma: no cover

    def _delivery(self, wanted: DeliveryExpectation) -> tuple[float | None, str, bool]:
        """Of several links, the one that is farthest beyond a bound, or nearest to one."""
        shares = self.packets.shares(wanted)
        if not shares:
            return None, "", False
        low = -inf if wanted.at_least is None else wanted.at_least
        high = inf if wanted.at_most is None else wanted.at_most
        worst = max(shares, key=lambda share: max(low - share, share - high))
        return worst, "", low <= worst <= high

    def _separation(self, wanted: SeparationExpectation) -> tuple[float | None, str, bool]:
        """Of the least and the greatest distance, the one that is farther beyond its bound."""
        found = self.places.separation_m(wanted)
        if found is None:
            return None, "m", False
        nearest_m, farthest_m = found
        beyond = []
        if wanted.at_least_m is not None:
            beyond.append((wanted.at_least_m - nearest_m, nearest_m))
        if wanted.at_most_m is not None:
            beyond.append((farthest_m - wanted.at_most_m, farthest_m))
        excess_m, worst_m = max(beyond)
        return worst_m, "m", excess_m <= 0.0


def _unjudged(wanted: Expectation, error: Exception) -> Judgement:
    return Judgement(wanted.title, wanted.type, wanted.wanted, None, "", passed=False, error=str(error))
