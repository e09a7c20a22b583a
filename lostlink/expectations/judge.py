"""Judges the expectations of a scenario by the tables of a run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
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
from lostlink.expectations.packets import PacketFinder
from lostlink.expectations.places import PlaceFinder


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
        error: why it could not be judged, if a table could not be read.
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
        as_far_as_possible: what needs a table that cannot be read is not met, and says why.

    Raises:
        TableError, OSError: a table cannot be read, unless ``as_far_as_possible``.
    """
    wanted = scenario.expectations if expectations is None else expectations
    judges = _Judge(PacketFinder(run, scenario), PlaceFinder(run, scenario), ending)
    return [(judges.if_possible if as_far_as_possible else judges.judgement)(each) for each in wanted]


@dataclass(frozen=True, slots=True)
class _Judge:
    packets: PacketFinder
    places: PlaceFinder
    ending: str

    def judgement(self, wanted: Expectation) -> Judgement:
        found, unit, passed = self._found(wanted)
        shown = round(found, 6) if isinstance(found, float) else found
        return Judgement(wanted.title, wanted.type, wanted.wanted, shown, unit, passed)

    def if_possible(self, wanted: Expectation) -> Judgement:
        try:
            return self.judgement(wanted)
        except (OSError, TableError) as error:
            return Judgement(
                wanted.title, wanted.type, wanted.wanted, None, "", passed=False, error=str(error)
            )

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
                nearest_m = self.places.nearest_m(wanted)
                return nearest_m, "m", nearest_m is not None and nearest_m >= wanted.at_least_m
            case HostLossesExpectation():
                lost = self.packets.lost_by_host()
                return float(lost), "packets", lost <= wanted.at_most
            case EndingExpectation():
                return self.ending, "", self.ending == wanted.ending
        raise TableError(f"no such expectation: {wanted!r}")  # pragma: no cover

    def _delivery(self, wanted: DeliveryExpectation) -> tuple[float | None, str, bool]:
        """Of several links, the one that is farthest beyond a bound, if one is."""
        shares = self.packets.shares(wanted)
        if not shares:
            return None, "", False
        low, high = wanted.at_least or 0.0, 1.0 if wanted.at_most is None else wanted.at_most
        worst = max(shares, key=lambda share: max(low - share, share - high))
        return worst, "", low <= worst <= high
