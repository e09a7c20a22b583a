"""The order in which things happen on board at a tick, between a real daemon's socket and a real agent's thread."""

from __future__ import annotations

import asyncio
import socket
import threading
from collections.abc import AsyncIterator, Callable

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from aps.config import DaemonConfig
from aps.held import HeldDaemon
from bridge.agents.agent import Agent
from bridge.agents.client import LookAtStatus, UaClient
from bridge.agents.outlet import HeldOutlet
from bridge.agents.running.feed import DeliveredPacket
from bridge.agents.running.runner import AgentRunner
from bridge.aircraft.aircraft_bridge import AircraftBridge, OnEvent
from bridge.bus.messages import (
    AgentStatus,
    AircraftState,
    CommandEvent,
    CommandGoal,
    CommunicationStatus,
    DecodeError,
)
from bridge.bus.radio_command import radio_goal
from bridge.bus.reception import Reception
from bridge.bus.session import Stamp
from bridge.host.node import ENTERING_MAX, ENTERING_MAX_BYTES, Node
from bridge.record.inputs.file import PacketWay, RecordedInput
from bridge.record.logged import LoggedValue
from bridge.scenario.agents import StillAgent
from bridge.scenario.nodes import Aircraft
from bridge.scenario.sections import Transmit

MS = 1_000_000
TICK_NS = 50 * MS
WAIT_S = 10.0
SYSID = 1
GCS, DAEMON = 255, 191
"""System id of a ground station; component id of the daemon."""
SET_MODE, ARM, INTERVAL = 176, 400, 511
LOITER, RTL, GUIDED = 5, 6, 4


class Autopilot:
    """The far end of the daemon's connection: says what the test says, and keeps what it hears."""

    def __init__(self) -> None:
        self._server = socket.create_server(("127.0.0.1", 0))
        self.port = self._server.getsockname()[1]
        self._mav = mavlink.MAVLink(None, srcSystem=SYSID, srcComponent=1)
        self._parser = mavlink.MAVLink(None)

    def accept(self) -> None:
        self._socket, _ = self._server.accept()
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._socket.setblocking(False)

    def say(self, *messages: mavlink.MAVLink_message) -> None:
        self._socket.sendall(b"".join(message.pack(self._mav) for message in messages))

    def commands(self) -> list[tuple[int, int, int]]:
        """Who sent which command with which number (a mode, or whether to arm) since the last call."""
        try:
            data = self._socket.recv(1 << 16)
        except BlockingIOError:
            return []
        heard = [m for m in self._parser.parse_buffer(data) or [] if m.get_type() == "COMMAND_LONG"]
        return [
            (m.get_srcSystem(), m.command, int(m.param2 if m.command == SET_MODE else m.param1))
            for m in heard
            if m.command != INTERVAL
        ]

    def close(self) -> None:
        self._server.close()
        self._socket.close()


