"""The flight dynamics process: hosts every UA's airframe, and keeps the fleet's time.

It begins to answer autopilots when the supervisor says that everybody is there (`clock/start`): an autopilot that runs
already (`autopilot: external`) must not fly through a tick that some agent has not heard of.
"""

from __future__ import annotations

import logging
import queue
import sys
from collections.abc import Sequence

from bridge.bus.messages import DecodeError, Header, Truths, decode
from bridge.bus.session import Sample, Session, open_client
from bridge.physics.held_clock import HeldClock
from bridge.physics.truth_message import clock_message, ground_truth_message, truth_message
from bridge.record.events import Report
from bridge.record.tables.truth import TruthWriter
from bridge.run.directory import RunDirectory
from bridge.run.every import Every
from bridge.run.process import exit_status, log_clock, on_stop_signal, parse_arguments
from bridge.scenario.model import Scenario
from bridge.scenario.nodes import Emitter, GroundNode
from bridge.scenario.resolve.flight import airframe_of, disturb_of, home_of, legacy_of, origin_of, wind_of
from bridge.scenario.resolve.ground_track import GroundTrack
from bridge.timeouts import FLUSH_PERIOD_S, START_S
from fdm.air.weather import in_weather
from fdm.clock.events import EventKind, UaEvent
from fdm.clock.status import ClockStatus
from fdm.errors import FdmError
from fdm.exchange.aircraft_spec import AircraftSpec
from fdm.exchange.exchange import Exchange
from fdm.model.truth import TrueState
from fdm.workers.fleet_exchange import FleetExchange, open_exchange

log = logging.getLogger("physics")

_BY_WALL_TIME = {
    EventKind.ABSENT: "was not waited for any longer: its autopilot sent no packet in time",
    EventKind.STALLED: "was let go: its autopilot did not answer in time",
    EventKind.RESTARTED: "booted anew: when its autopilot was there again is a matter of wall time",
    EventKind.RETURNED: "was taken back: when its autopilot answered again is a matter of wall time",
}


