"""One run as the commands that fly see it: progress, interruption, summary."""

from __future__ import annotations

import asyncio
import signal
import sys
from pathlib import Path
from time import monotonic
from typing import Any

import click
from rich.console import Console

from bridge.bus.messages import Clock, Message
from bridge.cli.progress import Progress
from bridge.cli.report import (
    FIGURE_FILE,
    UNJUDGED,
    Timing,
    draw_probability_of_delivery,
    summarise,
    write_summary,
)
from bridge.fleet.supervisor import Ending, Fleet, FleetError, Observer
from bridge.record.tables.parquet import finish_tables
from bridge.run.directory import RunDirectory
from bridge.run.every import Every
from bridge.scenario.model import Scenario
from bridge.scenario.resolve_radio import radio_of
from bridge.timeouts import NEWS_PERIOD_S

EXIT_FAILED = 1


def fly(
    scenario: Scenario,
    directory: RunDirectory,
    *,
    ardupilot_dir: Path | None,
    replay: Path | None,
    stop_ns: int | None,
    quiet: bool,
) -> dict[str, Any]:
    """Fly for another command (`bridge.cli.reflight.Fly`); a scenario may be cut short at the tick ``stop_ns``.

    Raises:
        ValueError: there is no summary.
    """
    if stop_ns is not None:
        scenario = scenario.model_copy(update={"duration_s": stop_ns / 1e9})
    flight = Flight(scenario, directory, Console(stderr=quiet), quiet=quiet)
    summary = flight.fly(ardupilot_dir, replay)
    if summary is None:
        raise ValueError(f"{directory.path}: the run left no summary")
    return summary


class Flight:
    """One run, from the first process to its summary.

    Args:
        scenario: what to fly.
        directory: where to, already there.
        console: where progress is shown.
        quiet: show none.
    """

    def __init__(
        self, scenario: Scenario, directory: RunDirectory, console: Console, *, quiet: bool = False
    ) -> None:
        self.scenario = scenario
        self.directory = directory
        self.console = console
        self.quiet = quiet
        self.signal: signal.Signals | None = None
        self._first_tick: float | None = None
        self._last_tick = 0.0
        self._unfinished: list[str] = []
        self._error: str | None = None

    def fly(self, ardupilot_dir: Path | None = None, replay: Path | None = None) -> dict[str, Any] | None:
        """Fly, and return the summary; None if not even that could be written (the error was told).

        Args:
            ardupilot_dir: where real binaries are, if that was said.
            replay: directory of a run whose inputs from outside are repeated.
        """
        if not self.quiet:
            self.console.print(f"run {self.directory.path}", highlight=False, soft_wrap=True)
        try:
            with Progress(self.console, quiet=self.quiet) as progress:
                ending, sim_time_ns = asyncio.run(self._fly(progress, ardupilot_dir, replay))
            for number in (signal.SIGINT, signal.SIGTERM):
                signal.signal(number, lambda n, _: sys.exit(128 + n))
            return self._report(ending, sim_time_ns)
        except (OSError, ValueError) as error:
            click.echo(f"lostlink: {error}", err=True)
            return None

    def exit_status(self, summary: dict[str, Any] | None) -> int:
        """What the process ends with."""
        if self.signal is not None:
            return 128 + self.signal
        failed = (
            summary is None or summary["ending"] == Ending.FAILED or summary["verdict"].startswith("fail")
        )
        return EXIT_FAILED if failed else 0

    async def _fly(
        self, progress: Progress, ardupilot_dir: Path | None, replay: Path | None
    ) -> tuple[Ending, int]:
        def on_message(message: Message) -> None:
            if isinstance(message, Clock):
                self._last_tick = monotonic()
                self._first_tick = self._first_tick or self._last_tick
            progress.on_message(message)

        observer = Observer(progress.on_phase, on_message)
        fleet = Fleet(self.scenario, self.directory, observer, ardupilot_dir, replay)

        def interrupt(number: signal.Signals) -> None:
            self.signal = number
            fleet.interrupt()

        for number in (signal.SIGINT, signal.SIGTERM):
            asyncio.get_running_loop().add_signal_handler(number, interrupt, number)
        try:
            ending = await fleet.fly()
        except FleetError as error:
            ending = self._break_off(str(error))
        for name in fleet.killed:
            text = f"{name} did not end in time and was killed; its log is {self.directory.log_path(name)}"
            if name == "router":
                ending = self._break_off(f"{text}; without its last part the record is not complete")
            else:
                click.echo(f"lostlink: {text}", err=True)
        self._unfinished = sorted(fleet.not_done)
        return ending, fleet.sim_time_ns

    def _break_off(self, error: str) -> Ending:
        """Tell what ended the run; the first such error is its cause."""
        click.echo(f"lostlink: {error}", err=True)
        self._error = self._error or error
        return Ending.FAILED

    def _finish_tables(self) -> None:
        news = Every(NEWS_PERIOD_S)

        def tell(table: str, rows: int) -> None:
            if not self.quiet and news.is_due():
                self.console.print(f"writes {table}.parquet: {rows} rows so far", highlight=False)

        finish_tables(self.directory.path, tell)

    def _report(self, ending: Ending, sim_time_ns: int) -> dict[str, Any]:
        wall_s = self._last_tick - self._first_tick if self._first_tick is not None else 0.0
        timing = Timing(sim_time_ns / 1e9, wall_s)
        try:
            self._finish_tables()
        except (OSError, ValueError) as error:
            ending = self._break_off(f"its tables could not be written as Parquet: {error}")
        summary = summarise(
            self.scenario, self.directory, timing, ending.value, self._unfinished, error=self._error
        )
        write_summary(summary, self.directory)
        if ending not in UNJUDGED:
            own = any(node.radio is not None for node in self.scenario.nodes)
            radio = None if own else radio_of(self.scenario)  # one curve is not that of several radios
            draw_probability_of_delivery(summary, radio, self.directory.path / FIGURE_FILE)
        return summary
