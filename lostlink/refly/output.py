"""What `lostlink refly` says of a run that was flown again, as text and as JSON."""

from __future__ import annotations

from typing import Any

from lostlink.compare import output
from lostlink.refly.reflight import Reflight, ReflightPlan


def as_text(planned: ReflightPlan, outcome: Reflight) -> str:
    """One line if nothing is other, else the first difference, and how the endings differ."""
    compared = output.as_text(outcome.comparison, planned.run, outcome.directory.path)
    until = "" if outcome.comparison.difference is not None else planned.extent_told
    return f"{compared}{until}" + (f"\n{outcome.other_ending}" if outcome.other_ending else "")


def as_plain(planned: ReflightPlan, outcome: Reflight) -> dict[str, Any]:
    """In plain types, for --json."""
    return output.as_plain(outcome.comparison) | {
        "run": str(planned.run),
        "reflown": str(outcome.directory.path),
        "other_ending": outcome.other_ending or None,
        "compared_until_ns": planned.extent.stop_ns,
        "remarks": [*planned.remarks, *outcome.remarks],
        "summary": outcome.summary,
    }
