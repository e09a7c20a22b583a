"""One run as whoever flies it sees it: progress, interruption, summary."""

from __future__ import annotations

import asyncio
import signal
import sys
import threading
from collections.abc import AsyncIterator, Mapping
from contextlib import suppress
from pathlib import Path
from time import monotonic
from types import MappingProxyType
from typing import Any, Self

from bridge.bus.messages import Clock, Message
from bridge.fleet.autopilots.dirs import NOT_SAID, AutopilotDirs
from bridge.fleet.children.forked import Understudy
from bridge.fleet.course import Ending, FleetError
from bridge.fleet.glance import Glance
from bridge.fleet.how import How
from bridge.fleet.preflight.ports import conflicts, ports_of
from bridge.fleet.supervisor import Fleet, Observer
from bridge.record.names import as_seen_from
from bridge.record.pack import pack_streams
from bridge.record.tables.every import finish_tables
from bridge.run.directory import RunDirectory
from bridge.run.every import Every
from bridge.scenario.model import Scenario
from bridge.timeouts import NEWS_PERIOD_S
from lostlink.flight.exits import UNUSABLE, status_of
from lostlink.flight.figure import draw_figure_of
from lostlink.flight.signals import ending_signals, heed_signals, leave_terminal
from lostlink.flight.summary import TickWatch, summarise, write_summary
from lostlink.flight.verdict import UNJUDGED


class Watcher:
    """Watches a run while it goes on; entered when it begins to fly, left when its summary is there.

    This one shows nothing, and keeps nothing: the summary has all of it.

    Attributes:
        glance: where states and link reports are to be kept; None: not wanted.
    """

    glance: Glance | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        return None

    def on_phase(self, phase: str) -> None:
        """What the supervisor does now, in words."""

    def on_message(self, message: Message) -> None:
        """A message of the run."""

    def on_error(self, text: str) -> None:
        """Something went wrong."""

    def on_warning(self, text: str) -> None:
        """What somebody must see while the run goes on."""

    def on_news(self, text: str) -> None:
        """How far the end of the record is."""


