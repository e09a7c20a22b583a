"""A whole run in one process: physics, stand-ins, nodes, radio and record are called in the ring's order.

Physics flies in a thread of its own, as it waits for real autopilots; the event loop has everything else. While the
fleet is held at a tick the physics' thread sleeps, and while it flies the event loop does.
"""

from __future__ import annotations

import asyncio
import gc
import logging
import threading
from collections.abc import Callable, Coroutine, Sequence
from contextlib import AsyncExitStack, ExitStack, suppress
from math import isinf
from time import monotonic
from typing import Any

from bridge.agents.running.feed import Arrivals
from bridge.bus.messages import AgentStatus, AircraftState, Clock, Header, Message, Truths
from bridge.bus.session import Session
from bridge.host.arrivals import hand_out, hand_out_serial
from bridge.host.hosted import Hosted, hosted_node, stop_all
from bridge.physics.flight_dynamics import FlownDynamics
from bridge.program.beside import BesideBus
from bridge.program.idle_agents import IdleAgents
from bridge.program.outlets import CalledOutlet
from bridge.program.standins import standin_options
from bridge.radio.heard import Hosts
from bridge.radio.radio import RecordedRadio
from bridge.radio.ring import Closed
from bridge.record.events import Report
from bridge.record.logged import LoggedValue
from bridge.run.directory import RunDirectory
from bridge.run.every import Every
from bridge.run.garbage import look_rarely
from bridge.run.process import log_clock
from bridge.timeouts import FLUSH_PERIOD_S
from fdm.exchange.exchange import Exchange
from standin.called import CalledStandIn
from standin.cli import called_standins

NAME = "fleet"
"""Of the process, and of the one host in it."""
TELL_PERIOD_S = 0.05
"""Ticks are reported to the supervisor this often, wall time; of the last one in any case."""
GLANCE_PERIOD_S = 0.25
LOOK_S = 0.01
"""Physics in the event loop looks this often whether an operator has let it go on."""
IDLE_S = 5.0
"""After so long without a tick it is logged what is waited for."""
Tell = Callable[[str, Message], object]
Go = Callable[[], Coroutine[Any, Any, bool]]
"""Waits for the supervisor; whether it said go."""
log = logging.getLogger(NAME)


