"""The process of a host: aircraft bridges and agents of its UA, between Zenoh and the autopilots' MAVLink."""

from __future__ import annotations

import asyncio
import json
import logging
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import AsyncExitStack, contextmanager
from functools import partial
from time import monotonic

import zenoh

from aps.config import DaemonConfig
from aps.held import HeldDaemon
from bridge.agents import agent_class
from bridge.agents.client import UaClient
from bridge.agents.runner import AgentRunner
from bridge.aircraft.aircraft_bridge import AircraftBridge
from bridge.bus.inbox import Inbox
from bridge.bus.keys import Keys
from bridge.bus.messages import (
    AgentStatus,
    AircraftState,
    Clock,
    CommandEvent,
    CommandGoal,
    DecodeError,
    Header,
    decode,
    encode,
    encoding_of,
)
from bridge.bus.session import AGENT, Query, Sample, Session, Stamp, open_client
from bridge.host.node import AgentOutlet, Node, OnReply, Packet
from bridge.host.node_record import NodeRecord
from bridge.record.events import Report
from bridge.record.input_fields import VERBS
from bridge.run.directory import RunDirectory
from bridge.run.every import Every
from bridge.run.process import Arguments, current_node, parse_arguments, run_until_stopped
from bridge.scenario.model import Aircraft, Scenario
from bridge.timeouts import AGENT_END_S, FLUSH_PERIOD_S

ASKED_MAX = 1000
"""Operators' commands that may wait for a tick."""
log = logging.getLogger("host")

_Heard = tuple[Callable[[Sample], None], Sample]
"""Who handles what came."""


class ZenohOutlets:
    """What one node says, on Zenoh (`bridge.host.node.Outlets`)."""

    def __init__(self, session: Session, keys: Keys, node: str) -> None:
        self._session, self._keys, self._node = session, keys, node

    def transmit(self, channel: str, payload: bytes, encoding: str | None, stamp: Stamp) -> None:
        """Give a packet to the radio."""
        attachment = Stamp(stamp.seq, stamp.sim_time_ns, AGENT).to_bytes()
        self._session.put_bytes(
            self._keys.tx(self._node, channel),
            payload,
            encoding=encoding,
            attachment=attachment,
            must_arrive=True,
        )

    def report(self, status: AgentStatus) -> None:
        """Tell what the agent is doing."""
        self._session.put(self._keys.agent(self._node), status, must_arrive=True)

    def state(self, state: AircraftState) -> None:
        """Publish the aircraft's state."""
        self._session.put(self._keys.state(self._node), state)

    def answer(self, sim_time_ns: int) -> None:
        """Tell the radio that this node is done with a tick."""
        self._session.put(self._keys.answer(self._node), Header.at(sim_time_ns, self._node), must_arrive=True)


