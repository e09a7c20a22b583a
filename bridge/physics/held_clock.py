"""Operators hold the clock of a running simulation, let it step, and set its speed."""

from __future__ import annotations

import logging
import math
import threading
from collections.abc import Callable
from typing import Protocol

from bridge.bus.clock_commands import ClockCommand, answer, read_command, refusal
from bridge.bus.keys import Keys
from bridge.bus.messages import Clock, Header
from bridge.bus.session import JSON, Query, Session, end_of_answers, refuse
from bridge.bus.session import answer as answer_query
from fdm.clock.status import check_speed

REMIND_S = 1.0
"""How often it is repeated that the clock is held, wall time: whoever joins meanwhile hears no tick."""
log = logging.getLogger("physics")


class Paced(Protocol):
    """What is held: an exchange of the flight dynamics. Its methods may be called from any thread."""

    def pause(self) -> None:
        """Hold sim time."""

    def resume(self) -> None:
        """End a pause."""

    def step(self, sim_ns: int) -> None:
        """While paused: let sim time go on by so much."""

    def set_speed(self, speed: float) -> None:
        """Aim at so much sim time per wall time."""


class HeldClock:
    """Answers ``clock/cmd/<verb>``, and reports on ``clock/pace`` what came of it.

    Args:
        session: of the flight dynamics.
        keys: of the run.
        paced: what is held.
        speed: aimed at now.
        tick_period_ns: how long a step is unless it says so.
        on_pace: called, besides ``clock/pace``, in any thread.
    """

    def __init__(
        self,
        session: Session,
        keys: Keys,
        paced: Paced,
        *,
        speed: float,
        tick_period_ns: int,
        on_pace: Callable[[Clock], object] = lambda _: None,
    ) -> None:
        self._on_pace = on_pace
        self._session, self._keys, self._paced = session, keys, paced
        self._speed, self._paused = speed, False
        self._tick_period_ns = tick_period_ns
        self._lock = threading.Lock()
        self._closed = threading.Event()
        self._reminder: threading.Thread | None = None
        self._sim_time_ns = 0
        """The latest tick."""
        self._stepping: list[tuple[int, Query]] = []
        """Who asked for steps, each with the tick that its step leads to."""
        session.serve(keys.clock_command("*"), self._asked)

    def ticked(self, sim_time_ns: int) -> None:
        """Take note of a tick that was published."""
        with self._lock:
            self._sim_time_ns = sim_time_ns
            self._answer_steps(sim_time_ns)

    def _asked(self, query: Query) -> None:
        verb = self._keys.last_chunk(str(query.key_expr))
        try:
            command = read_command(verb, query.payload.to_bytes() if query.payload else b"")
            with self._lock:
                self._do(command, query)
        except ValueError as mistake:
            _end(verb, query, is_told=refuse(query, refusal(mistake), JSON))

    def _do(self, command: ClockCommand, query: Query) -> None:
        match command.verb:
            case "pause":
                self._paced.pause()
                self._paused = True
                self._answer_steps()
            case "resume":
                self._paced.resume()
                self._paused = False
                self._answer_steps()
            case "step":
                self._step(command.number, query)
            case "speed" if command.number is not None:
                check_speed(command.number)
                self._paced.set_speed(command.number)
                self._speed = command.number
        if command.verb != "status":
            self._tell_of(command)
        if command.verb != "step":
            self._answer(command.verb, query)

    def _tell_of(self, command: ClockCommand) -> None:
        log.info("an operator asks for %s %s", command.verb, "" if command.number is None else command.number)
        self._tell()
        if self._paused and self._reminder is None:
            self._reminder = threading.Thread(target=self._remind, name="held clock", daemon=True)
            self._reminder.start()

    def _answer(self, verb: str, query: Query) -> None:
        content = answer(self._sim_time_ns, self._speed, paused=self._paused)
        _end(verb, query, is_told=answer_query(query, self._keys.clock_command(verb), content, JSON))

    def _answer_steps(self, until_ns: float = math.inf) -> None:
        """Answer whoever asked for a step that has led to its tick; all, if they are cut short."""
        over = [query for tick_ns, query in self._stepping if tick_ns <= until_ns]
        self._stepping = [each for each in self._stepping if each[0] > until_ns]
        for query in over:
            self._answer("step", query)

    def _tell(self) -> None:
        header = Header.at(self._sim_time_ns, "")
        clock = Clock(header, self._speed, 0.0, self._paused)
        self._session.put(self._keys.clock_pace, clock)
        self._on_pace(clock)

    def _remind(self) -> None:
        while not self._closed.wait(REMIND_S):
            with self._lock:
                if self._paused and not self._closed.is_set():
                    self._tell()

    def close(self) -> None:
        """Report nothing more."""
        self._closed.set()
        with self._lock:
            self._answer_steps()
        if self._reminder is not None:
            self._reminder.join()

    def _step(self, seconds: float | None, query: Query) -> None:
        """Go on by whole ticks: between two of them nothing would be seen."""
        if not self._paused:
            self._paced.pause()
            self._paused = True
        ticks = 1 if seconds is None else max(1, round(seconds * 1e9 / self._tick_period_ns))
        self._paced.step(ticks * self._tick_period_ns)
        begin_ns = max([self._sim_time_ns, *(tick_ns for tick_ns, _ in self._stepping)])
        self._stepping.append((begin_ns + ticks * self._tick_period_ns, query))


def _end(verb: str, query: Query, *, is_told: bool) -> None:
    """There will be no more replies."""
    if not is_told:
        log.warning("%s: whoever asked is gone", verb)
    end_of_answers(query)
