"""The router process: Zenoh's router and, in its session, the virtual radio."""

from __future__ import annotations

import logging
import queue
import sys
from collections.abc import Iterable, Sequence
from functools import partial

from bridge.bus.identity.logins import LoginWatch
from bridge.bus.keys import Keys
from bridge.bus.messages import Clock, Header, RadioSwitch, Truths, decode
from bridge.bus.session import STUCK_READER_S, Sample, Session, Stamp, open_router
from bridge.radio.heard import Hosts
from bridge.radio.radio import REFUSALS_LOGGED_MAX, RecordedRadio
from bridge.radio.router.intake import Handler
from bridge.radio.router.on_bus import RadioOnBus
from bridge.radio.router.publisher import TickPublisher
from bridge.record.events import Report
from bridge.run.directory import RunDirectory
from bridge.run.every import Every
from bridge.run.process import exit_status, log_clock, on_stop_signal, parse_arguments
from bridge.timeouts import FLUSH_PERIOD_S

IDLE_S = 5.0
log = logging.getLogger("router")


class RouterProcess:
    """Moves samples between Zenoh and the radio, in one thread and in the order in which they came."""

    def __init__(self, session: Session, run: RunDirectory, report: Report) -> None:
        self._keys: Keys = run.keys
        self._session = session
        self._radio = RecordedRadio(run, report)
        self._publisher = TickPublisher(session, run, self._radio)
        self._hosts = Hosts(run.scenario.transceiver_ids, run.info.hosts)
        self._came = RadioOnBus(session, run, self._radio, ["*"], self._radio.agent)
        for key_expr, handler in self._handlers():
            session.subscribe(key_expr, partial(self._came.intake.push, handler, may_drop=False))

    def _handlers(self) -> Iterable[tuple[str, Handler]]:
        yield self._keys.tick("truths"), self._on_truths
        yield self._keys.radio("*"), self._on_switch
        yield self._keys.serial("*", "*"), self._on_serial
        yield self._keys.answer("*"), self._on_answer
        yield self._keys.clock, self._on_clock

    def stop(self) -> None:
        """End `run`; callable from a signal handler."""
        self._came.intake.end()

    def run(self) -> None:
        """Serve until `stop`, then write what is left of the record, however long that takes."""
        try:
            self._serve()
        except BaseException:
            self._radio.finish(self._tell_progress, self._came.intake.dropped)
            raise
        self._radio.finish(self._tell_progress, self._came.intake.dropped)

    def _tell_progress(self, share: float) -> None:
        """Report to the supervisor, which waits as long as it hears of progress."""
        header = Header.at(0, f"writes its record: {100 * share:.0f} % of the distance bins")
        self._session.put(self._keys.ending, header, must_arrive=True)

    def _serve(self) -> None:
        flush, idle_s = Every(FLUSH_PERIOD_S), 0.0
        while True:
            try:
                item = self._came.intake.get(FLUSH_PERIOD_S)
                if item is None:
                    return
                self._came.handle(item)
                idle_s = 0.0
            except queue.Empty:
                idle_s += FLUSH_PERIOD_S
                if idle_s == IDLE_S:
                    self._radio.tell_what_is_waited_for()
            if flush.is_due():
                self._radio.flush()

    # What comes.

    def _on_truths(self, _key: str, sample: Sample) -> None:
        self._radio.truths(decode(sample.payload.to_bytes(), Truths).truth)

    def _on_clock(self, _key: str, sample: Sample) -> None:
        log_clock.now_ns = decode(sample.payload.to_bytes(), Clock).header.stamp.ns
        self._radio.tick(log_clock.now_ns)

    def _on_switch(self, key: str, sample: Sample) -> None:
        switch = decode(sample.payload.to_bytes(), RadioSwitch)
        self._radio.switch(self._keys.node_of(key), switch.header.stamp.ns, on=switch.on)

    def _on_serial(self, key: str, sample: Sample) -> None:
        stamp, radio = Stamp.from_sample(sample), self._keys.last_chunk(key)
        if stamp is None:
            self._radio.tell_refusal(f"{key}: serial bytes without their instant")
            return
        self._radio.serial(self._keys.node_of(key), radio, sample.payload.to_bytes(), stamp.sim_time_ns)

    def _on_answer(self, key: str, sample: Sample) -> None:
        sim_time_ns = decode(sample.payload.to_bytes(), Header).stamp.ns
        closed = self._radio.answer(self._keys.node_of(key), sim_time_ns)
        if closed is None:
            return
        header = Header.at(closed.sim_time_ns, "")
        if not closed.is_tick:
            self._session.put(self._keys.clock_release, header, must_arrive=True)
            return
        tick = self._radio.settle(closed.sim_time_ns)
        for host, share in self._hosts.shares(tick).items():
            self._session.put(self._keys.heard(host), share, must_arrive=True)
        self._publisher.to_nodes(tick)
        release = self._keys.clock_end if closed.is_end else self._keys.clock_release
        self._session.put(release, header, must_arrive=True)
        self._publisher.to_observers(tick, is_end=closed.is_end)
        self._radio.write(tick.settled)


def login_refused(report: Report, reason: str, number: int) -> None:
    """Count a login that the router refused, and log the first ones."""
    report.count(f"logins_refused_{reason}")
    if number <= REFUSALS_LOGGED_MAX:
        log.warning("refused a login (%s)", reason)


def reader_cut_off(report: Report, number: int) -> None:
    """Count a reader that the router has cut off, and log the first ones."""
    report.count("readers_cut_off")
    if number <= REFUSALS_LOGGED_MAX:
        log.warning("cut off a reader whose queue was full for %g s: it lost samples", STUCK_READER_S)


def login_watch(report: Report) -> LoginWatch:
    """What Zenoh says of logins and readers is counted as long as it is entered."""
    return LoginWatch(partial(login_refused, report), partial(reader_cut_off, report))


def serve(run: RunDirectory) -> None:
    """Route for the run until a signal ends it."""
    report = Report(run.path, "router")
    with login_watch(report), open_router(run.info.endpoint, run.guard) as session:
        process = RouterProcess(session, run, report)
        on_stop_signal(process.stop)
        session.declare_alive(run.keys.alive("router"))
        log.info("routing run %s at %s", run.info.run, run.info.endpoint)
        process.run()


def main(words: Sequence[str] | None = None) -> int:
    """Run the process, with the words of its command line."""
    arguments = parse_arguments(words, "router", __doc__ or "")
    return exit_status(lambda: serve(arguments.run))


if __name__ == "__main__":
    sys.exit(main())
