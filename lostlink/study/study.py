"""A study from its file to its table, going on where an earlier one was ended."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from importlib.util import find_spec
from itertools import permutations
from pathlib import Path
from typing import Any

from bridge.fleet.autopilots.dirs import NOT_SAID, AutopilotDirs
from lostlink.reading.frames import frame_of_table
from lostlink.study.case_process import (
    LOG_FILE,
    CasePlan,
    forget,
    is_done,
    measures_of,
    read_result,
    recorded,
)
from lostlink.study.cases import Case, cases_of
from lostlink.study.earlier import earlier_results
from lostlink.study.lanes import Lanes
from lostlink.study.metrics import link_column, load
from lostlink.study.model import StudyError, read_study, study_from
from lostlink.study.table import TABLE_FILE, table_of, write_table

RUNS_FOLDER = "runs"
NOT_FLOWN = "not flown"
"""Failure in the row of a run that left no result."""


@dataclass(frozen=True, slots=True)
class Standing:
    """How far a study is.

    Attributes:
        done: runs that are over and measured.
        failed: those of them that failed: they are flown again when the study goes on.
        count: all of its runs.
        case: the run that was over just now; None: none.
        failure: why it failed; "" if it did not.
        flown: runs that were flown since the study began or went on; others were only measured again.
        to_fly: runs that are still to be flown.
    """

    done: int
    failed: int
    count: int
    case: Case | None = None
    failure: str = ""
    flown: int = 0
    to_fly: int = 0


class Study:
    """A study and its directory.

    Args:
        study: its file, or the content of such a file; what this names is seen from the working directory.
        out: where directories of studies are kept; this one's has the study's name.
        dirs: where real autopilots are, as far as that was said.

    Attributes:
        cases: all of its runs.
        directory: its own directory.

    Raises:
        StudyError: the study cannot be flown.
    """

    def __init__(self, study: Path | Mapping[str, Any], out: Path, dirs: AutopilotDirs = NOT_SAID) -> None:
        if not isinstance(study, Path | Mapping):
            raise StudyError(
                f"a study has to be its file, or the content of one as a mapping (got {study!r})"
            )
        self.content = study_from(study) if isinstance(study, Mapping) else read_study(study)
        self.cases = cases_of(
            self.content, (Path() if isinstance(study, Mapping) else study.parent).resolve()
        )
        self.directory = (out / self.content.name).resolve()
        self._dirs = AutopilotDirs(*(said.resolve() if said else None for said in (dirs.ardupilot, dirs.px4)))
        if self.content.figures and find_spec("pandas") is None:
            raise StudyError(f"{self.content.name}: figures: needs pandas: pip install 'lostlink[pandas]'")
        for function in (*self.content.metrics, *self.content.figures):
            load(function)

    def to_measure(self) -> set[str]:
        """Ids of those cases that are left and need not be flown: their runs are there, and are measured anew."""
        return self._recorded(self.left())

    def _recorded(self, cases: Iterable[Case]) -> set[str]:
        return {case.id for case in cases if recorded(self.path(case)) is not None}

    def left(self) -> list[Case]:
        """The runs that are still to be flown or measured."""
        measures = measures_of(self.content.metrics)
        return [case for case in self.cases if not is_done(self.path(case), measures, case.labels)]

    def earlier(self) -> dict[str, str]:
        """Why runs are to be flown though there are results with their labels, in words, by id."""
        measured = self.to_measure()
        cases = [case for case in self.left() if case.id not in measured]
        return earlier_results(self.directory / RUNS_FOLDER, cases)

    def path(self, case: Case) -> Path:
        """The directory of a run of the study."""
        return self.directory / RUNS_FOLDER / case.id

    def fly(self, lanes: Lanes) -> Iterator[Standing]:
        """Fly what is left; gives how far it is after each run, and now and then in between.

        Raises:
            OSError: the directory cannot be written.
        """
        measures = measures_of(self.content.metrics)
        left = {self.path(case): case for case in self.left()}
        measured = self._recorded(left.values())
        for path, case in left.items():
            path.mkdir(parents=True, exist_ok=True)
            plan = self._plan(case)
            forget(path, measures, plan.labels)  # what other code said, or of a run that failed
            plan.write(path)
        count = len(self.cases)
        standing = Standing(count - len(left), 0, count, to_fly=len(left) - len(measured))
        yield standing
        for over in lanes.fly(list(left)):
            if over is None:
                yield replace(standing, case=None, failure="")
                continue
            failure, was_flown = self._failure(over), left[over].id not in measured
            standing = Standing(
                standing.done + 1,
                standing.failed + bool(failure),
                count,
                left[over],
                failure,
                standing.flown + was_flown,
                standing.to_fly - was_flown,
            )
            yield standing

    def rows(self) -> list[dict[str, Any]]:
        """A row per run: its labels, its id, why it failed ("" if it did not), and what was measured."""
        rows = []
        for case in self.cases:
            result = read_result(self.path(case))
            known = (
                {"failure": NOT_FLOWN}
                if result is None
                else {"failure": result["failure"], **result["metrics"]}
            )
            rows.append({**case.labels, "id": case.id, **known})
        return rows

    def link_columns(self) -> set[str]:
        """Columns of single links."""
        fleets = {(case.scenario.transceiver_ids, case.scenario.network_names) for case in self.cases}
        return {
            link_column(*link, radio)
            for nodes, radios in fleets
            for link in permutations(nodes, 2)
            for radio in radios
        }

    def write(self, rows: Sequence[Mapping[str, Any]]) -> Path:
        """Write the table, whose rows these are; gives its file.

        Raises:
            StudyError, OSError: it cannot be written.
        """
        table = self.directory / TABLE_FILE
        write_table(rows, table)
        return table

    def draw(self, rows: Sequence[Mapping[str, Any]]) -> Iterator[str]:
        """Have the study's figures drawn of the table, whose rows these are; gives a line for each that cannot be."""
        for function in self.content.figures:
            try:
                load(function)(frame_of_table(table_of(rows)), self.directory)
            except (Exception, SystemExit) as error:
                yield f"{function}: {type(error).__name__}: {error}"

    def _failure(self, path: Path) -> str:
        """Why a run failed, with where the files are that this names; "" if it did not."""
        result = read_result(path)
        if result is None:
            file = path / LOG_FILE
            is_empty = not file.exists() or not file.stat().st_size
            why = "is empty: it was killed, or the disk is full" if is_empty else "may say why"
            return f"its process ended without a result; {file} {why}"
        return f"{result['failure']} (in {path / result.get('run', '')})" if result["failure"] else ""

    def _plan(self, case: Case) -> CasePlan:
        content = self.content
        return CasePlan(
            case.scenario.to_yaml(), content.metrics, content.keep, self._dirs, case.labels, case.made_of
        )