class Host:
    """A node with its agent, and what happened on board, in order. It is the node's outlet, too.

    Attributes:
        happened: what happened since it was last taken.
        states: instants at which the state was published (while the agent runs).
        orders: what the agent does at ticks, by sim time.
    """

    def __init__(self, autopilot: Autopilot) -> None:
        self.autopilot = autopilot
        self.happened: list[str] = []
        self.states: list[int] = []
        self.inputs: list[RecordedInput] = []
        self.orders: dict[int, Callable[[], object]] = {}
        self.daemon = HeldDaemon(DaemonConfig(autopilot=f"tcp:127.0.0.1:{autopilot.port}", sysid=SYSID))
        self.daemon.on_bytes = lambda direction, _: self.happened.append(direction)
        self.recorded_states: list[int] = []
        self.reports: list[str] = []
        self.node = Node("7", WatchedAircraft(self.daemon, self.happened), self, self)
        self.daemon.on_input = self.node.client_did
        self.outlet = HeldOutlet(self)
        self._idle = threading.Event()
        self.ua = WatchedClient("7", self.outlet, self.happened)
        self.runner = AgentRunner(self.ua, lambda ua: Obedient(ua, self), self._idle.set, print)
        self.node.join(self.runner, self.outlet)

    # The node's outlets.

    def transmit(
        self, to: str, channel: str, payload: bytes, encoding: str, stamp: Stamp, *_: object
    ) -> None:
        self.happened.append(f"agent transmits {channel}")

    def report(self, status: AgentStatus) -> None:
        self.happened.append(f"agent {status.activity}")

    def state(self, state: AircraftState) -> None:
        self.states.append(state.header.stamp.ns)

    def log(self, item: LoggedValue, sim_time_ns: int) -> None:
        self.happened.append(f"published {item.name} = {item.value} at {sim_time_ns // MS} ms")

    def switch_radio(self, sim_time_ns: int, *, on: bool) -> None:
        self.happened.append(f"radio {'on' if on else 'off'} at {sim_time_ns // MS} ms")

    def answer(self, sim_time_ns: int) -> None:
        self.happened.append(f"answer {sim_time_ns // MS} ms")

    # What the tests do.

    def tick(self, now_ns: int) -> list[str]:
        """Live through a tick; gives what happened."""
        self._idle.clear()
        self.node.tick(now_ns)
        assert self._idle.wait(WAIT_S)
        self.node.finish()
        return self.take()

    def exchange(self, now_ns: int) -> list[str]:
        self.node.exchange(now_ns)
        return self.take()

    def take(self) -> list[str]:
        taken = self.happened.copy()
        self.happened.clear()
        return taken

    def command(self, verb: str, goal: CommandGoal | None = None) -> None:
        """As the agent: have the aircraft do something."""
        self.happened.append(f"agent commands {verb}")
        self.outlet.command(verb, goal or CommandGoal(), self.note(f"agent hears of {verb}"))

    def ask(self, verb: str, goal: CommandGoal | None = None) -> None:
        """As an operator: have the aircraft do something."""
        self.node.operator_asked(verb, goal or CommandGoal(), self.note(f"operator hears of {verb}"))

    def note(self, what: str) -> Callable[[CommandEvent | None], object]:
        def note(event: CommandEvent | None) -> None:
            assert event is not None
            phase = ("accepted", "feedback", "result")[event.phase]
            self.happened.append(f"{what}: {phase}{'' if event.success else ' ' + event.text}")

        return note

    # The node's record.

    def write_input(self, item: RecordedInput) -> None:
        self.inputs.append(item)
        self.happened.append(f"input {item.verb or item.kind}")

    def write_state(self, state: AircraftState) -> None:
        self.recorded_states.append(state.header.stamp.ns)

    def write_logged(self, item: LoggedValue | AgentStatus) -> None:
        if isinstance(item, LoggedValue):
            self.happened.append(f"recorded {item.name} = {item.value}")
        else:
            self.reports.append(item.activity)


class WatchedAircraft(AircraftBridge):
    """Notes which commands start."""

    def __init__(self, daemon: HeldDaemon, log: list[str]) -> None:
        super().__init__(daemon, "7")
        self._log = log

    def start(self, verb: str, goal: CommandGoal, on_event: OnEvent) -> None:
        self._log.append(f"start {verb}")
        super().start(verb, goal, on_event)


class WatchedClient(UaClient):
    """Notes what the agent gets."""

    def __init__(self, node: str, outlet: HeldOutlet, log: list[str]) -> None:
        super().__init__(node, outlet)
        self._log = log

    def take_clock(self, sim_time_ns: int) -> None:
        super().take_clock(sim_time_ns)
        self._log.append(f"agent at {sim_time_ns // MS} ms")

    def take_state(self, state: AircraftState) -> None:
        super().take_state(state)
        self._log.append(f"agent sees {state.mode or 'nothing'} at {state.header.stamp.ns // MS} ms")

    def take_comm_status(self, look: LookAtStatus) -> None:
        super().take_comm_status(look)
        assert self.comm_status is not None
        self._log.append(f"agent heard {','.join(self.comm_status.node)}")

    def take_packet(self, sender: str, channel: str, payload: bytes, reception: Reception) -> None:
        super().take_packet(sender, channel, payload, reception)
        self._log.append(f"agent packet {reception.sim_time_ns // MS} ms {sender} {reception.seq}")