class Physics:
    """The flight dynamics of a run, with what they publish and record."""

    def __init__(self, session: Session, run: RunDirectory, report: Report) -> None:
        self._scenario, self._session, self._keys = run.scenario, session, run.keys
        self._origin = origin_of(self._scenario.origin)
        self._report = report
        stations = self._scenario.stations
        self._table = TruthWriter(run.path, stations)
        self._wanted = {node: session.interest(self._keys.truth(node)) for node in stations}
        placed: tuple[GroundNode | Emitter, ...] = (*self._scenario.ground, *self._scenario.emitters)
        self._ground = [(node.node, GroundTrack(self._scenario, node)) for node in placed]
        self._truths: list[TrueState] = []
        self._flush = Every(FLUSH_PERIOD_S)
        self._started: queue.SimpleQueue[None] = queue.SimpleQueue()
        self._stopped = False
        self.exchange = self._open()
        self._held = HeldClock(
            session,
            self._keys,
            self.exchange,
            speed=self._scenario.speed_factor,
            tick_period_ns=self._scenario.tick_period_ns,
        )
        session.subscribe(self._keys.clock_release, self._on_release)
        session.subscribe(self._keys.clock_start, lambda _: self._started.put(None))

    def _open(self) -> Exchange | FleetExchange:
        scenario = self._scenario
        return open_exchange(
            [self._spec(scenario, index) for index in range(len(scenario.ua))],
            workers=scenario.fdm.workers,
            coupling=scenario.fdm.coupling,
            speed=scenario.speed_factor,
            tick_period_ns=scenario.exchange_period_ns,
            hold_ticks=True,
            placement=scenario.fdm.placement,
            stall_timeout_s=scenario.fdm.stall_timeout_s,
            start_timeout_s=START_S,
            on_truth=lambda truth: self._truths.append(truth),
            on_tick=self._on_tick,
            on_event=self._on_event,
        )

    @staticmethod
    def _spec(scenario: Scenario, index: int) -> AircraftSpec:
        ua = scenario.ua[index]
        home = home_of(ua, scenario.origin)
        return AircraftSpec(
            ua.id,
            in_weather(airframe_of(ua), scenario.weather, home),
            home,
            scenario.fdm_port(ua),
            wind_of(scenario).build(seed=scenario.seed, ua_id=ua.id),
            disturb_of(scenario, ua),
            legacy_of(scenario, ua),
        )

    def run(self) -> None:
        """Serve autopilots from the supervisor's word on, until `stop`."""
        self._started.get()
        if not self._stopped:
            self.exchange.run()

    def stop(self) -> None:
        """End `run`; callable from a signal handler: the queue takes no lock that `run` may hold."""
        self._stopped = True
        self._started.put(None)
        self.exchange.stop()

    def close(self) -> None:
        """Close sockets and files."""
        self._held.close()
        self.exchange.close()
        self._table.close()

    def _on_tick(self, status: ClockStatus) -> None:
        truths, self._truths = self._truths, []
        log_clock.now_ns = status.sim_time_ns
        if status.sim_time_ns % self._scenario.tick_period_ns:
            header = Header.at(status.sim_time_ns, "")
            self._session.put(self._keys.clock_exchange, header, must_arrive=True)
            return
        self._held.sim_time_ns = status.sim_time_ns
        self._publish(status.sim_time_ns, truths)
        if self._flush.is_due():
            self._table.flush()
            self._report.flush()
        self._session.put(self._keys.clock, clock_message(status), must_arrive=True)

    def _publish(self, tick_ns: int, truths: Sequence[TrueState]) -> None:
        """Record and publish the true states of all nodes; those on the ground are where the scenario says."""
        messages = [truth_message(truth, self._origin) for truth in truths]
        messages += [ground_truth_message(node, track.at(tick_ns), tick_ns) for node, track in self._ground]
        self._table.append(tick_ns, messages)
        for message in messages:
            node = message.header.frame_id
            if self._wanted[node]():
                self._session.put(self._keys.truth(node), message)
        batch = Truths(Header.at(tick_ns, ""), tuple(messages))
        self._session.put(self._keys.tick("truths"), batch, must_arrive=True)

    def _on_event(self, event: UaEvent) -> None:
        node = str(event.ua_id)
        self._report.event(event.sim_time_ns, node, event.kind.value, event.detail)
        why = _BY_WALL_TIME.get(event.kind)
        if event.kind is EventKind.JOINED and event.sim_time_ns > 0:
            why = "came late: when its autopilot was there is a matter of wall time"
        if why is not None:
            self._report.may_not_repeat(f"UA {node} {why} (at {event.sim_time_ns / 1e9:.2f} s)")

    def _on_release(self, sample: Sample) -> None:
        try:
            self.exchange.release_tick(decode(sample.payload.to_bytes(), Header).stamp.ns)
        except DecodeError as error:
            log.warning("%s", error)


def serve(run: RunDirectory) -> None:
    """Host the run's UA until a signal ends it."""
    report = Report(run.path, "physics")
    with open_client(run.info.endpoint, run.credentials("physics"), timeout_s=START_S) as session:
        physics = Physics(session, run, report)
        on_stop_signal(physics.stop)
        session.declare_alive(run.keys.alive("physics"))
        log.info("serving UA on UDP ports %s", physics.exchange.ports)
        try:
            physics.run()
        finally:
            for ua_id in physics.exchange.ports:
                counters = physics.exchange.counters(ua_id)
                report.set_counters({f"ua {ua_id} {name}": n for name, n in counters.items()})
            physics.close()
            report.close()


def main() -> int:
    """Run the process."""
    arguments = parse_arguments("physics", __doc__ or "")
    try:
        return exit_status(lambda: serve(arguments.run))
    except FdmError as error:
        log.error("%s", error)
        return 1


if __name__ == "__main__":
    sys.exit(main())
