"""Results of the same runs of before a file, a package or lostlink was changed: why these are to be flown again."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from functools import cache
from pathlib import Path

from bridge.record.provenance import read_provenance
from lostlink.study.case_process import RESULT_FILE, CasePlan, read_result, recorded
from lostlink.study.cases import Case
from lostlink.study.made_of import MadeOf


def earlier_results(folder: Path, cases: Sequence[Case]) -> dict[str, str]:
    """In what runs are other than when there was a result with their labels, in words, by id.

    Args:
        folder: the directories of all runs that the study had.
        cases: those that are to be flown.
    """
    same, ids = {tuple(case.labels.items()): case for case in cases}, {case.id for case in cases}

    @cache
    def by_scenario() -> dict[str, Case]:
        return {case.scenario.to_yaml(): case for case in cases}

    found = {}
    for directory, plan in _flown_before(folder) if cases else ():
        case = same.get(tuple(plan.labels.items())) if plan.labels else by_scenario().get(plan.scenario)
        if case is not None and directory.name not in ids:
            found[case.id] = case.made_of.changes_since(_made_of(directory, plan))
    return found


def _flown_before(folder: Path) -> Iterator[tuple[Path, CasePlan]]:
    """Directories with a result of a run that did not fail, the newest last."""
    results = sorted(folder.glob(f"*/{RESULT_FILE}"), key=lambda file: file.stat().st_mtime_ns)
    for directory in (file.parent for file in results):
        with suppress(OSError, ValueError, LookupError, TypeError, AttributeError):  # of another lostlink
            if not (read_result(directory) or {"failure": "none"})["failure"]:
                yield directory, CasePlan.read(directory)


def _made_of(directory: Path, plan: CasePlan) -> MadeOf:
    """As planned; of before plans had it, as its record says, if that stayed."""
    if plan.made_of is not None:
        return plan.made_of
    run = recorded(directory)
    made = None if run is None else read_provenance(run)
    return MadeOf() if made is None else MadeOf("", made.made_by, made.files, made.packages)
