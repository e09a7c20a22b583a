"""The bus beside a run of one process: who looks or speaks from outside finds there what a run of many has."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

from bridge.agents.bus_outlet import BusOutlet
from bridge.bus.inbox import Inbox
from bridge.bus.keys import KeyMistake
from bridge.bus.messages import AgentStatus, Clock, DecodeError, Header, Truths, decode
from bridge.bus.session import Sample, Session, Stamp
from bridge.host.hosted_node import HostedNode
from bridge.host.on_bus import AskedOnBus
from bridge.physics.held_clock import Paced
from bridge.physics.on_bus import ClockOnBus
from bridge.radio.intake import Handler
from bridge.radio.next_packet import NextPacket
from bridge.radio.publisher import TickPublisher
from bridge.radio.radio import RecordedRadio, SettledTick
from bridge.radio.senders import Refused
from bridge.run.directory import RunDirectory

if TYPE_CHECKING:
    from bridge.bus.messages import AircraftState
    from bridge.record.logged import LoggedValue


class BesideBus:
    """Publishes what the parts of a run do, and takes what free programs transmit.

    Args:
        session: the router's.
        run: the run.
        radio: of the run.
        on_agent: told what a free program says of itself.
    """

    def __init__(
        self,
        session: Session,
        run: RunDirectory,
        radio: RecordedRadio,
        on_agent: Callable[[str, AgentStatus], object],
    ) -> None:
        self._on_agent = on_agent
        self._session, self._run, self._keys, self._radio = session, run, run.keys, radio
        session.declare_alive(self._keys.alive("router"))
        self._clock = ClockOnBus(session, run)
        self._publisher = TickPublisher(session, run, radio)
        self._outlets = {node: BusOutlet(session, run.keys, node) for node in run.scenario.transceiver_ids}
        inbox: Inbox[tuple[Handler, Any]] = Inbox(asyncio.get_running_loop(), self._take, limit=None)

        def push(handler: Handler, came: Any) -> None:
            inbox.push((handler, came))

        NextPacket(self._keys, radio.core).serve(session, run.scenario, push)
        for node in (each.node for each in run.scenario.transceivers if not each.has_agent):
            for key, handler in (
                (self._keys.tx(node, "*", to="*", radio="*"), self._packet_came),
                (self._keys.agent(node), self._agent_came),
            ):
                session.subscribe(key, partial(push, handler))

    def serve(self, hosted: Sequence[HostedNode], paced: Paced, on_pace: Callable[[Clock], object]) -> None:
        """Take operators' commands; ``on_pace`` is told, in any thread, when one holds the clock or lets it go."""
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
        key = self._keys.clock_end if is_end else self._keys.clock_release
        self._session.put(key, Header.at(tick.sim_time_ns, ""), must_arrive=True)
        self._publisher.to_observers(tick, is_end=is_end)

    def state(self, state: AircraftState) -> None:
        """The aircraft's state."""
        self._outlets[state.header.frame_id].state(state)

    def answered(self, node: str, sim_time_ns: int) -> None:
        """The node is done with an instant: whoever is beside it has all that belongs to it."""
        self._outlets[node].answer(sim_time_ns)

    def report(self, node: str, status: AgentStatus) -> None:
        """What the node's agent is doing."""
        self._outlets[node].report(status)

    def logged(self, node: str, item: LoggedValue, sim_time_ns: int) -> None:
        """A value that the node's agent logged."""
        self._outlets[node].log(item, sim_time_ns)

    def close(self) -> None:
        """Tell no more."""
        self._clock.close()

    # What comes in.

    def _take(self, item: tuple[Handler, Any]) -> None:
        handler, came = item
        try:
            handler(str(came.key_expr), came)
        except (DecodeError, KeyMistake) as error:
            self._radio.core.refused[Refused.MALFORMED] += 1
            self._radio.tell_refusal(f"{came.key_expr}: {error}")

    def _packet_came(self, key: str, sample: Sample) -> None:
        address, payload = self._keys.address_of(key), sample.payload.to_bytes()
        if not self._radio.packet(address, payload, str(sample.encoding), Stamp.from_sample(sample)):
            self._radio.tell_refusal(f"a packet on {key}")

    def _agent_came(self, key: str, sample: Sample) -> None:
        self._on_agent(self._keys.node_of(key), decode(sample.payload.to_bytes(), AgentStatus))