class Obedient(Agent):
    """Does at ticks what the test says, and afterwards, in a task, transmits that it has."""

    def __init__(self, ua: UaClient, host: Host) -> None:
        super().__init__(ua, Aircraft(id=7, agent=StillAgent(type="still")), Transmit())
        self._host = host

    def transmit_package(self, sim_time_ns: int) -> None:
        """What it transmits, the tests say."""

    def on_tick(self, sim_time_ns: int) -> None:
        self._host.happened.append("agent ticks")
        if sim_time_ns in self._host.orders:
            self._host.orders[sim_time_ns]()
            self._later = asyncio.create_task(self._afterwards())

    def on_packet(self, sender: str, channel: str, payload: bytes, reception: Reception) -> None:
        pass

    async def _afterwards(self) -> None:
        await asyncio.sleep(0)
        self.ua.transmit("afterwards", b"")


@pytest.fixture
async def host() -> AsyncIterator[Host]:
    autopilot = Autopilot()
    host = Host(autopilot)
    async with host.daemon:
        await host.daemon.connect()
        autopilot.accept()
        host.runner.start().result(WAIT_S)
        yield host
        host.runner.ask_to_stop()
        assert host.runner.join(WAIT_S)
    autopilot.close()


async def test_what_the_agent_logs_is_recorded_and_published_when_its_tick_is_over(host: Host) -> None:
    def order() -> None:
        host.ua.log("error_m", np.float32(0.5))
        host.happened.append("agent goes on")
        host.ua.log("plan", {"leg": 2, "to_m": np.array([1.0, 2.0])})
        host.ua.report("flies on")

    host.orders[TICK_NS] = order
    host.tick(0)
    happened = host.tick(TICK_NS)
    logged = [each for each in happened if "=" in each or each == "agent goes on"]
    assert logged == [
        "agent goes on",
        "recorded error_m = 0.5",
        "published error_m = 0.5 at 50 ms",
        "recorded plan = {'leg': 2, 'to_m': [1.0, 2.0]}",
        "published plan = {'leg': 2, 'to_m': [1.0, 2.0]} at 50 ms",
    ]
    assert host.reports == ["is done", "flies on"]
    assert host.recorded_states == host.states == [0]


def heartbeat(mode: int = LOITER) -> mavlink.MAVLink_message:
    return mavlink.MAVLink_heartbeat_message(2, 3, 0x59, mode, 4, 3)


def acknowledged(command: int) -> mavlink.MAVLink_message:
    return mavlink.MAVLink_command_ack_message(command, 0, 255, 0, SYSID, DAEMON)


def frame(mode: int, seq: int = 0) -> bytes:
    """A ground station's wish for a flight mode."""
    mav = mavlink.MAVLink(None, srcSystem=GCS, srcComponent=190)
    mav.seq = seq
    return bytes(
        mavlink.MAVLink_command_long_message(SYSID, 1, SET_MODE, 0, 1, mode, 0, 0, 0, 0, 0).pack(mav)
    )


def packet(sender: str, seq: int, sim_time_ns: int) -> DeliveredPacket:
    return DeliveredPacket(sender, "mission", b"", Stamp(seq, sim_time_ns))


async def pending(host: Host, count: int) -> None:
    """Wait until so many inputs of clients wait for the next exchange."""
    async with asyncio.timeout(WAIT_S):
        while host.daemon.statistics()["inputs_pending"] != count:  # noqa: ASYNC110
            await asyncio.sleep(0.005)