class Program:
    """All parts of a run; an event loop's task.

    Args:
        run: the run.
        tell: called, with a key of the run, with what a supervisor has to know.
        report: of the radio.
        session: of the run's router, if somebody may look or speak from outside.
        looks: whether ``tell`` is called with states and links now and then, too.
    """

    def __init__(
        self, run: RunDirectory, tell: Tell, report: Report, session: Session | None, *, looks: bool
    ) -> None:
        self._run, self._keys, self._tell = run, run.keys, tell
        self._nodes = run.scenario.transceiver_ids
        self._loop = asyncio.get_running_loop()
        self._idle = IdleAgents()
        self._over: asyncio.Future[None] = self._loop.create_future()
        self._radio = RecordedRadio(run, report)
        self._hosts = Hosts(self._nodes, {NAME: run.scenario.regulated})
        self._bus: BesideBus | None = None
        if session is not None:
            self._bus = BesideBus(session, run, self._radio, self._free_agent_said, self._fail)
        self._flush, self._told_at_s = Every(FLUSH_PERIOD_S), 0.0
        self._untold: Clock | None = None
        self._glance = {node: Every(GLANCE_PERIOD_S) for node in (*self._nodes, "") if looks}
        self._standins = _standins(run)
        self._outlets = {
            node: CalledOutlet(node, self._radio, self, self._answered) for node in run.scenario.regulated
        }
        self._arrivals: dict[str, Arrivals] = {}
        self._dynamics = FlownDynamics(
            run, Report(run.path, "physics"), _InTheLoop(self), list(self._standins.values())
        )
        self._hosted = Hosted((), self._dynamics.exchanged)
        self._thread = threading.Thread(target=self._fly, name="physics", daemon=True)
        self._called: asyncio.Task[None] | None = None
        self._moved = asyncio.Event()

    async def run(self, go: Go, stop: asyncio.Event) -> None:
        """Say that all is ready, fly from ``go`` until ``stop`` is set, then write what is left of the record.

        Raises:
            OutsideValidityError: a packet has no fate.
            Exception: whatever a part raises.
        """
        async with AsyncExitStack() as stack:
            stack.push_async_callback(self._end)
            if not await self._entered(stack, stop):
                return
            if self._bus is not None:
                self._bus.serve(self._hosted.nodes, self._dynamics.exchange, self._paced)
            gc.collect()
            gc.freeze()
            look_rarely()
            self._tell(self._keys.alive(NAME), Header())
            if await self._unless(stop, go()):
                self._begin()
                await self._until(stop)
            self._stop()

    def _begin(self) -> None:
        if self._needs_no_thread:
            self._called = asyncio.create_task(self._fly_called())
        else:
            self._thread.start()

    async def _until(self, stop: asyncio.Event) -> None:
        """Wait for the end; say what is waited for when nothing moves."""
        waiting: set[asyncio.Future[Any]] = {asyncio.ensure_future(stop.wait()), self._over}
        while True:
            before_ns = log_clock.now_ns
            done, _ = await asyncio.wait(waiting, timeout=IDLE_S, return_when=asyncio.FIRST_COMPLETED)
            if done:
                return
            if log_clock.now_ns == before_ns:
                self._tell_clock()
                self._radio.tell_what_is_waited_for()

    async def _entered(self, stack: AsyncExitStack, stop: asyncio.Event) -> bool:
        """Enter all nodes, unless ``stop`` comes first: an agent may take for ever to be built."""
        if await self._unless(stop, self._enter_nodes(stack)):
            return True
        stop_all(self._hosted.nodes)
        return False

    async def _unless(self, stop: asyncio.Event, work: Coroutine[Any, Any, bool]) -> bool:
        """Do ``work``, unless ``stop`` or a failure comes first; whether it was done, and went well."""
        doing, stopped = asyncio.ensure_future(work), asyncio.ensure_future(stop.wait())
        waiting: set[asyncio.Future[Any]] = {doing, stopped, self._over}
        await asyncio.wait(waiting, return_when=asyncio.FIRST_COMPLETED)
        stopped.cancel()
        if doing.done():
            return doing.result()
        doing.cancel()
        with suppress(asyncio.CancelledError):
            await doing
        return False

    async def _enter_nodes(self, stack: AsyncExitStack) -> bool:
        nodes = []
        for node, outlet in self._outlets.items():
            standin = self._standins.get(node)
            serials = {} if standin is None else standin.serials
            hosted = hosted_node(self._run, node, outlet, standin, serials)
            hosted.call_back = self._idle.put
            nodes.append(await stack.enter_async_context(hosted))
            self._arrivals[node] = hosted.node.arrivals
            self._hosted = Hosted(nodes, self._dynamics.exchanged)
        return True

    def _stop(self) -> None:
        """End agents and physics, and pass on what they said on their way out."""
        try:
            stop_all(self._hosted.nodes)
            for outlet in self._outlets.values():
                outlet.pass_on()
        finally:
            self._end_physics()

    def _end_physics(self) -> None:
        self._dynamics.stop()
        if self._called is not None:
            self._called.cancel()
        elif self._thread.is_alive():
            self._thread.join()

    async def _end(self) -> None:
        """Close everything, and write what is left of the record."""
        self._end_physics()
        failure = self._over.exception() if self._over.done() else None
        with ExitStack() as closing:  # each, whatever another raises
            dropped = 0 if self._bus is None else self._bus.dropped
            closing.callback(self._radio.finish, self._tell_progress, dropped)
            closing.callback(self._tell_clock)
            closing.callback(self._dynamics.close)
            if self._bus is not None:
                closing.callback(self._bus.close)
        if failure is not None:
            raise failure

    def _paced(self, clock: Clock) -> None:
        """An operator holds the clock, or lets it go."""
        with suppress(RuntimeError):  # the loop is closed: the run is over
            self._loop.call_soon_threadsafe(self._tell, self._keys.clock_pace, clock)

    def _tell_progress(self, share: float) -> None:
        text = f"writes its record: {100 * share:.0f} % of the distance bins"
        self._tell(self._keys.ending, Header.at(0, text))

    def _fail(self, error: BaseException) -> None:
        """Whatever a part raises ends the run."""
        if not self._over.done():
            self._over.set_exception(error)

    # Physics.

    @property
    def flies_in_the_loop(self) -> bool:
        """Whether physics has no thread of its own."""
        return self._called is not None

    @property
    def _needs_no_thread(self) -> bool:
        """Whether nobody waits for wall time: then a thread of its own would only have the caches of another core."""
        scenario = self._run.scenario
        return bool(self._standins) and isinf(scenario.speed_factor) and not scenario.lookahead_ticks

    async def _fly_called(self) -> None:
        """Fly from tick to tick in the event loop, which has its turn at each of them."""
        exchange = self._dynamics.exchange
        assert isinstance(exchange, Exchange)
        exchange.begin()
        try:
            while True:
                self._moved.clear()
                exchange.fly_called()
                await asyncio.sleep(0)  # in which the tick is worked on
                if not self._moved.is_set():
                    with suppress(TimeoutError):
                        await asyncio.wait_for(self._moved.wait(), LOOK_S)
        except Exception as error:
            self._fail(error)

    def _fly(self) -> None:
        try:
            self._dynamics.run()
        except BaseException as error:
            with suppress(RuntimeError):  # the loop is closed: the run is over
                self._loop.call_soon_threadsafe(self._fail, error)

    # The ring, in the event loop.

    def exchange(self, sim_time_ns: int) -> None:
        """The fleet is held between two ticks."""
        if self._bus is not None:
            self._bus.exchange(sim_time_ns)
        self._hosted.hold(sim_time_ns, is_tick=False)

    def tick(self, clock: Clock, truths: Truths) -> None:
        """The fleet is held at a tick."""
        sim_time_ns = clock.header.stamp.ns
        if self._bus is not None:
            self._bus.tick(clock, truths)
        self._radio.truths(truths.truth)
        self._radio.tick(sim_time_ns)
        self._untold = clock
        if monotonic() - self._told_at_s >= TELL_PERIOD_S:
            self._tell_clock()
        self._idle.wait(
            lambda: self._hosted.hold(sim_time_ns, is_tick=True, stalled=clock.stalled),
            lambda: sum(one.node.is_live for one in self._hosted.nodes),
        )

    def _tell_clock(self) -> None:
        clock, self._untold = self._untold, None
        if clock is not None:
            self._told_at_s = monotonic()
            self._tell(self._keys.clock, clock)

    def _answered(self, node: str, sim_time_ns: int) -> None:
        try:
            if self._bus is not None:
                self._bus.answered(node, sim_time_ns)
            closed = self._radio.answer(node, sim_time_ns)
            if closed is not None and not self._over.done():
                self._close(closed)
        except Exception as error:  # ours, and not the node's
            self._fail(error)

    def _close(self, closed: Closed) -> None:
        """Everybody is done with an instant."""
        if not closed.is_tick:
            if self._bus is not None:
                self._bus.released(closed.sim_time_ns)
            self._release(closed.sim_time_ns)
            return
        tick = self._radio.settle(closed.sim_time_ns)
        for share in self._hosts.shares(tick).values():
            networks = self._run.scenario.network_names
            hand_out(share, self._nodes, self._arrivals, networks)
            hand_out_serial(share, self._nodes, self._hosted.serial_came, networks)
        if self._bus is not None:
            self._bus.settled(tick, is_end=closed.is_end)
        if not closed.is_end:
            self._release(closed.sim_time_ns)
        if self._is_looked_at("", always=closed.is_end):
            self._tell(self._keys.tick("links"), self._radio.links(closed.sim_time_ns))
        self._radio.write(tick.settled)
        if self._flush.is_due():
            self._radio.flush()
        if closed.is_end:
            self._tell_clock()
            self._tell(self._keys.clock_end, Header.at(closed.sim_time_ns, ""))

    def _is_looked_at(self, what: str, *, always: bool = False) -> bool:
        """Whether it is time to report a node, or ("") of the links; always at the end, if ever."""
        return what in self._glance and (self._glance[what].is_due() or always)

    def _release(self, sim_time_ns: int) -> None:
        self._dynamics.release(sim_time_ns)
        self._moved.set()

    # What nodes say, besides to the radio (`bridge.program.outlets.Listeners`).

    def state(self, state: AircraftState) -> None:
        """Report it now and then."""
        node = state.header.frame_id
        if self._is_looked_at(node):
            self._tell(self._keys.state(node), state)
        if self._bus is not None:
            self._bus.state(state)

    def report(self, node: str, status: AgentStatus) -> None:
        """Report it."""
        self._tell(self._keys.agent(node), status)
        if self._bus is not None:
            self._bus.report(node, status)

    def warning(self, node: str, text: str, sim_time_ns: int) -> None:
        """Report it."""
        self._tell(self._keys.warning(node), Header.at(sim_time_ns, text))
        if self._bus is not None:
            self._bus.warning(node, text, sim_time_ns)

    def _free_agent_said(self, node: str, status: AgentStatus) -> None:
        self._radio.agent(node, status)
        self._tell(self._keys.agent(node), status)

    def logged(self, node: str, item: LoggedValue, sim_time_ns: int) -> None:
        """Publish it on the bus."""
        if self._bus is not None:
            self._bus.logged(node, item, sim_time_ns)


