"""A flight in the background of a test."""

from __future__ import annotations

import asyncio
import math
import shutil
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Any

from bridge.fleet.autopilots.dirs import NOT_SAID, AutopilotDirs
from bridge.fleet.course import Ending
from bridge.fleet.preflight.preflight import preflight
from bridge.fleet.preflight.slots import ATTEMPTS, at_free_ports
from bridge.record.on_disk import on_disk_before_ns
from bridge.record.tables.truth import TRUTH
from bridge.run.directory import RunDirectory
from bridge.scenario.model import Scenario
from lostlink.flight.flight import Flight, Watcher
from lostlink.flight.scripted import RunResult, ScenarioLike, read_like
from lostlink.flight.summary import expectation_lines
from lostlink.reading.run import Run, load_run
from lostlink.testing.views import NS_PER_S, Columns, Place, RecordedLink, RecordedNode

LOOK_S = 0.1
"""How often the record is looked at while a test waits, wall time. It decides when a test goes on, and no answer."""


WARNINGS = 10
"""So many warnings of a flight are told."""


class Warned(Watcher):
    """A watcher that keeps what a flight warns of while it goes on, the first few."""

    def __init__(self) -> None:
        self.texts: list[str] = []

    def on_warning(self, text: str) -> None:
        """Keep it."""
        if len(self.texts) < WARNINGS:
            self.texts.append(text)


class UaOfFlight(RecordedNode):
    """A node of a flight that may go on: what `RecordedNode` says, and waiting for it."""

    def __init__(self, flight: FleetFlight, node: str) -> None:
        super().__init__(flight.record, node, flight)
        self._flight = flight

    async def at(
        self,
        *,
        north_m: float | None = None,
        east_m: float | None = None,
        height_m: float | None = None,
        within_m: float = 5.0,
        after_s: float = 0.0,
        before_s: float = math.inf,
    ) -> float:
        """Wait until it is within ``within_m`` of a place; gives when that first was, in s of sim time.

        What is recorded then is as after `FleetFlight.at` of that time.

        Args:
            north_m: the place, from the fleet's origin; an axis that is not given does not matter.
            east_m: likewise.
            height_m: likewise.
            within_m: so near.
            after_s: not before this.
            before_s: not after this.

        Raises:
            AssertionError: it was not, by ``before_s`` or the end of the flight; the text says how near it came.
            ValueError: no place was given, ``within_m`` is no distance, or the flight ended without a record that can
                be read.
            OSError: likewise.
        """
        place = Place(north_m, east_m, height_m)
        if not within_m >= 0.0:
            raise ValueError(f"within_m = {within_m}: at least 0")
        while True:
            is_over, recorded_s = self._flight.is_over, self._flight.recorded_s()
            try:
                found_s = self.reaches(place, within_m, after_s, before_s)
                break
            except AssertionError:
                if is_over or recorded_s > before_s:
                    raise
            except (OSError, ValueError):  # not begun, or just now becoming Parquet
                if is_over:
                    raise
            await asyncio.sleep(LOOK_S)
        await self._flight.at(found_s)
        return found_s


