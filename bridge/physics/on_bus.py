"""The flight dynamics on the bus: truth and clock go out, releases come in, operators hold the clock."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable

from bridge.bus.messages import Clock, DecodeError, Header, Truths, decode
from bridge.bus.session import Sample, Session
from bridge.physics.held_clock import HeldClock, Paced
from bridge.run.directory import RunDirectory

log = logging.getLogger("physics")


class ClockOnBus:
    """Publishes the instants at which the fleet is held (`bridge.physics.flight_dynamics.Held`).

    Args:
        session: of the flight dynamics.
        run: the run.
    """

    def __init__(self, session: Session, run: RunDirectory) -> None:
        self._session, self._run, self._keys, self._scenario = session, run, run.keys, run.scenario
        stations = self._scenario.stations
        self._wanted = {node: session.interest(self._keys.truth(node)) for node in stations}
        self._clock: HeldClock | None = None

    def hold(self, paced: Paced, on_pace: Callable[[Clock], object] = lambda _: None) -> None:
        """Let operators hold the clock; ``on_pace`` is called, in any thread."""
        scenario = self._scenario
        self._clock = HeldClock(
            self._session,
            self._keys,
            paced,
            speed=scenario.speed_factor,
            tick_period_ns=scenario.tick_period_ns,
            on_pace=on_pace,
        )

    def listen(self, release: Callable[[int], object]) -> None:
        """Call ``release`` with each instant that the radio has closed."""

        def on_release(sample: Sample) -> None:
            try:
                release(decode(sample.payload.to_bytes(), Header).stamp.ns)
            except DecodeError as error:
                log.warning("%s", error)

        self._session.subscribe(self._keys.clock_release, on_release)

    def listen_to_hosts(self, exchanged: Callable[[int], object]) -> None:
        """With lookahead: call ``exchanged`` with each instant from which the autopilots of all hosts may fly on."""
        missing: dict[int, set[str]] = {}
        lock = threading.Lock()

        def on_exchanged(sample: Sample) -> None:
            host = str(sample.key_expr).split("/")[-2]
            try:
                sim_time_ns = decode(sample.payload.to_bytes(), Header).stamp.ns
            except DecodeError as error:
                log.warning("%s", error)
                return
            with lock:
                left = missing.setdefault(sim_time_ns, set(self._run.info.hosts))
                left.discard(host)
                if not left:
                    del missing[sim_time_ns]
                    exchanged(sim_time_ns)

        self._session.subscribe(self._keys.exchanged("*"), on_exchanged)

    def exchange(self, sim_time_ns: int) -> None:
        """Publish it."""
        self._session.put(self._keys.clock_exchange, Header.at(sim_time_ns, ""), must_arrive=True)

    def tick(self, clock: Clock, truths: Truths) -> None:
        """Publish it: the true states first."""
        for message in truths.truth:
            node = message.header.frame_id
            if self._wanted[node]():
                self._session.put(self._keys.truth(node), message)
        self._session.put(self._keys.tick("truths"), truths, must_arrive=True)
        self._session.put(self._keys.clock, clock, must_arrive=True)
        if self._clock is not None:
            self._clock.ticked(clock.header.stamp.ns)

    def warning(self, node: str, text: str, sim_time_ns: int) -> None:
        """Publish it; it waits for nobody, and the record has it anyway."""
        self._session.put(self._keys.warning(node), Header.at(sim_time_ns, text))

    def close(self) -> None:
        """Report nothing more."""
        if self._clock is not None:
            self._clock.close()