class _InTheLoop:
    """Passes what physics reports in its thread on to the event loop's."""

    def __init__(self, program: Program) -> None:
        self._program, self._loop = program, asyncio.get_running_loop()

    def exchange(self, sim_time_ns: int) -> None:
        self._call(self._program.exchange, sim_time_ns)

    def tick(self, clock: Clock, truths: Truths) -> None:
        self._call(self._program.tick, clock, truths)

    def warning(self, node: str, text: str, sim_time_ns: int) -> None:
        self._call(self._program.warning, node, text, sim_time_ns)

    def _call(self, callback: Callable[..., None], *arguments: object) -> None:
        if self._program.flies_in_the_loop:
            self._loop.call_soon(self._guarded, callback, arguments)
        else:
            self._loop.call_soon_threadsafe(self._guarded, callback, arguments)

    def _guarded(self, callback: Callable[..., None], arguments: Sequence[object]) -> None:
        try:
            callback(*arguments)
        except Exception as error:
            self._program._fail(error)


def _standins(run: RunDirectory) -> dict[str, CalledStandIn]:
    """The stand-ins of a run by their nodes; none if others fly."""
    scenario = run.scenario
    if scenario.autopilots != {"standin"}:
        return {}
    return {
        ua.node: standin
        for ua, standin in zip(
            scenario.ua, called_standins([standin_options(scenario, ua) for ua in scenario.ua]), strict=True
        )
    }