async def heard(host: Host) -> None:
    """Live through tick 0, at which the autopilot is heard."""
    host.autopilot.say(heartbeat())
    assert host.tick(0) == [
        "from_autopilot",
        "agent at 0 ms",
        "agent sees LOITER at 0 ms",
        "agent ticks",
        "agent is done",
        "to_autopilot",
        "answer 0 ms",
    ]
    assert host.autopilot.commands() == []


async def test_everything_at_a_tick_has_its_place(host: Host) -> None:
    await heard(host)
    host.orders[TICK_NS] = lambda: host.command("arm")
    assert host.tick(TICK_NS) == [
        "agent at 50 ms",
        "agent sees LOITER at 50 ms",
        "agent ticks",
        "agent commands arm",
        "agent transmits afterwards",
        "start arm",
        "to_autopilot",
        "answer 50 ms",
    ]
    assert host.autopilot.commands() == [(SYSID, ARM, 1)]

    # All that can come before the next tick, in an order that is not the one in which it is taken.
    host.ask("mode", CommandGoal(mode="LOITER"))
    for late in (
        packet("b", 3, 40 * MS),
        packet("a", 8, 50 * MS),
        packet("a", 9, 50 * MS),
        packet("b", 2, 50 * MS),
    ):
        host.node.arrivals.packet_came(late, -80.0, 15.0)
    host.node.arrivals.comm_status_came(lambda: CommunicationStatus(node=("x",), delivered=(True,)))
    host.node.arrivals.comm_status_came(lambda: CommunicationStatus(node=("a", "b"), delivered=(True, True)))
    _, writer = await asyncio.open_connection("127.0.0.1", host.daemon.listen_port)
    writer.write(frame(GUIDED))
    await pending(host, 2)
    host.autopilot.say(heartbeat(RTL), acknowledged(ARM))

    def order() -> None:
        host.command("rtl")
        host.command("disarm")

    host.orders[2 * TICK_NS] = order
    assert host.take() == []
    assert host.tick(2 * TICK_NS) == [
        "from_autopilot",
        "input open",
        "input frame",
        "input mode",
        "start mode",
        "agent at 100 ms",
        "agent sees RTL at 100 ms",
        "agent heard a,b",
        "agent packet 40 ms b 3",
        "agent packet 50 ms a 8",
        "agent packet 50 ms a 9",
        "agent packet 50 ms b 2",
        "agent hears of arm: accepted",
        "agent ticks",
        "agent commands rtl",
        "agent commands disarm",
        "agent transmits afterwards",
        "start rtl",
        "operator hears of mode: result mode interrupted: by rtl",
        "start disarm",
        "to_autopilot",
        "answer 100 ms",
    ]
    assert host.autopilot.commands() == [
        (GCS, SET_MODE, GUIDED),
        (SYSID, SET_MODE, LOITER),
        (SYSID, SET_MODE, RTL),
        (SYSID, ARM, 0),
    ]
    assert host.inputs == [
        RecordedInput.opened(2 * TICK_NS, 1),
        RecordedInput.frame(2 * TICK_NS, 1, frame(GUIDED)),
        RecordedInput.command(2 * TICK_NS, "mode", CommandGoal(mode="LOITER")),
    ]
    writer.close()


async def test_what_was_taken_at_a_tick_is_not_taken_again(host: Host) -> None:
    await heard(host)
    host.node.arrivals.packet_came(packet("a", 0, 0), -80.0, 15.0)
    host.node.arrivals.comm_status_came(lambda: CommunicationStatus(node=("a",), delivered=(True,)))
    host.ask("arm")
    host.orders[TICK_NS] = lambda: host.command("rtl")
    host.tick(TICK_NS)
    assert host.tick(2 * TICK_NS) == [
        "agent at 100 ms",
        "agent sees LOITER at 100 ms",
        "agent ticks",
        "answer 100 ms",
    ]