class FleetFlight:
    """A flight that a test has started. Its answers come from the record, and so are the same for the same flight.

    Args:
        place: gives the flight at free ports, watched, and what holds these; called again if it cannot start there,
            since somebody took one of them.
        dirs: where real autopilots are, as far as that was said.

    Attributes:
        end_s: sim time at which answers end that name no end: how far the test has waited; no result hangs on how far
            the flight happened to be.
    """

    def __init__(self, place: Callable[[Watcher], tuple[Flight, ExitStack]], dirs: AutopilotDirs) -> None:
        self.end_s = 0.0
        self._place, self._warned = place, Warned()
        self._flight, self._held = place(self._warned)
        self._is_stopped = False
        self._summary: dict[str, Any] | None = None
        self._error: BaseException | None = None
        self._over = threading.Event()
        """What is waited for: an interrupted `Thread.join` may take the thread for ended."""
        threading.Thread(target=self._fly, args=(dirs,), name=f"fly {self.path.name}").start()

    def __repr__(self) -> str:
        """Short enough for what an assertion shows of it."""
        return f"<FleetFlight {self.path.name}: {self._told() if self.is_over else 'goes on'}>"

    def _fly(self, dirs: AutopilotDirs) -> None:
        try:
            for attempt in range(ATTEMPTS):
                if attempt:
                    self._move()
                with self._held:
                    self._summary = self._flight.fly(dirs, takes_signals=False)
                if not self._flight.has_no_ports:
                    return
        except BaseException as error:
            self._error = error
        finally:
            self._over.set()

    def _move(self) -> None:
        """Be elsewhere, in place of a flight that could not start."""
        shutil.rmtree(self.path)
        self._flight, self._held = self._place(self._warned)
        if self._is_stopped:
            self._flight.interrupt()

    @property
    def path(self) -> Path:
        """Its run directory."""
        return self._flight.directory.path

    @property
    def record(self) -> Run:
        """The record as it is now.

        Raises:
            NoRun: nothing was recorded yet.
        """
        return load_run(self.path)

    @property
    def is_over(self) -> bool:
        """Whether it has ended, and its record is complete."""
        return self._over.is_set()

    def recorded_s(self) -> float:
        """Sim time up to which the record has everything, s; below 0 before the first tick."""
        if self.is_over:
            return self._last_tick_s()
        return (on_disk_before_ns(self.path, self._flight.scenario) - 1) / NS_PER_S

    def _last_tick_s(self) -> float:
        """Sim time of the last tick of which there are true states, s; below 0 if there is none."""
        try:
            times_ns = self.record.columns(TRUTH.name, [TRUTH.tick])[TRUTH.tick]
        except (OSError, ValueError):  # not begun, or just now becoming Parquet
            return -1.0
        return float(times_ns[-1]) / NS_PER_S if len(times_ns) else -1.0

    async def begin(self) -> None:
        """Wait until true states of its first tick have been recorded.

        Raises:
            AssertionError: it ended before that; the text says how.
        """
        await self._until(0.0, self._last_tick_s)

    async def at(self, sim_time_s: float) -> None:
        """Wait until all tables and streams of the record have everything up to ``sim_time_s``.

        What they have of later times hangs on the machine. A packet without a fate yet has no row.

        Raises:
            AssertionError: it ended before that; the text says how.
        """
        await self._until(sim_time_s, self.recorded_s)
        self.has_waited_for(sim_time_s)

    async def _until(self, sim_time_s: float, found_s: Callable[[], float]) -> None:
        while True:
            is_over = self.is_over
            if found_s() >= sim_time_s:
                return
            if is_over:
                raise AssertionError(self._ended(sim_time_s))
            await asyncio.sleep(LOOK_S)

    def check_begun(self) -> None:
        """Of a flight that is over: see that a tick of it was recorded.

        Raises:
            AssertionError: none was; the text says why.
        """
        if self.recorded_s() < 0.0:
            raise AssertionError(self._ended(math.inf))

    def ended_before(self, sim_time_s: float) -> str:
        """How it ended, if its last tick does not hold until ``sim_time_s``; empty if it does, or it goes on."""
        if not self.is_over or sim_time_s < self.recorded_s() + 1.0 / self._flight.scenario.tick_rate_hz:
            return ""
        return self._ended(sim_time_s)

    def has_waited_for(self, sim_time_s: float) -> None:
        """The test has waited until then."""
        self.end_s = max(self.end_s, sim_time_s)

    def reach(self, sim_time_s: float) -> None:
        """Wait until the record goes up to ``sim_time_s``, or the flight is over."""
        while not self.is_over and self.recorded_s() < sim_time_s:
            time.sleep(LOOK_S)
        self.has_waited_for(sim_time_s)

    def columns(self, run: Run, table: str, columns: Sequence[str] | None = None) -> Columns:
        """Columns of a table; waits while it becomes Parquet.

        Raises:
            OSError, ValueError: it cannot be read.
        """
        while True:
            is_over = self.is_over
            try:
                return run.columns(table, columns)
            except (OSError, ValueError):
                if is_over:
                    raise
            time.sleep(LOOK_S)

    def ua(self, node: int | str) -> UaOfFlight:
        """One of its nodes.

        Raises:
            ValueError: there is none of that id.
        """
        return UaOfFlight(self, str(node))

    def link(self, tx: int | str, rx: int | str) -> RecordedLink:
        """The link from one node to another.

        Raises:
            ValueError: there is no such node.
        """
        return RecordedLink(self.record, str(tx), str(rx), self)

    async def end(self) -> RunResult:
        """Wait for its end; gives what came of it."""
        while True:
            if self.is_over:
                return self.result()
            await asyncio.sleep(LOOK_S)  # in no thread: an event loop that is interrupted would wait for it

    def result(self) -> RunResult:
        """What came of it, once it is over; waits for that.

        Raises:
            OSError, ValueError: its record could not be written.
        """
        self._over.wait()
        self.end_s = math.inf
        if self._error is not None:
            raise self._error
        assert self._summary is not None
        return RunResult(self.path, self._summary)

    def stop(self) -> None:
        """End it now, in order, and wait for that."""
        self._is_stopped = True
        self._flight.interrupt()
        self._over.wait()

    def lines(self) -> Iterator[str]:
        """Where its record is, how it ended, what it does not meet and warned of, seed and digest, for people."""
        yield f"{self.path}: {self._told() if self.is_over else 'goes on'}"
        yield from (f"  {line}" for line in self._unmet())
        yield from (f"  warning: {text}" for text in self._warnings())
        yield "  " + ", ".join(f"{name} {value}" for name, value in self._identity())
        yield from (f"  may not repeat: {why}" for why in self._may_not_repeat())

    def properties(self) -> Iterator[tuple[str, str]]:
        """Likewise by names, for reports that programs read."""
        yield "lostlink_run", str(self.path)
        if self.is_over:
            yield "lostlink_ending", self._told()
            yield from (("lostlink_expectation", line) for line in self._unmet())
            yield from (("lostlink_warning", text) for text in self._warnings())
            yield from ((f"lostlink_{name}", value) for name, value in self._identity())
            yield from (("lostlink_may_not_repeat", why) for why in self._may_not_repeat())

    def _identity(self) -> Iterator[tuple[str, str]]:
        """What it was flown with and, unless it was ended at any time, what tells whether another was the same."""
        yield "seed", str(self._flight.scenario.seed)
        if self._summary is not None and self._summary["ending"] != Ending.INTERRUPTED:
            yield "digest", str(self._summary["digest"])

    def _warnings(self) -> list[str]:
        """What it warned of, as while it goes on: an agent that holds it up, say."""
        told = [] if self._summary is None else self._summary["warnings"]
        return list(dict.fromkeys((*self._warned.texts, *told[:WARNINGS])))

    def _may_not_repeat(self) -> list[str]:
        return [] if self._summary is None else list(self._summary["may_not_repeat"])

    def _unmet(self) -> list[str]:
        """The expectations that were not met, with what was found."""
        lines = [] if self._summary is None else expectation_lines(self._summary)
        return [line for line in lines if not line.startswith("ok")]

    def _ended(self, wanted_s: float) -> str:
        before = f", before {wanted_s} s" if math.isfinite(wanted_s) else ""
        if self.recorded_s() < 0.0:
            return f"the flight ended before a tick of it was recorded: {self._told()}"
        return f"the flight ended at {self.recorded_s():.2f} s{before}: {self._told()}"

    def _told(self) -> str:
        if self._summary is None:
            return str(self._error)
        return f"{self._summary['ending']}; {self._summary['error'] or self._summary['verdict']}"


