"""One run of a study, in a process of its own: ``python -m lostlink.study.case_process``.

That process reads directories of cases, a line each, and flies each in a process that is forked from it: what is
imported is imported once, and nothing that a case leaves behind, such as an agent's module-level state, is there for
the next. It answers each line with one: the directory again.

A case's directory has `plan.json` (`CasePlan`). What came of it goes to `result.json`, written as a whole when the run
is over and measured, so that whoever finds one need not fly again, or with what ended its process. Paths in there are
as seen from the directory of the run (`run`), or of the case if there is none. An interrupted run leaves none. A run
of other files, or of another lostlink, than its id says (the study was read before they were changed) is no result.
"""

from __future__ import annotations

import fcntl
import gc
import hashlib
import json
import os
import shutil
import signal
import sys
import traceback
from collections.abc import Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from bridge.fleet.autopilots.dirs import NOT_SAID, AutopilotDirs
from bridge.fleet.children.forked import ENDING, fork
from bridge.fleet.course import Ending, FleetError
from bridge.fleet.how import How, how_joined
from bridge.fleet.preflight.preflight import preflight
from bridge.fleet.preflight.slots import ATTEMPTS, at_free_ports
from bridge.record.names import as_seen_from
from bridge.record.provenance import git_commit
from bridge.run.directory import LOG_FOLDER, RunDirectory
from bridge.run.garbage import look_rarely
from bridge.run.whole_file import whole_file
from bridge.scenario.file import DEFAULT_SCENARIO, read_scenario
from bridge.scenario.model import Scenario
from bridge.scenario.resolve.radio import radio_of
from bridge.scenario.resolve.sources import code_of
from fdm.module_process import how_it_ended
from lostlink.flight.flight import Flight, Watcher
from lostlink.reading.run import load_run
from lostlink.study.made_of import Looker, MadeOf
from lostlink.study.metrics import of_summary, of_tables, own
from lostlink.study.model import Function, StudyError

PLAN_FILE = "plan.json"
RESULT_FILE = "result.json"
RUN_FOLDER = "run"
LOG_FILE = "log.txt"
LOCK_FILE = "lock"
"""Locked by whoever has the case in hand."""
WARM = (
    "bridge.program.process",
    "fdm.model.jsbsim_model",
    "lostlink.export.mcap.export",
    "pyarrow.parquet",
    "scipy.special",
)
"""What a case imports late."""
FRAMES = "pandas"
OWN_WRITES = (
    "; an agent that writes to a file that the scenario names does so in each run: it has self.directory"
)
TAKEN, INTERRUPTED = 203, 204
"""Status of a case's process whose run could not start (`PortsTaken`), and of one that was asked to end: numbers that
agents hardly leave with."""


class PortsTaken(FleetError):
    """Somebody took ports of the run after they were looked at: elsewhere it can start."""


@dataclass(frozen=True, slots=True)
class CasePlan:
    """What a case's process is to do.

    Attributes:
        scenario: as resolved, YAML.
        metrics: functions of the user's own.
        keep: which runs' directories stay: ``all``, ``failed`` or ``none``.
        dirs: where real autopilots are, as far as that was said.
        labels: columns that say which run it is, with what they say.
        made_of: what its id is of; None: it was not kept, and is not seen to.
    """

    scenario: str
    metrics: tuple[Function, ...]
    keep: str
    dirs: AutopilotDirs = NOT_SAID
    labels: Mapping[str, Any] = field(default_factory=dict)
    made_of: MadeOf | None = None

    def write(self, directory: Path) -> None:
        """Put it where the process looks for it."""
        functions = [[one.place, one.name] for one in self.metrics]
        dirs = {name: str(said) for name, said in asdict(self.dirs).items() if said is not None}
        content = {"scenario": self.scenario, "metrics": functions, "keep": self.keep, "dirs": dirs}
        made_of = None if self.made_of is None else asdict(self.made_of)
        write_whole(directory / PLAN_FILE, {**content, "labels": self.labels, "made_of": made_of})

    @classmethod
    def read(cls, directory: Path) -> CasePlan:
        """What was put there."""
        content = json.loads((directory / PLAN_FILE).read_text(encoding="utf-8"))
        functions = tuple(Function(place=place, name=name) for place, name in content["metrics"])
        dirs = AutopilotDirs(**{name: Path(said) for name, said in content["dirs"].items()})
        made_of = MadeOf(**content["made_of"]) if content.get("made_of") else None
        labels = content["labels"] if isinstance(content["labels"], dict) else {}  # names alone say nothing
        return cls(content["scenario"], functions, content["keep"], dirs, labels, made_of)

    @property
    def measures(self) -> str:
        """What is measured (`measures_of`)."""
        return measures_of(self.metrics)


