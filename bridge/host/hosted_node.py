"""One node of a host: its record, its agent, and what comes for it."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import cached_property
from time import monotonic
from typing import TYPE_CHECKING, Any

from bridge.agents import agent_class
from bridge.agents.client import UaClient
from bridge.agents.frames import frames_of
from bridge.agents.outlet import HeldOutlet, NodeOutlet
from bridge.agents.running.runner import AgentRunner
from bridge.aircraft.body import Body
from bridge.bus.messages import AgentStatus, Header
from bridge.host.modem_port import ModemPort
from bridge.host.node import Node
from bridge.host.node_record import NodeRecord
from bridge.record.events import WHOSE, RunEvent
from bridge.record.inputs.fields import PACKET_MAX_BYTES, PacketWay
from bridge.record.on_disk import note_on_disk, part_of
from bridge.record.ways import whom
from bridge.run.directory import RunDirectory
from bridge.run.every import Every
from bridge.run.process import current_node
from bridge.scenario.agents import AgentConfig, FreeAgent
from bridge.scenario.nodes import Aircraft, GroundNode
from bridge.timeouts import BLOCKED_LOOK_S, FLUSH_PERIOD_S

if TYPE_CHECKING:
    from channel.sensing.sensor import Sensor

log = logging.getLogger("host")


class HostedNode:
    """One node that the clock waits for.

    Args:
        run: the run.
        config: the node as the scenario has it.
        record: of the node.
        body: its aircraft, or what it has in its place.
        outlet: where what it says goes.

    Attributes:
        ports: the serial sides of its modems, by radio.
        call_back: has something called in the event loop; the agent's thread calls it.
        on_exchanged: with lookahead, called when the aircraft may fly on from an instant.
        asks_dropped: how many commands found no room before they came to the node.
        packets_lost: the same of packets from outside.
    """

    def __init__(
        self,
        run: RunDirectory,
        config: Aircraft | GroundNode,
        record: NodeRecord,
        body: Body,
        outlet: NodeOutlet,
    ) -> None:
        self.id = config.node
        self._config, self._scenario = config, run.scenario
        self._run, self._part = run.path, part_of(run.scenario, config.node)
        self._loop = asyncio.get_running_loop()
        self._record = record
        self._agent_folder = run.agent_folder(config.node)
        self._outlet = outlet
        record.on_warning = self._warn
        self.asks_dropped: Callable[[], int] = lambda: 0
        self.packets_lost: Callable[[], int] = lambda: 0
        self.call_back: Callable[[Callable[[], object]], object] = self._loop.call_soon_threadsafe
        self.on_exchanged: Callable[[str], object] = lambda _: None
        self.node = Node(config.node, body, self._outlet, record)
        self.runner: AgentRunner | None = None
        self.ports: dict[str, ModemPort] = {}
        self._flush = Every(FLUSH_PERIOD_S)
        self._closed = False

    async def __aenter__(self) -> HostedNode:
        """Be ready for the first tick: the agent is built."""
        await self.start()
        return self

    async def __aexit__(self, *_: object) -> None:
        """Leave; `close` has written the record before."""

    async def start(self) -> None:
        """Build the agent."""
        if not isinstance(self._config.agent, FreeAgent):
            await self._start_agent(self._config.agent)
        if self._record.replay is not None:
            self.node.repeat([item for item in self._record.replay if item.kind != "serial"])
            for port in self.ports.values():
                port.repeat(self._record.replay)

    async def _start_agent(self, config: AgentConfig) -> None:
        held = HeldOutlet(self._outlet)
        self.runner = AgentRunner(
            UaClient(
                self.id,
                held,
                self._scenario.seed,
                self._agent_folder,
                reach=self._scenario.reach_of(self.id),
                sensor=self._sensor(),
                frames=frames_of(self._scenario, self.id),
                take_off_at_s=self._scenario.take_off_at_s,
            ),
            lambda client: agent_class(config, self.id)(client, self._config, self._scenario.transmit),
            lambda: self.call_back(self._agent_is_idle),
            self._record.warn,
        )
        self.node.join(self.runner, held)
        self._look_at_agent()
        await asyncio.wrap_future(self.runner.start())

    def _look_at_agent(self) -> None:
        """Tell of an agent that the run has been waiting for, and look again in a while."""
        if not self._closed:
            self._tell_if_blocked()
            self._loop.call_later(BLOCKED_LOOK_S, self._look_at_agent)

    def _tell_if_blocked(self) -> None:
        if self.runner is not None and (text := self.runner.blocked(monotonic())):
            with self._named():
                log.warning("the agent is slow: %s", text)
                self._record.agent_blocked(text)

    def _warn(self, event: RunEvent) -> None:
        """Tell whoever watches the run; from any thread."""
        title = self._scenario.title(event.node)
        self._outlet.warn(f"{WHOSE[event.kind]}{title}: {event.text}", event.sim_time_ns)

    def _sensor(self) -> Sensor | None:
        """What the agent knows of its node's RF sensor."""
        if self._config.sensor is None:
            return None
        from bridge.scenario.resolve.sensing import sensor_of  # few nodes have one, and it takes its time
        from channel.sensing.sensor import Sensor

        is_base = isinstance(self._config, GroundNode)
        return Sensor(sensor_of(self._config.sensor, self._scenario.origin), is_base=is_base)

    # From outside.

    def packet_came(self, way: PacketWay, payload: bytes) -> None:
        """Somebody outside has a packet for a radio of the node; what can go nowhere is dropped and counted."""
        if self._leads_somewhere(way) and 0 < len(payload) <= PACKET_MAX_BYTES:
            self.node.packet_came(way, payload)
        else:
            self.node.packets_dropped += 1

    @cached_property
    def _reach(self) -> dict[str, set[str]]:
        return whom(self._scenario, self.id)

    def _leads_somewhere(self, way: PacketWay) -> bool:
        return way.to in self._reach.get(way.radio, ())

    # Ticks.

    def hold(self, sim_time_ns: int, *, absent: bool = False) -> None:  # noqa: ARG002
        """The fleet is held at ``sim_time_ns``: a tick, or an exchange of MAVLink between two; `live` is to follow.

        With lookahead the autopilot is heard and spoken to here, so that it may fly on while this instant is worked on.

        Args:
            sim_time_ns: the instant.
            absent: physics does not wait for this UA's autopilot, which did not come in time.
        """
        self._record.now_ns = sim_time_ns
        if self._closed:
            return
        with self._named():
            if self._scenario.lookahead_ticks:
                self.node.body.swap()
            for port in self.ports.values():
                self._exchange_serial(port, sim_time_ns)
        if self._scenario.lookahead_ticks:
            self.on_exchanged(self.id)

    def _exchange_serial(self, port: ModemPort, sim_time_ns: int) -> None:
        """Give a modem what its host has sent, and the host what has come out of it by now."""
        sent = port.exchange(sim_time_ns)
        if sent:
            self._outlet.serial(port.radio, sent, sim_time_ns)

    def serial_came(self, radio: str, at_ns: int, data: bytes) -> None:
        """Bytes have come out of the modem at a radio, at an instant that is to come."""
        self.ports[radio].came(at_ns, data)

    def live(self, sim_time_ns: int, *, is_tick: bool) -> None:
        """Do what the node does at the instant at which the fleet is held."""
        self._live(sim_time_ns, is_tick)

    def _live(self, sim_time_ns: int, is_tick: bool) -> None:
        if self._closed:
            return
        with self._named():
            if is_tick:
                self.node.tick(sim_time_ns)
                self._flush_now_and_then(sim_time_ns)
            else:
                self.node.exchange(sim_time_ns)

    def _agent_is_idle(self) -> None:
        if self._closed:
            return
        with self._named():
            self.node.finish()

    def _flush_now_and_then(self, sim_time_ns: int) -> None:
        if self._flush.is_due():
            self.flush_record()
            note_on_disk(self._run, self._part, sim_time_ns)  # its agent may be at work on this tick

    def flush_record(self) -> None:
        """Hand what was recorded to the operating system."""
        self._record.flush()

    @contextmanager
    def _named(self) -> Iterator[None]:
        """What is logged within is of this node; what is raised ends the run, whose tick would stay open for ever."""
        token = current_node.set(self.id)
        try:
            yield
        except Exception as error:
            log.exception("node %s cannot go on", self.id)
            self._cannot_go_on(error)
        finally:
            current_node.reset(token)

    def _cannot_go_on(self, error: BaseException) -> None:
        """End the run: something that the node lives by is no more."""
        text = f"its aircraft bridge cannot go on: {error}"
        self._outlet.report(AgentStatus(Header.at(self._record.now_ns, self.id), text, failed=True))

    # The end.

    def statistics(self) -> Mapping[str, Any]:
        """Counters of what the node has beside its agent."""
        return {}

    def modem_counters(self) -> Mapping[str, int]:
        """Counters of what is at the serial sides of its modems, by name."""
        return {}

    def close(self) -> None:
        """Write what is left of the record."""
        self._tell_if_blocked()
        self._closed = True
        counters = {
            "messages_the_agent_could_not_read": 0 if self.runner is None else self.runner.ua.malformed,
            "commands_dropped": self.asks_dropped() + self.node.commands_dropped,
            "packets_from_outside_dropped": self.packets_lost() + self.node.packets_dropped,
            **self.modem_counters(),
        }
        self._record.close(self.statistics(), counters)
