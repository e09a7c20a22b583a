"""How far a run can be flown again: to its end, or to its last whole tick if it was interrupted."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bridge.record.events import KILLED, read_reports
from bridge.record.tables.reader import read_columns
from bridge.record.tables.truth import TRUTH
from bridge.run.directory import RunDirectory

WHOLE = ("done", "duration")
"""Endings of `summary.json` that the run came to by itself."""
IN_ORDER = (*WHOLE, "interrupted")
"""Endings after which every process closed its files, unless one had to be killed."""


@dataclass(frozen=True, slots=True)
class Extent:
    """How much of a run there is.

    Attributes:
        stop_ns: its last whole tick; None if the run came to its end by itself.
        was_cut: a process was, or may have been, killed: files may end at different ticks.
        ending: as its summary has it; None if it has none.
    """

    stop_ns: int | None
    was_cut: bool
    ending: str | None = None

    def other_ending(self, now: str) -> bool:
        """Whether the run, flown again as far as this goes, should not have had the ending ``now``.

        One that is ended at a tick of ours ends well there; that it broke off is the same only if it did before.
        """
        if self.stop_ns is None:
            return now != self.ending
        return now not in WHOLE and now != self.ending


def extent_of(run: Path) -> Extent:
    """How much of the run in ``run`` can be flown again.

    Raises:
        ValueError: it was interrupted before any sim time was whole, or its truth is damaged.
        OSError: its truth cannot be read.
    """
    ending, cut = _ending(run), was_cut(run)
    if ending in WHOLE:
        return Extent(None, cut, ending)
    stop_ns = last_whole_tick(run)
    if stop_ns is None:
        raise ValueError(f"{run}: the run ended before its first whole tick: there is nothing to fly again")
    if stop_ns == 0:
        raise ValueError(
            f"{run}: the run ended in its first ticks, before sim time passed: nothing to fly again"
        )
    return Extent(stop_ns, cut, ending)


def was_cut(run: Path) -> bool:
    """Whether a process of the run was, or may have been, killed: its files may end at different ticks."""
    return _ending(run) not in IN_ORDER or any(event.kind == KILLED for event in read_reports(run).events)


def last_whole_tick(run: Path) -> int | None:
    """Sim time in ns of the last tick but one that has truth: when a tick begins, the one before it is closed.

    Raises:
        ValueError, OSError: the truth is damaged or cannot be read.
    """
    if not TRUTH.is_in(run):
        return None
    ticks_ns = np.unique(read_columns(run, TRUTH, (TRUTH.tick,))[TRUTH.tick])
    return int(ticks_ns[-2]) if len(ticks_ns) > 1 else None


def _ending(run: Path) -> str | None:
    try:
        ending = RunDirectory(run).summary.get("ending")
    except (OSError, ValueError):
        return None
    return ending if isinstance(ending, str) else None
