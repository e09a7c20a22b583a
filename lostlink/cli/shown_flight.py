"""A flight as commands show it: progress on the terminal, and errors as they print them."""

from __future__ import annotations

import signal
from pathlib import Path
from typing import Any

from rich.console import Console

from bridge.fleet.autopilots.dirs import NOT_SAID, AutopilotDirs
from bridge.fleet.understudies import understudies_of
from bridge.run.directory import RunDirectory
from bridge.scenario.model import Scenario
from lostlink.flight.flight import Flight
from lostlink.flight.shown.console import plain_console
from lostlink.flight.shown.progress import Progress
from lostlink.flight.shown.say import say


class ShownFlight(Flight):
    """One run, shown on ``console``; not if ``quiet``."""

    def __init__(
        self, scenario: Scenario, directory: RunDirectory, console: Console, *, quiet: bool = False
    ) -> None:
        understudies = understudies_of(scenario)
        self._progress = Progress(console, quiet=quiet, on_unread=self._unread)
        super().__init__(scenario, directory, self._progress, understudies=understudies)
        self.take_signals()
        self.console = console
        self.quiet = quiet

    def fly_and_tell(
        self, dirs: AutopilotDirs = NOT_SAID, replay: Path | None = None
    ) -> dict[str, Any] | None:
        """As `Flight.fly`; None if not even a summary could be written (the error was reported)."""
        if not self.quiet:
            self._progress.tell(f"run {self.directory.path}")
        try:
            return self.fly(dirs, replay)
        except (OSError, ValueError) as error:
            is_placed = getattr(error, "filename", None) is not None or not isinstance(error, OSError)
            place = "" if is_placed else f"{self.directory.path}: "
            say(
                f"lostlink: {place}{error}; the run has no summary; `lostlink export {self.directory.path} --parquet "
                "--mcap` writes the tables and run.mcap of what was flown",
                err=True,
            )
            return None

    def _unread(self) -> None:
        """Nobody reads what is printed: that ends a run as the end of its terminal does."""
        self.signal = self.signal or signal.SIGPIPE  # Ctrl-C ends whoever reads, too
        self.interrupt()


def fly(
    scenario: Scenario,
    directory: RunDirectory,
    *,
    dirs: AutopilotDirs,
    replay: Path | None,
    stop_ns: int | None,
    quiet: bool,
) -> dict[str, Any]:
    """Fly for another command (`lostlink.refly.reflight.Fly`); a scenario may be cut short at the tick ``stop_ns``.

    Raises:
        ValueError: there is no summary.
    """
    if stop_ns is not None:
        scenario = scenario.model_copy(update={"duration_s": stop_ns / 1e9})
    summary = ShownFlight(scenario, directory, plain_console(stderr=quiet), quiet=quiet).fly_and_tell(
        dirs, replay
    )
    if summary is None:
        raise ValueError(f"{directory.path}: the run left no summary")
    return summary