class HostedNode:
    """One node with its record, its daemon's connection, and its place on Zenoh."""

    def __init__(self, session: Session, run: RunDirectory, scenario: Scenario, ua: Aircraft) -> None:
        self._ua, self._scenario, self._session, self._keys = ua, scenario, session, run.keys
        self._run = run
        self._loop = asyncio.get_running_loop()
        self._record = NodeRecord(run, ua.node)
        self.daemon = HeldDaemon(
            DaemonConfig(
                autopilot=f"tcp:127.0.0.1:{scenario.autopilot_port(ua)}",
                sysid=ua.sysid,
                listen_port=scenario.aps_port(ua),
            )
        )
        self.api_port = scenario.api_port(ua) if scenario.api else None
        self._outlets = ZenohOutlets(session, run.keys, ua.node)
        self.node = Node(
            ua.node, AircraftBridge(self.daemon, ua.node), self._outlets, self._record.write_input
        )
        self.daemon.on_bytes = self._record.write_mavlink
        self.daemon.on_wall_time = self._record.may_not_repeat
        self.daemon.on_link_down = self._link_down
        self._connecting: asyncio.Task[None] | None = None
        self._flush = Every(FLUSH_PERIOD_S)
        self._malformed = 0
        self._closed = False

    async def start(self) -> None:
        """Build the agent, and subscribe."""
        node, outlet = self._ua.node, AgentOutlet(self._outlets)
        ua = UaClient(node, outlet, self._scenario.seed, self._run.agent_folder(node))
        make = agent_class(self._ua.agent)
        self.runner = AgentRunner(
            ua,
            lambda client: make(client, self._ua, self._scenario.transmit),
            lambda: self._loop.call_soon_threadsafe(self._agent_is_idle),
        )
        self.node.join(self.runner, outlet)
        if self._record.replay is not None:
            self.node.repeat(self._record.replay)
        await asyncio.wrap_future(self.runner.start())

    def serve(self, push: Callable[[Callable[[Sample], None], Sample], None]) -> None:
        """Hear of what comes for this node; ``push`` hands it to the event loop, in order."""
        node, keys = self._ua.node, self._keys
        self._session.subscribe(keys.rx(node, "*", "*"), partial(push, self._packet_came))
        self._session.subscribe(keys.comm_status(node), partial(push, self._comm_status_came))
        self._asked: Inbox[tuple[str, Query]] = Inbox(self._loop, self._asked_for, limit=ASKED_MAX)
        looked_at: Inbox[Query] = Inbox(self._loop, self._look, limit=ASKED_MAX)
        self._session.serve(keys.mavlink(node, "*"), looked_at.push)
        for verb in VERBS:
            self._session.serve(keys.command(node, verb), partial(self._push_asked, verb))

    def _push_asked(self, verb: str, query: Query) -> None:
        self._asked.push((verb, query))

    # Ticks.

    def clock_came(self, sim_time_ns: int, *, is_tick: bool, absent: bool = False) -> None:
        """The fleet stands at ``sim_time_ns``: a tick, or an exchange of MAVLink between two ticks.

        ``absent``: physics does not wait for this UA's autopilot, which did not come in time.
        """
        self._record.now_ns = sim_time_ns
        if sim_time_ns > 0 or self.daemon.link_up:
            self._live(sim_time_ns, is_tick)
        elif absent or self._scenario.fdm.scheme == "legacy":  # such a peer need not speak MAVLink at all
            self._connecting = asyncio.create_task(self._reconnect())
            self._live(sim_time_ns, is_tick)
        else:
            # The first frame of a UA is answered when its MAVLink is connected: its first bytes are in the ring, too.
            self._connecting = asyncio.create_task(self._connect_first())

    async def _connect_first(self) -> None:
        with self._named():
            await self.daemon.connect()
        self._live(0, True)

    async def _reconnect(self) -> None:
        with self._named():
            await self.daemon.connect()
            self._record.may_not_repeat("its MAVLink was connected during the run, when wall time let it")

    def _live(self, sim_time_ns: int, is_tick: bool) -> None:
        if self._closed:
            return
        with self._named():
            if is_tick:
                self.node.tick(sim_time_ns)
            else:
                self.node.exchange(sim_time_ns)

    def _agent_is_idle(self) -> None:
        if self._closed:
            return
        with self._named():
            self.node.finish()
            if self._flush.is_due():
                self._record.flush()

    @contextmanager
    def _named(self) -> Iterator[None]:
        """What is logged within is of this node; what is raised ends the run, whose tick would stay open for ever."""
        token = current_node.set(self._ua.node)
        try:
            yield
        except Exception as error:
            log.exception("the aircraft of UA %s cannot go on", self._ua.node)
            header = Header.at(self._record.now_ns, self._ua.node)
            text = f"its aircraft bridge cannot go on: {error}"
            self._outlets.report(AgentStatus(header, text, failed=True))
        finally:
            current_node.reset(token)

    def _link_down(self) -> None:
        """The autopilot closed its MAVLink (it reboots, or is gone): connect again as soon as it listens."""
        self._record.may_not_repeat("its autopilot closed its MAVLink connection")
        self._connecting = asyncio.create_task(self._reconnect())

    # What comes for the node.

    def _packet_came(self, sample: Sample) -> None:
        sender, channel = str(sample.key_expr).split("/")[-2:]
        stamp = Stamp.from_sample(sample)
        if stamp is None:
            self._malformed += 1
            return
        self.node.packet_came(Packet(sender, channel, sample.payload.to_bytes(), stamp))

    def _comm_status_came(self, sample: Sample) -> None:
        self.node.comm_status_came(sample.payload.to_bytes())

    def _asked_for(self, item: tuple[str, Query]) -> None:
        verb, query = item
        reply = self._replies(verb, query)
        try:
            goal = decode(query.payload.to_bytes(), CommandGoal) if query.payload else CommandGoal()
        except DecodeError as error:
            reply(CommandEvent(CommandEvent.RESULT, False, str(error)))
            return
        self.node.operator_asked(verb, goal, reply)

    def _look(self, query: Query) -> None:
        """The last MAVLink message of a type: nothing is asked of the autopilot, so nothing is recorded."""
        name = str(query.key_expr).rsplit("/", 1)[1]
        try:
            found = self.node.aircraft.last_message(name)
        except ValueError:
            found = None
        try:
            if found is not None:
                key = self._keys.mavlink(self._ua.node, name)
                query.reply(key, json.dumps(found).encode(), encoding="application/json")
            query.drop()
        except zenoh.ZError as error:
            log.warning("mavlink/%s: whoever asked is gone: %s", name, error)

    def _replies(self, verb: str, query: Query) -> OnReply:
        key = self._keys.command(self._ua.node, verb)

        def reply(event: CommandEvent) -> None:
            try:
                query.reply(key, encode(event), encoding=encoding_of(CommandEvent))
                if event.phase == CommandEvent.RESULT:
                    query.drop()
            except zenoh.ZError as error:
                log.warning("%s: whoever asked is gone: %s", verb, error)

        return reply

    # The end.

    def close(self) -> None:
        """Write what is left of the record."""
        self._closed = True
        if self._connecting is not None:
            self._connecting.cancel()
        counters = {
            "packets_without_stamp": self._malformed,
            "packets_the_agent_could_not_read": self.runner.ua.malformed,
            "commands_dropped": self._asked.dropped,
        }
        self._record.close(self.daemon.statistics(), counters)


