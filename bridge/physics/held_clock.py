"""Operators hold the clock of a running simulation, let it step, and set its speed."""

from __future__ import annotations

import logging
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
        self.sim_time_ns = 0
        """The latest tick."""
        session.serve(keys.clock_command("*"), self._asked)

    def _asked(self, query: Query) -> None:
        verb, error = self._keys.last_chunk(str(query.key_expr)), None
        key = self._keys.clock_command(verb)
        try:
            self._do(read_command(verb, query.payload.to_bytes() if query.payload else b""))
        except ValueError as mistake:
            error = refusal(mistake)
        if error is None:
            told = answer_query(query, key, answer(self.sim_time_ns, self._speed, paused=self._paused), JSON)
        else:
            told = refuse(query, error, JSON)
        if not told:
            log.warning("%s: whoever asked is gone", verb)
        end_of_answers(query)

    def _do(self, command: ClockCommand) -> None:
        if command.verb == "status":
            return
        with self._lock:
            match command.verb:
                case "pause":
                    self._paced.pause()
                    self._paused = True
                case "resume":
                    self._paced.resume()
                    self._paused = False
                case "step":
                    self._step(command.number)
                case "speed" if command.number is not None:
                    check_speed(command.number)
                    self._paced.set_speed(command.number)
                    self._speed = command.number
            log.info(
                "an operator asks for %s %s", command.verb, "" if command.number is None else command.number
            )
            self._tell()
            if self._paused and self._reminder is None:
                self._reminder = threading.Thread(target=self._remind, name="held clock", daemon=True)
                self._reminder.start()

    def _tell(self) -> None:
        header = Header.at(self.sim_time_ns, "")
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
        if self._reminder is not None:
            self._reminder.join()

    def _step(self, seconds: float | None) -> None:
        """Go on by whole ticks: between two of them nothing would be seen."""
        if not self._paused:
            self._paced.pause()
            self._paused = True
        ticks = 1 if seconds is None else max(1, round(seconds * 1e9 / self._tick_period_ns))
        self._paced.step(ticks * self._tick_period_ns)
