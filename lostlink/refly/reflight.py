"""Flies a recorded run again with its recorded inputs, and compares. `lostlink.cli.flying.refly` is the command."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Protocol

from bridge.fleet.autopilots.dirs import NOT_SAID, AutopilotDirs
from bridge.record.ending import Extent, extent_of
from bridge.record.events import read_reports, transmits_freely
from bridge.record.inputs.file import all_inputs
from bridge.record.names import packets, streams_of
from bridge.record.packets import packets_of
from bridge.record.provenance import differences, read_provenance, version_noted
from bridge.record.streams import read_stream, stream_exists
from bridge.record.tables.deliveries import DELIVERIES
from bridge.record.tables.every import TABLES
from bridge.record.tables.reader import read_batches
from bridge.record.ways import check_ways
from bridge.run.directory import SCENARIO_FILE, RunDirectory
from bridge.scenario.file import read_scenario, with_changes
from bridge.scenario.mistakes.error import ScenarioError
from bridge.scenario.model import Scenario
from lostlink.compare.compare import OnProgress, examine
from lostlink.compare.difference import Comparison, seconds
from lostlink.reading.moved import Moved

FROM_THERE = "a difference may come from there"


class Fly(Protocol):
    """Flies a scenario into a run directory that is there and empty, and returns its summary."""

    def __call__(
        self,
        scenario: Scenario,
        directory: RunDirectory,
        *,
        dirs: AutopilotDirs,
        replay: Path | None,
        stop_ns: int | None,
        quiet: bool,
    ) -> dict[str, Any]:
        """Fly.

        Args:
            scenario: what to fly.
            directory: where the run goes.
            dirs: where real autopilots are.
            replay: a run directory whose inputs take the place of all from outside.
            stop_ns: the run ends when the tick at this sim time is closed; None: as the scenario says.
            quiet: show nothing.
        """


@dataclass(frozen=True, slots=True)
class ReflightPlan:
    """A recorded run that can be flown again.

    Attributes:
        run: its directory.
        scenario: what to fly.
        extent: how much of it there is.
        remarks: why it may come out differently, as far as that is known before.
        dirs: where the real autopilots were that flew the record.
        moved: where files that its scenario names lie now.
    """

    run: Path
    scenario: Scenario
    extent: Extent
    remarks: tuple[str, ...]
    dirs: AutopilotDirs
    moved: Moved

    @property
    def extent_told(self) -> str:
        """Up to where it is flown, in words; "" if to its end."""
        stop_ns = self.extent.stop_ns
        return "" if stop_ns is None else f" up to its last whole tick, {seconds(stop_ns)}"


@dataclass(frozen=True, slots=True)
class Reflight:
    """The run that was flown again.

    Attributes:
        directory: where it is.
        summary: what it gave.
        comparison: how the two compare.
        other_ending: how their endings differ, in words; "" if they do not.
        remarks: what else is other.
    """

    directory: RunDirectory
    summary: dict[str, Any]
    comparison: Comparison
    other_ending: str
    remarks: tuple[str, ...]

    @property
    def is_different(self) -> bool:
        """Whether the two, or their endings, are not the same."""
        return self.comparison.difference is not None or bool(self.other_ending)


class Interrupted(Exception):
    """The new flight was interrupted: there is nothing to compare."""


def plan(run: Path, changes: Mapping[str, Any], code: Path | None = None) -> ReflightPlan:
    """See that the run in ``run`` can be flown again.

    Args:
        run: a run directory.
        changes: to its scenario, by dotted key: what has no effect on the result, such as speed and ports.
        code: below which folder files that its scenario names lie now; None: nothing was said.

    Raises:
        ValueError: it cannot; the text says why.
        OSError: a file cannot be read.
    """
    if not run.is_dir():
        raise ValueError(f"{run}: no such directory")
    if not (run / SCENARIO_FILE).is_file():
        raise ValueError(f"{run}: not the directory of a run: it has no {SCENARIO_FILE}")
    if RunDirectory(run).is_live:
        raise ValueError(f"{run}: this run has not ended yet")
    moved = Moved(run, code)
    with version_noted(run):
        has_streams, recorded = _begun(run, moved)
    scenario = with_changes(recorded, changes)
    with version_noted(run):
        extent = _read(run, scenario)
    remarks = _why_not(run, scenario)
    if not has_streams:
        remarks.append(f"note: {run} has no streams/: only its tables can be compared")
    remarks += [f"note: files that were in {old} are taken from {new}" for old, new in moved.folders.items()]
    return ReflightPlan(run, scenario, extent, tuple(remarks), _dirs_of(run), moved)


def _begun(run: Path, moved: Moved) -> tuple[bool, Scenario]:
    """Whether a record has streams, and its scenario."""
    has_streams = bool(streams_of(run))
    if not has_streams and not DELIVERIES.is_in(run):
        raise ValueError(f"{run}: it has neither deliveries nor streams/: there is nothing to compare with")
    return has_streams, _recorded_scenario(run, moved)


def _read(run: Path, scenario: Scenario) -> Extent:
    """Read all else that will be needed of a record, and how far it goes."""
    check_ways(scenario, all_inputs(run))
    extent = extent_of(run)
    _check_tables(run)
    _check_streams(run, extent)
    return extent


def _why_not(run: Path, scenario: Scenario) -> list[str]:
    """Why the run may not repeat; what free programs transmitted is an input of its own if streams have it."""
    free = {transmits_freely(each.node): each.node for each in scenario.transceivers if not each.has_agent}
    remarks = []
    for reason in read_reports(run).may_not_repeat:
        if reason not in free:
            remarks.append(f"warning: this run may not repeat: {reason}")
        elif not stream_exists(packets(free[reason]).path(run)):
            remarks.append(
                f"warning: this run does not repeat: {reason}, and {packets(free[reason])} is missing"
            )
    named = [node for node in free.values() if next(packets_of(run, node), None) is not None]
    return remarks + [
        f"note: what a program transmitted as node {node} is taken from the record" for node in named
    ]


def _recorded_scenario(run: Path, moved: Moved) -> Scenario:
    try:
        return read_scenario(str(run / SCENARIO_FILE), find=moved.find)
    except ScenarioError as error:
        if not moved.missing:
            raise
        files, folders = (", ".join(map(str, each)) for each in (moved.missing, moved.looked_in))
        raise ValueError(
            f"{error}\n{files}: neither there, nor with the content of the record below {folders}: say with "
            "--code FOLDER below which folder they lie now"
        ) from error


def _check_tables(run: Path) -> None:
    """Read what the new run will be compared with: else a damaged table is found when all has been flown."""
    for table in TABLES:
        if table.is_in(run):
            for _ in read_batches(run, table):
                pass


def _check_streams(run: Path, extent: Extent) -> None:
    """The same of streams; of a run that was killed they may end anywhere."""
    for stream in streams_of(run):
        for _ in read_stream(stream.path(run), is_whole=not extent.was_cut):
            pass


def _dirs_of(run: Path) -> AutopilotDirs:
    made = read_provenance(run)
    origins = [] if made is None else [origin for origin in made.autopilots.values() if origin.path]
    places = {origin.source: Path(origin.path).parent for origin in origins}
    px4 = places.get("px4")
    return AutopilotDirs(places.get("ardupilot"), None if px4 is None else px4.parent)


def fly_again(
    planned: ReflightPlan,
    directory: RunDirectory,
    fly: Fly,
    *,
    dirs: AutopilotDirs = NOT_SAID,
    quiet: bool = True,
    on_progress: OnProgress | None = None,
) -> Reflight:
    """Fly the plan into ``directory`` and compare the two runs.

    Real binaries are those that flew the record, unless ``dirs`` says others.

    Raises:
        Interrupted: the new flight was.
        ValueError, OSError: it could not be flown, or a record cannot be read.
    """
    summary = fly(
        planned.scenario,
        directory,
        dirs=dirs.or_else(planned.dirs),
        replay=planned.run,
        stop_ns=planned.extent.stop_ns,
        quiet=quiet,
    )
    if summary.get("ending") == "interrupted":
        raise Interrupted
    remarks = (*_what_is_other(planned, directory.path), *_what_went_wrong(directory.path, summary))
    extent = planned.extent
    comparison = examine(
        planned.run, directory.path, extent.stop_ns, a_was_cut=extent.was_cut, on_progress=on_progress
    )
    return Reflight(directory, summary, comparison, _other_ending(extent, summary), remarks)


def _other_ending(extent: Extent, summary: Mapping[str, Any]) -> str:
    now = str(summary.get("ending"))
    if not extent.other_ending(now):
        return ""
    before = f"ended as {extent.ending!r}" if extent.ending else "has no ending in its summary"
    return f"the endings differ: the recorded run {before}, the new one as {now!r}"


def _what_is_other(planned: ReflightPlan, reflown: Path) -> list[str]:
    old, new = read_provenance(planned.run), read_provenance(reflown)
    if old is None or new is None:
        return [f"note: {planned.run if old is None else reflown} does not say what it was made with"]
    old = replace(old, files=planned.moved.renamed(old.files))
    return [f"{line}; {FROM_THERE}" for line in differences(old, new)]


def _what_went_wrong(reflown: Path, summary: Mapping[str, Any]) -> list[str]:
    remarks = [f"warning: the new run may not repeat: {r}" for r in read_reports(reflown).may_not_repeat]
    if summary.get("ending") == "failed":
        remarks.append(f"warning: the new run broke off: {summary.get('error')}")
    return remarks