async def run_host(run: RunDirectory, name: str, nodes: tuple[str, ...], stop: asyncio.Event) -> None:
    """Serve until ``stop`` is set."""
    scenario, keys = run.scenario, run.keys
    report = Report(run.path, name)
    with open_client(run.info.endpoint) as session:
        async with AsyncExitStack() as stack:
            hosted = [HostedNode(session, run, scenario, scenario.aircraft(node)) for node in nodes]
            for node, one in zip(nodes, hosted, strict=True):
                await _in_its_context(node, stack, one)
            inbox = _listen(session, keys, hosted, report)
            session.declare_alive(keys.alive(name))
            for one in hosted:
                log.info("MAVLink of UA %s at tcp:127.0.0.1:%d", one.node.node, one.daemon.listen_port)
            await stop.wait()
            stop_all(hosted)
            report.count("samples_whose_handling_failed", inbox.failed)
            report.close()


def stop_all(hosted: Sequence[HostedNode]) -> None:
    """End all agents together, and write what is left of every record, whatever an agent does on its way out."""
    for one in hosted:
        one.runner.ask_to_stop()
    until = monotonic() + AGENT_END_S
    for one in hosted:
        if not one.runner.join(until - monotonic()):
            log.warning("the agent of UA %s did not end", one.node.node)
    for one in hosted:
        one.close()


async def _in_its_context(node: str, stack: AsyncExitStack, one: HostedNode) -> None:
    """Start a node so that what its clients do is logged with its name."""
    token = current_node.set(node)
    try:
        await stack.enter_async_context(one.daemon)
        await one.start()
        if one.api_port is not None:
            from bridge.host.api import api_of  # FastAPI takes its time, and most runs do without

            await stack.enter_async_context(api_of(one.daemon, one.node, one.api_port))
            log.info("API of UA %s at http://127.0.0.1:%d", node, one.api_port)
    finally:
        current_node.reset(token)


def _listen(session: Session, keys: Keys, hosted: list[HostedNode], report: Report) -> Inbox[_Heard]:
    """Hand what comes on Zenoh to the event loop, in one order over all nodes and keys."""

    def dispatch(item: _Heard) -> None:
        handler, sample = item
        try:
            handler(sample)
        except DecodeError as error:
            report.count("malformed_samples")
            log.warning("%s: %s", sample.key_expr, error)

    def clock_came(sample: Sample) -> None:
        clock = decode(sample.payload.to_bytes(), Clock)
        for one in hosted:
            one.clock_came(clock.header.stamp.ns, is_tick=True, absent=one.node.node in clock.stalled)

    def exchange_came(sample: Sample) -> None:
        sim_time_ns = decode(sample.payload.to_bytes(), Header).stamp.ns
        for one in hosted:
            one.clock_came(sim_time_ns, is_tick=False)

    # Without a limit: what comes between two ticks is bounded by the ring, and a packet that was delivered stays so.
    inbox: Inbox[_Heard] = Inbox(asyncio.get_running_loop(), dispatch, limit=None)

    def push(handler: Callable[[Sample], None], sample: Sample) -> None:
        inbox.push((handler, sample))

    for one in hosted:
        one.serve(push)
    session.subscribe(keys.clock, partial(push, clock_came))
    session.subscribe(keys.clock_exchange, partial(push, exchange_came))
    return inbox


def main() -> int:
    """Run the process."""
    arguments: Arguments = parse_arguments("host", __doc__ or "", has_nodes=True)
    return run_until_stopped(lambda stop: run_host(arguments.run, arguments.name, arguments.nodes, stop))


if __name__ == "__main__":
    sys.exit(main())