class Flights:
    """What the fixture `fleet` is: starts flights, and ends them with the test.

    Args:
        directory: where their runs are kept.
        dirs: where real autopilots are, as far as that was said.
    """

    def __init__(self, directory: Path, dirs: AutopilotDirs = NOT_SAID) -> None:
        self._directory, self._dirs = directory, dirs
        self._flights: list[FleetFlight] = []
        self._is_stopped = False

    def __repr__(self) -> str:
        return f"<Flights: {len(self._flights)} so far>"

    async def __call__(
        self,
        scenario: ScenarioLike,
        *,
        seed: int | None = None,
        duration_s: float | None = None,
        autopilot: str | None = None,
        changes: Mapping[str, Any] | None = None,
    ) -> FleetFlight:
        """Start a flight, as fast as the machine can, and wait until it is in the air's first tick.

        Args:
            scenario: a shipped scenario's name, a YAML file, its content as a mapping, or a `Scenario`.
            seed: in place of the scenario's, as are the next two.
            duration_s: longest sim time.
            autopilot: who flies.
            changes: further keys, dotted.

        Raises:
            ScenarioError: the scenario cannot be used.
            FleetError: the run could not start.
            AssertionError: it ended at once; the text says why.
        """
        flight = await asyncio.to_thread(
            self.start, scenario, seed=seed, duration_s=duration_s, autopilot=autopilot, changes=changes
        )
        await flight.begin()
        return flight

    def fly(self, scenario: ScenarioLike, **given: Any) -> FleetFlight:
        """Fly a scenario to its end, for a test that is not async; arguments and errors as of a call."""
        flight = self.start(scenario, **given)
        flight.result()
        flight.check_begun()
        return flight

    def start(
        self,
        scenario: ScenarioLike,
        *,
        seed: int | None = None,
        duration_s: float | None = None,
        autopilot: str | None = None,
        changes: Mapping[str, Any] | None = None,
    ) -> FleetFlight:
        """Start a flight, and go on at once; arguments and errors as of a call."""
        given = {"seed": seed, "duration_s": duration_s, "autopilot": autopilot, "speed": "max"}
        asked = {key: value for key, value in given.items() if value is not None} | dict(changes or {})
        resolved = read_like(scenario, {"figure": False} | asked)
        flight = FleetFlight(partial(self._placed, resolved), self._dirs)
        self._flights.append(flight)
        if self._is_stopped:  # by whoever did not wait until it was in the air
            flight.stop()
        return flight

    def _placed(self, scenario: Scenario, watcher: Watcher) -> tuple[Flight, ExitStack]:
        """A flight at free ports, watched, and what holds these."""
        with ExitStack() as held:
            placed = held.enter_context(at_free_ports(scenario))
            preflight(placed, self._dirs)
            run = RunDirectory.create(self._directory, placed.name)
            return Flight(placed, run, watcher), held.pop_all()

    def lines(self) -> Iterator[str]:
        """Of each flight, in their order, as `FleetFlight.lines` has it."""
        for flight in self._flights:
            yield from flight.lines()

    def properties(self) -> Iterator[tuple[str, str]]:
        """Of each flight, in their order, as `FleetFlight.properties` has it."""
        for flight in self._flights:
            yield from flight.properties()

    def stop(self) -> None:
        """End all that still fly, and what is only being started."""
        self._is_stopped = True
        for flight in self._flights:
            flight.stop()
