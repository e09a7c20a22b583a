"""One node at a tick: hears its autopilot, lets its agent live through the tick, speaks to its autopilot.

`Node` is the order in which things happen on board (docs/architecture.md has it as a drawing):

1. the autopilot, held by the flight dynamics, is heard; then MAVLink clients, then operators, in the order they came;
2. the agent gets clock, state, who was heard, the packets that the radio delivered, and what became of its commands;
3. when nothing in the agent is ready to run, its commands start, in their order;
4. the autopilot is spoken to, and the tick is answered.

It knows no session and no event loop: what goes out goes to its `Outlets`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple, Protocol

from aps.inputs import Input
from bridge.agents.client import LookAtStatus, OnEvent, UaClient
from bridge.agents.runner import AgentRunner, Arrival
from bridge.aircraft.body import Body, StatePace
from bridge.bus.messages import AgentStatus, AircraftState, CommandEvent, CommandGoal
from bridge.bus.session import Stamp
from bridge.record.inputs import RecordedInput

OnReply = Callable[[CommandEvent], object]
ASKED_MAX = 1000
"""Operators' commands that may wait for a tick."""


class Outlets(Protocol):
    """Where what a node says goes: Zenoh, in a run."""

    def transmit(self, to: str, channel: str, payload: bytes, encoding: str | None, stamp: Stamp) -> None:
        """Give a packet to the radio; called in the agent's thread."""

    def report(self, status: AgentStatus) -> None:
        """Tell what the agent is doing; called in the agent's thread."""

    def state(self, state: AircraftState) -> None:
        """Publish the aircraft's state."""

    def answer(self, sim_time_ns: int) -> None:
        """Tell the radio that all is done that this node does at a tick."""


class Packet(NamedTuple):
    """What the radio delivered."""

    sender: str
    channel: str
    payload: bytes
    stamp: Stamp


class AgentOutlet:
    """What the agent says (`bridge.agents.client.Outlet`): packets go out at once, commands when its tick is over."""

    def __init__(self, outlets: Outlets) -> None:
        self.transmit = outlets.transmit
        self.report = outlets.report
        self.commands: list[tuple[str, CommandGoal, OnEvent]] = []

    def command(self, verb: str, goal: CommandGoal, on_event: OnEvent) -> None:
        """Keep a command until the agent's tick is over."""
        self.commands.append((verb, goal, on_event))