def measures_of(functions: Sequence[Function]) -> str:
    """What is measured, as a digest: other code measures anew."""
    digest = hashlib.sha256()
    for function in functions:
        code = code_of(function.place)
        for file in code.files:
            digest.update(file.read_bytes() + b"\0")
        for name in (function.name, *(f"{name} {version}" for name, version in code.packages.items())):
            digest.update(name.encode() + b"\0")
    return digest.hexdigest()[:16]


def read_result(directory: Path) -> dict[str, Any] | None:
    """The result of a case; None if it has none yet."""
    try:
        content = json.loads((directory / RESULT_FILE).read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return None
    return content if isinstance(content, dict) else None


def is_done(directory: Path, measures: str, labels: Collection[str]) -> bool:
    """Whether the case was flown to its end and measured by this code (`measures_of`), which took no label's place."""
    result = read_result(directory)
    if result is None or result["failure"] or result["measures"] != measures:
        return False
    return not any(label in result["metrics"] for label in labels)


def write_whole(path: Path, content: object) -> None:
    """A JSON file that is there as a whole or not at all, whatever ends this process, and whoever else writes it."""
    with whole_file(path) as partial:
        partial.write_text(json.dumps(content), encoding="utf-8")


def forget(directory: Path, measures: str, labels: Collection[str]) -> None:
    """Remove the result of a case that is not done (`is_done`), unless another process has it in hand just now."""
    with (directory / LOCK_FILE).open("w") as lock, suppress(BlockingIOError):
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        if not is_done(directory, measures, labels):
            (directory / RESULT_FILE).unlink(missing_ok=True)


def fly_case(directory: Path) -> int:
    """Fly and measure the case of a directory, unless that was done; gives the process's status.

    A second process for the same case waits for the first.
    """
    with (directory / LOCK_FILE).open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        plan = CasePlan.read(directory)
        if is_done(directory, plan.measures, plan.labels):
            return 0
        (directory / RESULT_FILE).unlink(missing_ok=True)
        try:
            run = recorded(directory) or _flown(plan, directory)
        except Exception as error:
            traceback.print_exc()
            write_whole(directory / RESULT_FILE, _result(plan, {}, {}, _told(error, plan, directory)))
            return TAKEN if isinstance(error, PortsTaken) else 1
        if run is None:
            return INTERRUPTED
        result = _measured(run, plan) | {"run": run.name}
        if plan.keep == "none" or (
            plan.keep == "failed" and not result["failure"] and result["metrics"]["passed"]
        ):
            _remove_link(directory)
            _remove(run, but_logs=bool(result["failure"]))
        write_whole(directory / RESULT_FILE, result)
        return 1 if result["failure"] else 0


def _measured(path: Path, plan: CasePlan) -> dict[str, Any]:
    metrics: dict[str, Any] = {}
    try:
        run = load_run(path)
        metrics = of_summary(run)
        metrics |= of_tables(run)
        timing = {key: run.summary[key] for key in ("wall_duration_s", "real_time_factor")}
        return _result(
            plan, metrics | own(run, plan.metrics, {*metrics, *plan.labels}), timing, metrics["error"]
        )
    except Exception as error:
        traceback.print_exc()
        return _result(plan, metrics, {}, metrics.get("error") or _told(error, plan, path.parent))


def _result(
    plan: CasePlan, metrics: dict[str, Any], timing: dict[str, float], failure: str
) -> dict[str, Any]:
    return {"failure": failure, "measures": plan.measures, "metrics": metrics, "timing": timing}


def _told(error: Exception, plan: CasePlan, directory: Path) -> str:
    """An error in words in which no path hangs on where the study's folder lies."""
    told = str(error) if isinstance(error, StudyError) else f"{type(error).__name__}: {error}"
    for folder in (
        directory,
        *(Path(each.place).parent for each in plan.metrics if each.place.endswith(".py")),
    ):
        told = as_seen_from(folder, told)
    return told


def recorded(directory: Path) -> Path | None:
    """The run that is there already and came to an end, if there is one: it needs only be measured.

    Where an archive put a copy in the place of the link, that is the run.
    """
    link = directory / RUN_FOLDER
    return link.resolve() if link.is_dir() else None


def _remove(run: Path, *, but_logs: bool) -> None:
    """Remove a run's directory; of one that failed the logs stay, which its failure names."""
    if not but_logs:
        shutil.rmtree(run, ignore_errors=True)
        return
    for part in run.iterdir():
        if part.is_dir() and part.name != LOG_FOLDER:
            shutil.rmtree(part, ignore_errors=True)
        elif part.is_file():
            with suppress(OSError):
                part.unlink()


def _remove_link(directory: Path) -> None:
    link = directory / RUN_FOLDER
    if link.is_symlink():
        link.unlink()


def _flown(plan: CasePlan, directory: Path) -> Path | None:
    """Fly where no other run's ports are; None if that was interrupted.

    The link `RUN_FOLDER` leads to the run if it came to an end.

    Raises:
        PortsTaken: it could not start there.
        StudyError: it is made of others than its id says.
    """
    _remove_link(directory)
    for old in directory.glob("*/"):
        shutil.rmtree(old, ignore_errors=True)
    scenario = Scenario.from_yaml(plan.scenario)
    _see_what_it_is_made_of(plan, scenario)
    with at_free_ports(scenario) as placed:
        preflight(placed, plan.dirs)
        run = RunDirectory.create(directory, placed.name)
        how: How = how_joined(placed)
        flight = Flight(placed, run, Watcher(), "task" if how == "one" else how)
        summary = flight.fly(plan.dirs)
    if flight.signal is not None:
        return None
    if flight.has_no_ports:
        raise PortsTaken(summary["error"])
    try:
        _see_what_it_is_made_of(plan, scenario, "while it flew", OWN_WRITES)
    except StudyError:
        if plan.keep == "none":
            shutil.rmtree(run.path, ignore_errors=True)
        raise
    if summary["ending"] != Ending.FAILED:
        (directory / RUN_FOLDER).symlink_to(run.path.name)
    return run.path


def _see_what_it_is_made_of(
    plan: CasePlan, scenario: Scenario, when: str = "after the study was read", advice: str = ""
) -> None:
    """See that files, packages and lostlink are still those that its id is of.

    Raises:
        StudyError: they are not.
    """
    if plan.made_of is None:
        return
    now = Looker().made_of(scenario)
    if now.id != plan.made_of.id:
        raise StudyError(
            f"no result of this run, as something was changed {when}: {now.changes_since(plan.made_of)}; "
            f"start the study again{advice}"
        )


def fly_forked(directory: Path) -> None:
    """Fly a case in a process that is forked from this one, and wait for its end.

    A run that could not start, as somebody took its ports, is flown elsewhere, in another process.
    """
    child, is_ended = 0, False

    def pass_on(number: int, _: object) -> None:
        nonlocal is_ended
        is_ended = True
        with suppress(ProcessLookupError):
            if child:
                os.kill(child, number)

    kept = {number: signal.signal(number, pass_on) for number in ENDING}
    for _ in range(ATTEMPTS):
        signal.pthread_sigmask(signal.SIG_BLOCK, ENDING)  # until it is known whom to pass them on to
        child = 0 if is_ended else fork(partial(_be_a_case, directory))
        signal.pthread_sigmask(signal.SIG_UNBLOCK, ENDING)
        if not child or not _is_to_fly_again(child, directory):
            break
    for number, handler in kept.items():
        signal.signal(number, handler)


def _is_to_fly_again(child: int, directory: Path) -> bool:
    """Wait for the process of a case; gives whether its run could not start for its ports."""
    _, waited = os.waitpid(child, 0)
    status = os.waitstatus_to_exitcode(waited)
    if status != INTERRUPTED and -status not in ENDING:
        _tell_end(directory, f"its process {how_it_ended(status)}; see {LOG_FILE}")
    return status == TAKEN


def _tell_end(directory: Path, how: str) -> None:
    """What ended the process of a case is its result, if it left none and no other process has it in hand."""
    with suppress(OSError), (directory / LOCK_FILE).open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        if read_result(directory) is None:
            write_whole(directory / RESULT_FILE, _result(CasePlan.read(directory), {}, {}, how))


def _be_a_case(directory: Path) -> int:
    np.random.seed()  # noqa: TID251
    with Path(os.devnull).open("rb") as nothing:
        os.dup2(nothing.fileno(), 0)  # what comes there are orders, for this process's parent
    with (directory / LOG_FILE).open("ab") as log:
        for standard in (1, 2):
            os.dup2(log.fileno(), standard)
    os.chdir(directory)  # nothing that a run leaves where it is started lands beside the study
    return fly_case(directory)


def load_all() -> None:
    """Import what flying and measuring a case imports, and see which lostlink that is, so that no case has to."""
    look_rarely()
    for name in WARM:
        import_module(name)
    radio_of(read_scenario(DEFAULT_SCENARIO))  # models, installed laws
    git_commit()
    _freeze()


def _measures_more(directory: Path) -> bool:
    """Whether a case is measured by functions of the user's own; one without a plan says so itself.

    What is found out of their code is known in processes forked from this one.
    """
    with suppress(OSError, ValueError, LookupError):
        plan = CasePlan.read(directory)
        return bool(plan.metrics and plan.measures)
    return False


def load_frames() -> None:
    """Import what a user's own metrics most likely ask for; where it cannot be, they are told when they do."""
    if FRAMES not in sys.modules:
        with suppress(Exception):
            import_module(FRAMES)
            _freeze()


def _freeze() -> None:
    gc.collect()
    gc.freeze()


def main() -> int:
    """Fly the cases whose directories come on stdin, one after the other."""
    load_all()
    for line in sys.stdin:
        directory = Path(line.rstrip("\n"))
        if _measures_more(directory):
            load_frames()
        fly_forked(directory)
        print(line, end="", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
