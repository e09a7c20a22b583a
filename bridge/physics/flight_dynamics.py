"""The flight dynamics of a run: every UA's airframe and sim time, with what they record. No bus."""

from __future__ import annotations

import queue
from collections.abc import Sequence
from typing import Protocol

from bridge.bus.messages import Clock, Header, Truth, Truths
from bridge.physics.truth_message import clock_message, ground_truth_message, truth_message
from bridge.record.events import Report
from bridge.record.on_disk import PHYSICS, note_on_disk
from bridge.record.tables.truth import TruthWriter
from bridge.run.directory import RunDirectory
from bridge.run.every import Every
from bridge.run.process import log_clock
from bridge.scenario.model import Scenario
from bridge.scenario.nodes import EmitterNode, GroundNode
from bridge.scenario.resolve.flight import (
    airframe_of,
    disturb_of,
    home_of,
    legacy_of,
    origin_of,
    px4_of,
    wind_of,
)
from bridge.scenario.resolve.ground_track import GroundTrack
from bridge.timeouts import FLUSH_PERIOD_S, START_S
from fdm.air.weather import in_weather
from fdm.clock.events import EventKind, UaEvent
from fdm.clock.pace import NEVER_NS
from fdm.clock.status import ClockStatus
from fdm.errors import ModelDivergedError
from fdm.exchange.aircraft_spec import AircraftSpec
from fdm.exchange.called import CalledAutopilot
from fdm.exchange.exchange import Exchange
from fdm.exchange.px4.watched import WHILE_IT_STARTS, WHY_NOT
from fdm.model.truth import TrueState
from fdm.workers.fleet_exchange import FleetExchange, open_exchange

_WHY_NOT = {
    EventKind.ABSENT: "was not waited for any longer: its autopilot sent no packet in time",
    EventKind.STALLED: "was let go: its autopilot did not answer in time",
    EventKind.SILENT: "was flown without answers: its autopilot gave none for long",
    EventKind.REFUSED: "was refused: its autopilot is not in lockstep",
    EventKind.RESTARTED: "booted anew: when its autopilot was there again is a matter of wall time",
    EventKind.RETURNED: "was taken back: when its autopilot answered again is a matter of wall time",
}


class Held(Protocol):
    """Called when the fleet is held at an instant; `FlownDynamics.release` lets it go on."""

    def exchange(self, sim_time_ns: int) -> None:
        """Between two ticks, for MAVLink alone."""

    def tick(self, clock: Clock, truths: Truths) -> None:
        """At a tick, with the true states of all nodes."""

    def warning(self, node: str, text: str, sim_time_ns: int) -> None:
        """At any time: what somebody must see."""