class Node:
    """One node.

    Args:
        body: its aircraft, with a held daemon; or what a ground node has in its place.
        outlets: where what it says goes.
        record_input: told of each input from outside as it takes effect, with its tick.
    """

    def __init__(
        self,
        node: str,
        body: Body,
        outlets: Outlets,
        record_input: Callable[[RecordedInput], object],
    ) -> None:
        self.node = node
        self.body = body
        self._pace = StatePace()
        self._outlets = outlets
        self._record_input = record_input
        self._now_ns = 0
        self._agent_outlet: AgentOutlet | None = None
        self._runner: AgentRunner | None = None
        self._packets: list[Packet] = []
        self._comm_status: LookAtStatus | None = None
        self._events: list[tuple[OnEvent, CommandEvent]] = []
        self._asked: list[tuple[str, CommandGoal, OnReply]] = []
        self.commands_dropped = 0
        """Commands of operators that found no room."""
        self._replay: list[RecordedInput] = []

    def join(self, runner: AgentRunner, outlet: AgentOutlet) -> None:
        """Give the node its agent."""
        self._runner, self._agent_outlet = runner, outlet

    def repeat(self, inputs: list[RecordedInput]) -> None:
        """Take inputs from a record, at their ticks, and none from outside."""
        self._replay = list(reversed(inputs))
        self.body.takes_input = False

    # What comes from other processes, between ticks.

    def packet_came(self, packet: Packet) -> None:
        """The radio delivered a packet: it is for the next tick. They come in canonical order."""
        self._packets.append(packet)

    def comm_status_came(self, look: LookAtStatus) -> None:
        """The radio tells who was heard."""
        self._comm_status = look

    def operator_asked(self, verb: str, goal: CommandGoal, on_reply: OnReply) -> None:
        """Somebody outside wants the aircraft to do something: it is for the next tick, and recorded."""
        if not self.body.takes_input:
            text = "this run repeats a record: it takes no commands"
            on_reply(CommandEvent(CommandEvent.RESULT, False, text, outcome="refused"))
            return
        if len(self._asked) >= ASKED_MAX:
            self.commands_dropped += 1
            text = f"{ASKED_MAX} commands wait for the next tick already"
            on_reply(CommandEvent(CommandEvent.RESULT, False, text, outcome="refused"))
            return
        self._asked.append((verb, goal, on_reply))

    # The tick.

    def exchange(self, now_ns: int) -> None:
        """Between two ticks: hear the autopilot and the outside, and speak to the autopilot."""
        self._begin(now_ns)
        self._end()

    def tick(self, now_ns: int) -> None:
        """Hear the autopilot and the outside, and let the agent live; `finish` is to follow when it is idle."""
        self._begin(now_ns)
        state = self.body.state()
        if self._pace.is_due(now_ns):
            self._outlets.state(state)
        if self._runner is None:  # nobody of ours flies it
            self._end()
        else:
            self._runner.tick(now_ns, self._arrivals(state))

    def finish(self) -> None:
        """The agent has done all that it does at this tick."""
        assert self._agent_outlet is not None, "a node ticks with its agent"
        commands, self._agent_outlet.commands = self._agent_outlet.commands, []
        for verb, goal, on_event in commands:
            self.body.start(verb, goal, lambda event, tell=on_event: self._tell(tell, event))  # type: ignore[misc]
        self._end()

    def _begin(self, now_ns: int) -> None:
        self._now_ns = now_ns
        recorded = self._due_of_the_record()
        self.body.inject(
            [Input(i.link, i.kind, i.data) for i in recorded if i.kind != "command" and i.link is not None]
        )
        self.body.begin(now_ns)
        for item in recorded:
            if item.verb is not None and item.goal is not None:
                self._start_asked(item.verb, item.goal, lambda _: None)
        asked, self._asked = self._asked, []
        for verb, goal, on_reply in asked:
            self._start_asked(verb, goal, on_reply)

    def _end(self) -> None:
        self.body.end()
        self._outlets.answer(self._now_ns)

    def _due_of_the_record(self) -> list[RecordedInput]:
        due = []
        while self._replay and self._replay[-1].tick_ns <= self._now_ns:
            due.append(self._replay.pop())
        return due

    def _start_asked(self, verb: str, goal: CommandGoal, on_reply: OnReply) -> None:
        self._record_input(RecordedInput.command(self._now_ns, verb, goal))
        self.body.start(verb, goal, on_reply)

    def client_did(self, item: Input) -> None:
        """A MAVLink client's input takes effect at this instant."""
        self._record_input(RecordedInput(self._now_ns, item.kind, item.link, item.raw))

    def _tell(self, on_event: OnEvent, event: CommandEvent) -> None:
        """Keep what became of an agent's command for its next tick."""
        self._events.append((on_event, event))

    def _arrivals(self, state: AircraftState) -> list[Arrival]:
        """What the agent gets at this tick, in the one order that there is."""
        arrivals: list[Arrival] = [lambda ua: ua.take_state(state)]
        status, self._comm_status = self._comm_status, None
        if status is not None:
            arrivals.append(lambda ua: ua.take_comm_status(status))
        packets, self._packets = self._packets, []
        if packets:
            arrivals.append(lambda ua: _give(packets, ua))
        events, self._events = self._events, []
        return arrivals + [_event(on_event, event) for on_event, event in events]


def _give(packets: Sequence[Packet], ua: UaClient) -> None:
    for packet in packets:
        ua.take_packet(packet.sender, packet.channel, packet.payload, packet.stamp)


def _event(on_event: OnEvent, event: CommandEvent) -> Arrival:
    def arrive(_: UaClient) -> None:
        on_event(event)

    return arrive
