"""What a run is worth, as the status that a command ends with."""

from __future__ import annotations

from enum import StrEnum
from typing import Any, Final

WELL: Final = 0
DISAGREES: Final = 1
"""The record disagrees with the channel's model, or the run broke off."""
UNUSABLE: Final = 2
"""What was asked for cannot be started or read."""
UNEXPECTED: Final = 3
"""The record agrees with the model, but not with an expectation of the scenario."""
OUTPUT_CLOSED: Final = 141
"""Nobody read what was printed to its end: as a shell has it of a program that SIGPIPE ended."""


class RunOutcome(StrEnum):
    """What a run is worth; `summary.json` has it as ``outcome``."""

    PASS = "pass"
    FAIL = "fail"
    """The record disagrees with the channel's model, or with an expectation of the scenario."""
    NONE = "none"
    """Nothing was drawn that could be judged."""
    INTERRUPTED = "interrupted"
    BROKE_OFF = "broke_off"

    @property
    def word(self) -> str:
        """How lines for people begin."""
        return "no verdict" if self is RunOutcome.NONE else self.value.replace("_", " ")


def status_of(summary: dict[str, Any] | None) -> int:
    """The status of a run that was not interrupted.

    Args:
        summary: content of `summary.json`; None if there is none.
    """
    if summary is None or summary["outcome"] == RunOutcome.BROKE_OFF:
        return DISAGREES
    if summary["outcome"] == RunOutcome.FAIL and not all(check["passed"] for check in summary["checks"]):
        return DISAGREES
    return WELL if all(row["passed"] for row in summary["expectations"]) else UNEXPECTED
