"""`fly`: a run from a script, a notebook or a test, as `lostlink run` flies it."""

from __future__ import annotations

from collections.abc import Mapping
from concurrent.futures import wait
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import Any, Literal

from bridge.fleet.autopilots.dirs import AutopilotDirs
from bridge.fleet.own_thread import begun
from bridge.fleet.preflight.preflight import preflight
from bridge.fleet.preflight.slots import at_own_or_free_ports, at_own_ports
from bridge.run.access import RUNS
from bridge.run.directory import RunDirectory
from bridge.scenario.file import read_scenario, scenario_from
from bridge.scenario.model import Scenario
from bridge.scenario.nodes import AutopilotName
from lostlink.flight.exits import WELL, RunOutcome, status_of
from lostlink.flight.flight import Flight, Watcher
from lostlink.flight.shown.console import plain_console
from lostlink.flight.shown.progress import Progress
from lostlink.reading.run import Run, load_run

Autopilot = AutopilotName
ScenarioLike = str | Path | Mapping[str, Any] | Scenario
"""A shipped scenario's name, a YAML file, its content as a mapping, or one that was read already."""


@dataclass(frozen=True, repr=False)
class RunResult:
    """What came of a run.

    Attributes:
        path: its directory.
        summary: the content of `summary.json` (docs/reference/run-output.md).
    """

    path: Path
    summary: dict[str, Any]

    def __repr__(self) -> str:
        """Short enough for what an assertion shows of it, with why it failed."""
        return f"<RunResult {self.path.name}, {self.ending}: {self.verdict}>"

    @property
    def ending(self) -> str:
        """``done``, ``duration``, ``interrupted`` or ``failed``."""
        return str(self.summary["ending"])

    @property
    def outcome(self) -> RunOutcome:
        """What it is worth, in one word."""
        return RunOutcome(self.summary["outcome"])

    @property
    def verdict(self) -> str:
        """The outcome in words, and whether what was measured agrees with the model and the expectations."""
        return str(self.summary["verdict"])

    @property
    def error(self) -> str | None:
        """What ended the run, if it failed."""
        return None if self.summary["error"] is None else str(self.summary["error"])

    @property
    def ok(self) -> bool:
        """Whether the run came to its end and agrees with model and expectations: `lostlink run` ends with status 0."""
        return status_of(self.summary) == WELL

    @cached_property
    def run(self) -> Run:
        """The record."""
        return load_run(self.path)


def fly(
    scenario: ScenarioLike = "separation",
    *,
    seed: int | None = None,
    speed: float | Literal["max"] | None = "max",
    duration_s: float | None = None,
    autopilot: Autopilot | None = None,
    first_slot: int | Literal["auto"] | None = None,
    changes: Mapping[str, Any] | None = None,
    directory: str | Path | None = None,
    ardupilot_dir: str | Path | None = None,
    px4_dir: str | Path | None = None,
    quiet: bool = True,
) -> RunResult:
    """Fly a scenario to its end, as `lostlink run` does, and return what came of it.

    May be called in any thread, also where an event loop runs (a notebook); it blocks until the run is over. On Ctrl-C
    the run is ended in order, with its record, and KeyboardInterrupt goes on. No process of it is left behind, whatever
    ends this one.

    Args:
        scenario: a shipped scenario's name, the path of a YAML file, the content of such a file as a mapping, or a
            `Scenario`. Files that a mapping names are as seen from the working directory.
        seed: in place of the scenario's, as are the next four; None: as the scenario has it.
        speed: real-time factor, or ``max``: as fast as this machine can.
        duration_s: longest sim time.
        autopilot: ``standin``, ``ardupilot``, ``px4`` or ``external``.
        first_slot: in place of the scenario's ``ports.first_slot``; ``auto``: the scenario's, or if any port of the run
            is in use, the next where all are free.
        changes: further keys of the scenario, dotted: ``{"ports.zenoh": 0, "fdm.coupling": "parallel"}``.
        directory: where runs are kept; the run makes its own in there. ``runs/`` unless given.
        ardupilot_dir: where real binaries are; else ARDUPILOT_HOME, else PATH.
        px4_dir: PX4's checkout, or the folder of its build; else PX4_HOME, else PATH.
        quiet: show no progress.

    Raises:
        ScenarioError: the scenario cannot be used; a line per mistake, each with its place.
        FleetError: the run could not start: a port is taken, or an autopilot is missing.
        OSError, ValueError: its directory or its record cannot be written.
    """
    given = {"seed": seed, "speed": speed, "duration_s": duration_s, "autopilot": autopilot}
    given["ports.first_slot"] = None if first_slot == "auto" else first_slot
    asked = {key: value for key, value in given.items() if value is not None} | dict(changes or {})
    dirs = AutopilotDirs(*(Path(said) if said else None for said in (ardupilot_dir, px4_dir)))
    place = at_own_or_free_ports if first_slot == "auto" else at_own_ports
    with place(read_like(scenario, asked)) as placed:
        preflight(placed, dirs)
        run = RunDirectory.create(RUNS if directory is None else Path(directory), placed.name)
        watcher = Watcher() if quiet else Progress(plain_console())
        return RunResult(run.path, _in_a_thread(Flight(placed, run, watcher), dirs))


def read_like(scenario: ScenarioLike, overrides: Mapping[str, Any]) -> Scenario:
    """The scenario that a script names, with values by dotted key in place of its own.

    Raises:
        ScenarioError: it cannot be used.
    """
    if isinstance(scenario, Scenario | Mapping):
        return scenario_from(scenario, overrides)
    return read_scenario(scenario, overrides)


def _in_a_thread(flight: Flight, dirs: AutopilotDirs) -> dict[str, Any]:
    """Fly in a thread, which has no event loop yet and no signals; whatever ends the wait ends the flight first."""
    outcome = begun(partial(flight.fly, dirs, takes_signals=False), f"fly {flight.directory.path.name}")
    try:
        return outcome.result()
    except BaseException:
        flight.interrupt()
        raise
    finally:
        # An interrupted `Thread.join` would take the thread for ended, and Python not wait for it.
        wait([outcome])