class Flight:
    """One run, from the first process to its summary.

    Args:
        scenario: what to fly.
        directory: where to, already there.
        watcher: is called as it goes on.
        how: how the parts of the run are joined; None: as the scenario says.
        understudies: of processes of the run, by their names (`bridge.fleet.understudies`).

    Attributes:
        has_no_ports: it could not start, since somebody took one of its ports after they were looked at.
        view: what goes wrong with a view of the run. The first is awaited before the first tick, which the view is to
            show: "" if it has joined, or why not. None: there is no view.
    """

    def __init__(
        self,
        scenario: Scenario,
        directory: RunDirectory,
        watcher: Watcher,
        how: How | None = None,
        understudies: Mapping[str, Understudy] = MappingProxyType({}),
    ) -> None:
        self._how, self._understudies = how, understudies
        self.scenario = scenario
        self.directory = directory
        self.signal: signal.Signals | None = None
        self.has_no_ports = False
        self.view: AsyncIterator[str] | None = None
        self._view_watch: asyncio.Task[None] | None = None
        self._watcher = watcher
        self._lock = threading.Lock()
        self._interrupted = False
        self._loop: asyncio.AbstractEventLoop | None = None
        self._fleet: Fleet | None = None
        self._ticks = TickWatch()
        self._unfinished: list[str] = []
        self._error: str | None = None
        self._doing = ""
        """What is done once all processes are gone."""

    def fly(
        self, dirs: AutopilotDirs = NOT_SAID, replay: Path | None = None, *, takes_signals: bool = True
    ) -> dict[str, Any]:
        """Fly, and return the summary.

        Args:
            dirs: where real autopilots are, as far as that was said.
            replay: directory of a run whose inputs from outside are repeated.
            takes_signals: SIGINT, SIGTERM and SIGHUP end the flight in order, and the first two then the process; for
                the main thread of a program of ours. Otherwise `interrupt` does it.

        Raises:
            OSError, ValueError: the record cannot be read or written.
        """
        with self._watcher, self.directory.going_on():
            ending, sim_time_ns = asyncio.run(self._fly(dirs, replay, takes_signals=takes_signals))
            if takes_signals:
                for number in ending_signals():
                    signal.signal(number, _interrupted_late)
            try:
                return self._report(ending, sim_time_ns)
            except SystemExit:
                self._watcher.on_error(
                    f"interrupted while it {self._doing}; `lostlink export {self.directory.path} --parquet --mcap` "
                    "writes the tables and run.mcap of what was flown"
                )
                raise

    def take_signals(self) -> None:
        """SIGINT, SIGTERM and SIGHUP end the flight from now on, before it has begun; in the main thread."""
        for number in ending_signals():
            signal.signal(number, self._interrupted_early)
        heed_signals()

    def _interrupted_early(self, number: int, _: object) -> None:
        """A signal before the fleet is there: it is interrupted as soon as it is (`_take_charge`)."""
        leave_terminal()
        self.signal, self._interrupted = signal.Signals(number), True

    @property
    def is_flying(self) -> bool:
        """Whether its fleet is there, and has not come to its end."""
        return self._fleet is not None and not self._fleet.is_over

    def interrupt(self) -> None:
        """End the flight now; from any thread."""
        with self._lock:
            self._interrupted = True
            if self._loop is not None and self._fleet is not None:
                self._loop.call_soon_threadsafe(self._fleet.interrupt)

    def exit_status(self, summary: dict[str, Any] | None) -> int:
        """What a command ends with."""
        if self.signal is not None:
            return 128 + self.signal
        return UNUSABLE if self.has_no_ports else status_of(summary)

    async def _fly(
        self, dirs: AutopilotDirs, replay: Path | None, *, takes_signals: bool
    ) -> tuple[Ending, int]:
        def on_message(message: Message) -> None:
            if isinstance(message, Clock):
                self._ticks.tick(message.header.stamp.ns, monotonic())
            self._watcher.on_message(message)

        joins = self._view_joins if self.view is not None else None
        watcher = self._watcher
        observer = Observer(watcher.on_phase, on_message, watcher.glance, joins, watcher.on_warning)
        fleet = Fleet(self.scenario, self.directory, observer, dirs, replay, self._how, self._understudies)
        if takes_signals:
            self._pass_signals_to(fleet)
        self._take_charge(fleet)
        try:
            ending = await fleet.fly()
        except FleetError as error:
            ending = self._break_off("\n".join([*self._taken_meanwhile(fleet, replay), str(error)]))
        finally:
            if self._view_watch is not None:
                self._view_watch.cancel()
                with suppress(asyncio.CancelledError):
                    await self._view_watch
            with self._lock:
                self._loop = None
        for name in fleet.killed:
            text = f"{name} did not end in time and was killed; its log is {self.directory.log_path(name)}"
            if name == fleet.recorder:
                ending = self._break_off(f"{text}; without its last part the record is not complete")
            else:
                self._watcher.on_error(text)
        self._unfinished = [node for node in self.scenario.transceiver_ids if node in fleet.course.not_done]
        return ending, fleet.course.sim_time_ns

    async def _view_joins(self) -> None:
        assert self.view is not None
        self._watcher.on_phase("waits for the view")
        if failure := await anext(self.view, ""):
            self._watcher.on_error(failure)
        self._view_watch = asyncio.create_task(self._tell_failures(self.view))

    async def _tell_failures(self, failures: AsyncIterator[str]) -> None:
        async for failure in failures:
            self._watcher.on_error(failure)

    def _taken_meanwhile(self, fleet: Fleet, replay: Path | None) -> list[str]:
        """Of a run that ended before its first tick: ports that somebody took after they were looked at."""
        if fleet.course.sim_time_ns:
            return []
        taken = conflicts(ports_of(self.scenario, repeats=replay is not None))
        self.has_no_ports = bool(taken)
        return taken

    def _take_charge(self, fleet: Fleet) -> None:
        """From here on `interrupt` reaches the fleet."""
        with self._lock:
            self._loop, self._fleet = asyncio.get_running_loop(), fleet
            if self._interrupted:
                fleet.interrupt()

    def _pass_signals_to(self, fleet: Fleet) -> None:
        def interrupt(number: signal.Signals) -> None:
            leave_terminal()
            self.signal = number
            fleet.interrupt()

        for number in ending_signals():
            asyncio.get_running_loop().add_signal_handler(number, interrupt, number)

    def _break_off(self, error: str) -> Ending:
        """Report what ended the run, with paths that can be opened; the first such error is its cause."""
        self._watcher.on_error(error)
        self._error = self._error or as_seen_from(self.directory.path, error)
        return Ending.FAILED

    def _finish_tables(self) -> None:
        news = Every(NEWS_PERIOD_S)

        def tell(table: str, rows: int) -> None:
            if news.is_due():
                self._watcher.on_news(f"writes {table}.parquet: {rows} rows so far")

        finish_tables(self.directory.path, tell)

    def _begin(self, doing: str) -> None:
        self._doing = doing
        self._watcher.on_phase(doing)

    def _report(self, ending: Ending, sim_time_ns: int) -> dict[str, Any]:
        timing = self._ticks.timing(sim_time_ns)
        self._begin("writes its tables")
        try:
            self._finish_tables()
        except (OSError, ValueError, ImportError) as error:  # Arrow is loaded here, where memory may be short
            ending = self._break_off(f"its tables could not be written as Parquet: {error}")
        self._begin("sums up")
        summary = summarise(
            self.scenario, self.directory, timing, ending.value, self._unfinished, error=self._error
        )
        write_summary(summary, self.directory)
        if self.scenario.figure and summary["bins"] and ending not in UNJUDGED:
            self._begin("draws the figure")
            draw_figure_of(self.directory.path, self.scenario, summary)
        if self.scenario.mcap.write:
            self._begin("writes run.mcap")
            self._write_mcap()
        self._begin("packs its streams")
        self._pack_streams()
        return summary

    def _pack_streams(self) -> None:
        """Make the streams small; those that cannot be stay as they are, and are read so, too."""
        try:
            pack_streams(self.directory.path)
        except (OSError, ValueError) as error:
            self._watcher.on_error(f"streams could not be packed: {error}")

    def _write_mcap(self) -> None:
        """Write run.mcap; the run is none the worse if it cannot be: `lostlink export` may do it later."""
        from lostlink.export.mcap.export import MCAP_FILE, write_mcap  # not every command needs it

        news = Every(NEWS_PERIOD_S)

        def tell(share: float) -> None:
            if news.is_due():
                self._watcher.on_news(f"writes {MCAP_FILE}: {100 * share:.0f} %")

        try:
            write_mcap(self.directory.path, self.directory.path / MCAP_FILE, self.scenario.mcap, tell)
        except (OSError, ValueError) as error:
            again = f"`lostlink export {self.directory.path} --mcap` writes it"
            self._watcher.on_error(f"{MCAP_FILE} could not be written: {error}; {again}")


def _interrupted_late(number: int, _: object) -> None:
    """A signal while the run is summed up. That its terminal goes, which may be said twice, takes no summary away."""
    leave_terminal()
    if number != signal.SIGHUP:
        sys.exit(128 + number)