async def test_packets_from_outside_enter_at_a_tick_ahead_of_the_agent(host: Host) -> None:
    await heard(host)
    host.node.packet_came(PacketWay(to="3"), b"first")
    host.node.packet_came(PacketWay("mesh", channel="other"), b"second")
    assert "input packet" not in host.exchange(TICK_NS // 2)
    host.orders[TICK_NS] = lambda: host.ua.transmit("order", b"")
    assert host.tick(TICK_NS)[:8] == [
        "input packet",
        "input packet",
        "agent at 50 ms",
        "agent transmits ip",
        "agent transmits other",
        "agent sees LOITER at 50 ms",
        "agent ticks",
        "agent transmits order",
    ]
    assert host.inputs == [
        RecordedInput.packet(TICK_NS, PacketWay("main", "3", "ip"), b"first"),
        RecordedInput.packet(TICK_NS, PacketWay("mesh", "all", "other"), b"second"),
    ]
    assert "input packet" not in host.tick(2 * TICK_NS)


async def test_packets_of_a_record_enter_again_and_none_from_outside(host: Host) -> None:
    recorded = [RecordedInput.packet(at_ns, PacketWay(to="3"), b"E") for at_ns in (TICK_NS, TICK_NS + 1)]
    host.node.repeat(recorded)
    await heard(host)
    host.node.packet_came(PacketWay(), b"E")
    assert host.node.packets_dropped == 1
    for number, expected in ((1, 1), (2, 1), (3, 0)):
        assert host.tick(number * TICK_NS).count("agent transmits ip") == expected
    assert [item.tick_ns for item in host.inputs] == [TICK_NS, 2 * TICK_NS]


@pytest.mark.parametrize(("length", "room"), [(1, ENTERING_MAX), (65535, ENTERING_MAX_BYTES // 65535)])
async def test_packets_from_outside_are_bounded_and_the_rest_is_counted(
    length: int, room: int, host: Host
) -> None:
    await heard(host)
    for _ in range(room + 7):
        host.node.packet_came(PacketWay(), bytes(length))
    assert host.node.packets_dropped == 7
    assert host.tick(TICK_NS).count("agent transmits ip") == room
    host.node.packet_came(PacketWay(), b"E")
    assert host.tick(2 * TICK_NS).count("agent transmits ip") == 1


async def test_nothing_piles_up_for_a_node_that_nobody_of_ours_flies(host: Host) -> None:
    node = Node("8", host.node.body, host, host)
    for number in range(3):
        node.arrivals.packet_came(packet("a", number, 0), -80.0, 15.0)
        node.packet_came(PacketWay(), b"E")
        node.tick(number * TICK_NS)
    given: list[int] = []
    host.ua.on_packet(lambda _sender, _channel, _payload, told: given.append(told.seq))
    for arrival in node.arrivals.take():
        arrival(host.ua)
    assert given == []


async def test_a_packet_that_cannot_be_read_hides_no_other_of_its_tick(host: Host) -> None:
    await heard(host)
    read: list[int] = []

    def reader(_sender: str, _channel: str, _payload: bytes, told: Reception) -> None:
        if told.seq == 1:
            raise DecodeError("not for me")
        read.append(told.seq)

    host.ua.on_packet(reader)
    for number in range(3):
        host.node.arrivals.packet_came(packet("a", number, 0), -80.0, 15.0)
    host.tick(TICK_NS)
    assert read == [0, 2]
    assert host.ua.malformed == 1


async def test_the_tick_is_answered_only_when_the_agent_is_idle(host: Host) -> None:
    await heard(host)
    go_on = threading.Event()
    host.orders[TICK_NS] = lambda: go_on.wait(WAIT_S) and host.command("arm")
    host._idle.clear()
    host.node.tick(TICK_NS)
    assert not host._idle.wait(0.1)
    assert host.autopilot.commands() == []
    assert not any(line.startswith(("answer", "start")) for line in host.happened)
    go_on.set()
    assert host._idle.wait(WAIT_S)
    host.node.finish()
    assert host.take()[-3:] == ["start arm", "to_autopilot", "answer 50 ms"]


async def test_an_exchange_between_ticks_does_not_run_the_agent(host: Host) -> None:
    await heard(host)
    host.orders[TICK_NS] = lambda: host.command("arm")
    host.tick(TICK_NS)
    host.autopilot.commands()
    host.node.arrivals.packet_came(packet("a", 0, 0), -80.0, 15.0)
    host.node.arrivals.comm_status_came(lambda: CommunicationStatus(node=("a",), delivered=(True,)))
    host.ask("mode", CommandGoal(mode="GUIDED"))
    host.autopilot.say(heartbeat(RTL), acknowledged(ARM))
    assert host.exchange(TICK_NS + 10 * MS) == [
        "from_autopilot",
        "input mode",
        "start mode",
        "to_autopilot",
        "answer 60 ms",
    ]
    assert host.autopilot.commands() == [(SYSID, SET_MODE, GUIDED)]
    assert host.inputs == [RecordedInput.command(60 * MS, "mode", CommandGoal(mode="GUIDED"))]
    assert host.ua.sim_time_ns == TICK_NS
    assert host.exchange(TICK_NS + 20 * MS) == ["answer 70 ms"]
    assert host.tick(2 * TICK_NS) == [
        "agent at 100 ms",
        "agent sees RTL at 100 ms",
        "agent heard a",
        "agent packet 0 ms a 0",
        "agent hears of arm: accepted",
        "agent ticks",
        "answer 100 ms",
    ]


async def test_what_became_of_commands_reaches_the_agent_at_its_next_tick(host: Host) -> None:
    await heard(host)

    def order() -> None:
        host.command("arm")
        host.command("disarm")  # takes over from it
        host.command("goto", CommandGoal(latitude_deg=100.0))  # is refused at once

    host.orders[TICK_NS] = order
    assert [line for line in host.tick(TICK_NS) if "hears" in line] == []
    host.autopilot.say(acknowledged(ARM), acknowledged(ARM))
    assert [line for line in host.tick(2 * TICK_NS) if "hears" in line] == [
        "agent hears of arm: result arm interrupted: by disarm",
        "agent hears of goto: result lat_deg must be in -90..90, not 100.0",
        "agent hears of disarm: accepted",
        "agent hears of disarm: result",
    ]
    assert [line for line in host.tick(3 * TICK_NS) if "hears" in line] == []


async def test_what_an_operator_asks_for_is_told_to_the_operator_at_once(host: Host) -> None:
    await heard(host)
    host.ask("goto", CommandGoal(latitude_deg=100.0))
    assert host.take() == []
    lines = host.tick(TICK_NS)
    assert lines[:2] == ["input goto", "start goto"]
    assert lines[2].startswith("operator hears of goto: result ")
    assert lines[3] == "agent at 50 ms"


async def test_the_state_is_published_at_its_rate_and_seen_by_the_agent_at_every_tick(host: Host) -> None:
    await heard(host)
    for number in range(1, 7):
        assert f"agent sees LOITER at {number * 50} ms" in host.tick(number * TICK_NS)
    assert host.states == [0, 100 * MS, 200 * MS, 300 * MS]


# Inputs of a record.

RECORD = [
    RecordedInput.command(TICK_NS, "mode", CommandGoal(mode="LOITER")),
    RecordedInput.opened(TICK_NS, 3),
    RecordedInput.frame(TICK_NS, 3, frame(GUIDED)),
    RecordedInput.frame(60 * MS, 3, frame(RTL, 1)),
    RecordedInput.command(60 * MS, "arm", CommandGoal()),
    RecordedInput.frame(2 * TICK_NS, 3, frame(LOITER, 2)),
    RecordedInput.closed(3 * TICK_NS, 3),
]


async def test_inputs_of_a_record_are_taken_at_their_ticks_and_exchanges(host: Host) -> None:
    host.node.repeat(RECORD)
    await heard(host)
    assert host.inputs == []
    lines = host.tick(TICK_NS)
    assert lines[:5] == ["input open", "input frame", "input mode", "start mode", "agent at 50 ms"]
    assert host.autopilot.commands() == [(GCS, SET_MODE, GUIDED), (SYSID, SET_MODE, LOITER)]
    assert host.exchange(60 * MS) == ["input frame", "input arm", "start arm", "to_autopilot", "answer 60 ms"]
    assert host.autopilot.commands() == [(GCS, SET_MODE, RTL), (SYSID, ARM, 1)]
    assert host.exchange(70 * MS) == ["answer 70 ms"]
    assert host.tick(2 * TICK_NS)[0] == "input frame"
    assert host.autopilot.commands() == [(GCS, SET_MODE, LOITER)]
    assert host.tick(3 * TICK_NS)[0] == "input close"
    assert host.tick(4 * TICK_NS)[0] == "agent at 200 ms"
    # Recorded once more, as they took effect: a client's inputs before the operator's command.
    assert host.inputs == [*RECORD[1:3], RECORD[0], *RECORD[3:]]


async def test_during_a_replay_operators_are_refused_and_clients_not_heard(host: Host) -> None:
    host.node.repeat([])
    await heard(host)
    host.ask("arm")
    assert host.take() == ["operator hears of arm: result this run repeats a record: it takes no commands"]
    _, writer = await asyncio.open_connection("127.0.0.1", host.daemon.listen_port)
    writer.write(frame(GUIDED))
    async with asyncio.timeout(WAIT_S):
        while not host.daemon.counters.inputs_ignored:  # noqa: ASYNC110
            await asyncio.sleep(0.005)
    assert host.tick(TICK_NS) == [
        "agent at 50 ms",
        "agent sees LOITER at 50 ms",
        "agent ticks",
        "answer 50 ms",
    ]
    assert host.autopilot.commands() == []
    assert host.inputs == []
    writer.close()


async def test_an_operators_switch_is_told_before_anything_is_transmitted_and_recorded(host: Host) -> None:
    await heard(host)
    host.orders[TICK_NS] = lambda: host.happened.append("agent transmits")
    host.ask("radio", radio_goal(on=False))
    assert host.tick(TICK_NS) == [
        "input radio",
        "radio off at 50 ms",
        "operator hears of radio: accepted",
        "operator hears of radio: result",
        "agent at 50 ms",
        "agent sees LOITER at 50 ms",
        "agent ticks",
        "agent transmits",
        "agent transmits afterwards",
        "answer 50 ms",
    ]
    assert host.inputs == [RecordedInput.command(TICK_NS, "radio", radio_goal(on=False))]
    host.node.repeat([RecordedInput.command(2 * TICK_NS, "radio", radio_goal(on=True))])
    assert host.tick(2 * TICK_NS)[:2] == ["input radio", "radio on at 100 ms"]


async def test_a_switch_that_says_neither_on_nor_off_is_refused(host: Host) -> None:
    await heard(host)
    host.ask("radio")
    assert host.tick(TICK_NS)[:2] == [
        "input radio",
        'operator hears of radio: result radio: arguments have to be {"on": true} or {"on": false}',
    ]


async def test_an_agent_has_no_command_for_its_radio(host: Host) -> None:
    await heard(host)
    host.orders[TICK_NS] = lambda: host.command("radio", radio_goal(on=False))
    happened = [*host.tick(TICK_NS), *host.tick(2 * TICK_NS)]
    assert not any("radio off" in each for each in happened)
    (told,) = [each for each in happened if each.startswith("agent hears of radio")]
    assert "'radio' is none of arm, disarm" in told