class FlownDynamics:
    """The flight dynamics of a run.

    Args:
        run: the run.
        report: of the process.
        held: called with ticks and exchanges, in the thread of `run`.
        autopilots: in the order of the scenario's UA, those that are called; none: all are served over UDP.

    Raises:
        FdmError: a port is taken, or a model cannot be loaded.
    """

    def __init__(
        self,
        run: RunDirectory,
        report: Report,
        held: Held,
        autopilots: Sequence[CalledAutopilot] = (),
    ) -> None:
        self._run, self._scenario = run.path, run.scenario
        self._origin = origin_of(self._scenario.origin)
        self._report, self._to = report, held
        self._table = TruthWriter(run.path, self._scenario.stations)
        placed: tuple[GroundNode | EmitterNode, ...] = (*self._scenario.ground, *self._scenario.emitters)
        self._ground = [(node.node, GroundTrack(self._scenario, node)) for node in placed]
        self._truths: list[TrueState] = []
        self._ended: set[int] = set()
        self._flush = Every(FLUSH_PERIOD_S)
        self.exchange = self._open(autopilots)
        self.run = self.exchange.run
        self._ahead = bool(self._scenario.lookahead_ticks)
        self._held_ns = -1
        self._closed: queue.SimpleQueue[int] = queue.SimpleQueue()

    def _open(self, autopilots: Sequence[CalledAutopilot]) -> Exchange | FleetExchange:
        scenario = self._scenario
        return open_exchange(
            [_spec(scenario, index) for index in range(len(scenario.ua))],
            workers=1 if autopilots else scenario.fdm.workers,
            called=autopilots,
            coupling=scenario.fdm.coupling,
            speed=scenario.speed_factor,
            tick_period_ns=scenario.exchange_period_ns,
            hold_ticks=True,
            placement="spread" if autopilots else scenario.fdm.placement,
            stall_timeout_s=scenario.fdm.stall_timeout_s,
            start_timeout_s=START_S,
            on_truth=lambda truth: self._truths.append(truth),
            on_tick=self._on_tick,
            on_event=self._on_event,
        )

    def stop(self) -> None:
        """End `run`; callable from a signal handler, as no lock is taken that `run` may hold."""
        self.exchange.stop()
        self._closed.put(NEVER_NS)

    def release(self, sim_time_ns: int) -> None:
        """An instant is closed: everybody has done all that they do at it. From any thread.

        Without lookahead the autopilots go on; with it they are on their way, and may come to the next instant.
        """
        if self._ahead:
            self._closed.put(sim_time_ns)
        else:
            self.exchange.release_tick(sim_time_ns)

    def exchanged(self, sim_time_ns: int) -> None:
        """With lookahead: MAVLink was exchanged with all autopilots, which go on from this instant. From any thread."""
        self.exchange.release_tick(sim_time_ns)

    def close(self) -> None:
        """Close sockets and files, and report counters."""
        for ua_id in self.exchange.ports:
            counters = self.exchange.counters(ua_id)
            self._report.set_counters({f"ua {ua_id} {name}": n for name, n in counters.items()})
            for name in WHY_NOT.keys() & counters.keys():
                self._report.may_not_repeat(f"UA {ua_id}: {WHY_NOT[name]}")
        for ua in self._scenario.ua:
            if self._scenario.autopilot_of(ua) == "px4":
                self._report.may_not_repeat(f"UA {ua.id}: {WHILE_IT_STARTS}")
        self.exchange.close()
        self._table.close()
        self._report.close()

    def _wait_for_the_one_before(self) -> bool:
        """With lookahead: the fleet may stand at an instant before the one before it is closed; False: it is over."""
        closed_ns = self._held_ns
        while self._held_ns >= 0 and (closed_ns := self._closed.get()) < self._held_ns:
            continue
        return closed_ns < NEVER_NS

    def _on_tick(self, status: ClockStatus) -> None:
        truths, self._truths = self._truths, []
        if self._ahead and not self._wait_for_the_one_before():
            return
        self._held_ns = status.sim_time_ns
        log_clock.now_ns = status.sim_time_ns
        if status.sim_time_ns % self._scenario.tick_period_ns:
            self._to.exchange(status.sim_time_ns)
            return
        batch = Truths(Header.at(status.sim_time_ns, ""), self._messages(status.sim_time_ns, truths))
        self._table.append(status.sim_time_ns, batch.truth)
        if self._flush.is_due():
            self._table.flush()
            self._report.flush()
            note_on_disk(self._run, PHYSICS, status.sim_time_ns + 1)
        self._to.tick(clock_message(status), batch)

    def _messages(self, tick_ns: int, truths: Sequence[TrueState]) -> tuple[Truth, ...]:
        """The true states of all nodes; those on the ground are where the scenario says."""
        flown = [truth_message(truth, self._origin) for truth in truths]
        placed = [ground_truth_message(node, track.at(tick_ns), tick_ns) for node, track in self._ground]
        return (*flown, *placed)

    def _on_event(self, event: UaEvent) -> None:
        node = str(event.ua_id)
        self._report.event(event.sim_time_ns, node, event.kind.value, event.detail)
        self._see_who_is_left(event)
        if event.kind is EventKind.STALLED:
            self._to.warning(node, f"UA {node}: {event.detail}", event.sim_time_ns)
        why = _WHY_NOT.get(event.kind)
        if event.kind is EventKind.JOINED and event.sim_time_ns > 0:
            why = "came late: when its autopilot was there is a matter of wall time"
        if why is not None:
            self._report.may_not_repeat(f"UA {node} {why} (at {event.sim_time_ns / 1e9:.2f} s)")

    def _see_who_is_left(self, event: UaEvent) -> None:
        """Without any UA there are no more ticks.

        Raises:
            ModelDivergedError: that of the last UA has just diverged.
        """
        if event.kind is not EventKind.DIVERGED:
            self._ended.discard(event.ua_id)
            return
        self._ended.add(event.ua_id)
        if len(self._ended) == len(self._scenario.ua):
            raise ModelDivergedError(f"no UA is left: UA {event.ua_id}: {event.detail}")


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
        px4_of(scenario, ua),
    )
