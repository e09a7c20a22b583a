"""The bus beside a run of one process: who looks or speaks from outside finds there what a run of many has."""

from __future__ import annotations

import asyncio
import queue
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import TYPE_CHECKING

from bridge.agents.bus_outlet import BusOutlet
from bridge.bus.messages import AgentStatus, Clock, Header, Truths
from bridge.bus.session import Session
from bridge.host.hosted_node import HostedNode
from bridge.host.on_bus import AskedOnBus
from bridge.physics.held_clock import Paced
from bridge.physics.on_bus import ClockOnBus
from bridge.radio.radio import RecordedRadio, SettledTick
from bridge.radio.router.on_bus import RadioOnBus
from bridge.radio.router.publisher import TickPublisher
from bridge.run.directory import RunDirectory

if TYPE_CHECKING:
    from bridge.bus.messages import AircraftState
    from bridge.record.logged import LoggedValue


TAKEN_AT_ONCE = 500
"""Of what comes from outside; whoever sends without end keeps nobody else waiting."""


class BesideBus:
    """Publishes what the parts of a run do, and takes what free programs transmit.

    Args:
        session: the router's.
        run: the run.
        radio: of the run.
        on_agent: called with what a free program says of itself.
        fail: called with what is raised while something that came is handled.
    """

    def __init__(
        self,
        session: Session,
        run: RunDirectory,
        radio: RecordedRadio,
        on_agent: Callable[[str, AgentStatus], object],
        fail: Callable[[BaseException], object],
    ) -> None:
        self._session, self._run, self._keys = session, run, run.keys
        session.declare_alive(self._keys.alive("router"))
        self._clock = ClockOnBus(session, run)
        self._publisher = TickPublisher(session, run, radio)
        self._outlets = {node: BusOutlet(session, run.keys, node) for node in run.scenario.transceiver_ids}
        self._loop, self._is_awake, self._fail = asyncio.get_running_loop(), False, fail
        free = [each.node for each in run.scenario.transceivers if not each.has_agent]
        self._came = RadioOnBus(session, run, radio, free, on_agent, self._wake)

    @property
    def dropped(self) -> int:
        """How many packets of free programs found no room."""
        return self._came.intake.dropped

    def serve(self, hosted: Sequence[HostedNode], paced: Paced, on_pace: Callable[[Clock], object]) -> None:
        """Take operators' commands; ``on_pace`` is called, in any thread, when one holds the clock or lets it go."""
        self._clock.hold(paced, on_pace)
        for one in hosted:
            AskedOnBus(self._session, self._run, one)

    # What goes out.

    def exchange(self, sim_time_ns: int) -> None:
        """The fleet stands between two ticks."""
        self._clock.exchange(sim_time_ns)

    def tick(self, clock: Clock, truths: Truths) -> None:
        """The fleet stands at a tick."""
        self._clock.tick(clock, truths)

    def settled(self, tick: SettledTick, *, is_end: bool) -> None:
        """What became of it."""
        self._publisher.to_nodes(tick)
        self.released(tick.sim_time_ns, is_end=is_end)
        self._publisher.to_observers(tick, is_end=is_end)

    def released(self, sim_time_ns: int, *, is_end: bool = False) -> None:
        """Everybody is done with an instant."""
        key = self._keys.clock_end if is_end else self._keys.clock_release
        self._session.put(key, Header.at(sim_time_ns, ""), must_arrive=True)

    def state(self, state: AircraftState) -> None:
        """The aircraft's state."""
        self._outlets[state.header.frame_id].state(state)

    def answered(self, node: str, sim_time_ns: int) -> None:
        """The node is done with an instant: whoever is beside it has all that belongs to it."""
        self._outlets[node].answer(sim_time_ns)

    def report(self, node: str, status: AgentStatus) -> None:
        """What the node's agent is doing."""
        self._outlets[node].report(status)

    def warning(self, node: str, text: str, sim_time_ns: int) -> None:
        """What somebody must see of the node."""
        self._outlets[node].warn(text, sim_time_ns)

    def logged(self, node: str, item: LoggedValue, sim_time_ns: int) -> None:
        """A value that the node's agent logged."""
        self._outlets[node].log(item, sim_time_ns)

    def close(self) -> None:
        """Report nothing more."""
        self._clock.close()

    # What comes in.

    def _wake(self) -> None:
        if not self._is_awake:
            self._is_awake = True
            with suppress(RuntimeError):  # the loop is closed: the run is over
                self._loop.call_soon_threadsafe(self._take_all)

    def _take_all(self) -> None:
        self._is_awake = False
        try:
            for _ in range(TAKEN_AT_ONCE):
                item = self._came.intake.get(0.0)
                if item is None:
                    return
                self._came.handle(item)
            self._wake()  # the ring has its turn before the rest
        except queue.Empty:
            return
        except Exception as error:
            self._fail(error)
