"""One node at a tick: hears its autopilot, lets its agent live through the tick, speaks to its autopilot.

`Node` is the order in which things happen on board (docs/explanation/architecture.md has it as a drawing):

1. the autopilot, held by the flight dynamics, is heard; then MAVLink clients, then operators, in the order they came;
2. packets that programs of others gave to the node enter its radios; then the agent gets clock, state, who was heard,
   what its sensor measured, the packets that the radio delivered, and what became of its commands;
3. when nothing in the agent is ready to run, its commands start, in their order;
4. the autopilot is spoken to, and the tick is answered.

It knows no session and no event loop: what goes out goes to its outlet.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Protocol

from aps.inputs import Input
from bridge.agents.client import UaClient
from bridge.agents.outlet import HeldOutlet, NodeOutlet
from bridge.agents.running.feed import Arrival, Arrivals
from bridge.agents.running.runner import AgentRunner
from bridge.aircraft.body import Body, StatePace
from bridge.bus.messages import AgentStatus, AircraftState, CommandEvent, CommandGoal
from bridge.bus.radio_command import RADIO, RadioMistake, is_on
from bridge.record.inputs.file import PacketWay, RecordedInput
from bridge.record.logged import LoggedValue

OnReply = Callable[[CommandEvent], object]
ASKED_MAX = 1000
"""Operators' commands that may wait for a tick."""
ENTERING_MAX, ENTERING_MAX_BYTES = 2000, 4 << 20
"""Packets from outside that may wait for a tick: 40 000 a second, more than any radio of ours sends."""


class Recorder(Protocol):
    """Where what a node does is written down, with its instant."""

    def write_input(self, item: RecordedInput) -> None:
        """An input from outside takes effect."""

    def write_state(self, state: AircraftState) -> None:
        """The state is published."""

    def write_logged(self, item: LoggedValue | AgentStatus) -> None:
        """The agent logged a value, or said what it is doing."""


class Node:
    """One node.

    Args:
        body: its aircraft, with a held daemon; or what a ground node has in its place.
        outlet: where what it says goes.
        record: called with what is to be written down, at its tick.

    Attributes:
        arrivals: what came for its agent since the last tick.
    """

    def __init__(
        self,
        node: str,
        body: Body,
        outlet: NodeOutlet,
        record: Recorder,
    ) -> None:
        self.node = node
        self.body = body
        self._pace = StatePace()
        self._outlet = outlet
        self._record = record
        self._now_ns = 0
        self.is_live = False
        """Whether its agent is at work on a tick."""
        self._agent_outlet: HeldOutlet | None = None
        self._runner: AgentRunner | None = None
        self.arrivals = Arrivals()
        self._asked: list[tuple[str, CommandGoal, OnReply]] = []
        self.commands_dropped = 0
        """Commands of operators that found no room."""
        self._entering: list[tuple[PacketWay, bytes]] = []
        self._entering_bytes = 0
        self.packets_dropped = 0
        """Packets from outside that found no room, or came where none are taken."""
        self._replay: list[RecordedInput] = []

    def join(self, runner: AgentRunner, outlet: HeldOutlet) -> None:
        """Give the node its agent."""
        self._runner, self._agent_outlet = runner, outlet

    def repeat(self, inputs: list[RecordedInput]) -> None:
        """Take inputs from a record, at their ticks, and none from outside."""
        self._replay = list(reversed(inputs))
        self.body.takes_input = False

    # What comes from other processes, between ticks.

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

    def packet_came(self, way: PacketWay, payload: bytes) -> None:
        """Somebody outside has a packet for a radio of the node: it enters at the next tick, and is recorded."""
        has_room = (
            len(self._entering) < ENTERING_MAX and self._entering_bytes + len(payload) <= ENTERING_MAX_BYTES
        )
        if not self.body.takes_input or self._runner is None or not has_room:
            self.packets_dropped += 1
        else:
            self._enter(way, payload)

    def _enter(self, way: PacketWay, payload: bytes) -> None:
        self._entering.append((way, payload))
        self._entering_bytes += len(payload)

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
            self._outlet.state(state)
            self._record.write_state(state)
        self.arrivals.state_came(state)
        arrivals = self.arrivals.take()
        if self._runner is None:  # nobody of ours flies it
            self._end()
        else:
            self.is_live = True
            self._runner.tick(now_ns, [*self._entered(), *arrivals])

    def finish(self) -> None:
        """The agent has done all that it does at this tick."""
        assert self._agent_outlet is not None, "a node ticks with its agent"
        self.is_live = False
        logged, self._agent_outlet.logged = self._agent_outlet.logged, []
        for item in logged:
            self._record.write_logged(item)
            if isinstance(item, LoggedValue):
                self._outlet.log(item, self._now_ns)
        commands, self._agent_outlet.commands = self._agent_outlet.commands, []
        for verb, goal, on_event in commands:
            self.body.start(verb, goal, partial(self.arrivals.event_came, on_event))
        self._end()

    def _begin(self, now_ns: int) -> None:
        self._now_ns = now_ns
        recorded = self._due_of_the_record()
        self.body.inject(
            [
                Input(item.link, item.kind, item.data)
                for item in recorded
                if item.link is not None and item.kind in ("open", "frame", "close")
            ]
        )
        self.body.begin(now_ns)
        for item in recorded:
            if item.verb is not None and item.goal is not None:
                self._start_asked(item.verb, item.goal, lambda _: None)
            elif item.way is not None:
                self._enter(item.way, item.data)
        asked, self._asked = self._asked, []
        for verb, goal, on_reply in asked:
            self._start_asked(verb, goal, on_reply)

    def _end(self) -> None:
        self.body.end()
        self._outlet.answer(self._now_ns)

    def _entered(self) -> list[Arrival]:
        """Packets from outside that enter at this tick, ahead of what the agent transmits."""
        entering, self._entering, self._entering_bytes = self._entering, [], 0
        for way, payload in entering:
            self._record.write_input(RecordedInput.packet(self._now_ns, way, payload))
        return [
            partial(UaClient.enter, channel=way.channel, payload=payload, to=way.to, radio=way.radio)
            for way, payload in entering
        ]

    def _due_of_the_record(self) -> list[RecordedInput]:
        due = []
        while self._replay and self._replay[-1].tick_ns <= self._now_ns:
            due.append(self._replay.pop())
        return due

    def _start_asked(self, verb: str, goal: CommandGoal, on_reply: OnReply) -> None:
        self._record.write_input(RecordedInput.command(self._now_ns, verb, goal))
        if verb == RADIO:
            self._switch_radio(goal, on_reply)
        else:
            self.body.start(verb, goal, on_reply)

    def _switch_radio(self, goal: CommandGoal, on_reply: OnReply) -> None:
        """Switch it before anything is transmitted at this instant."""
        try:
            on = is_on(goal)
        except RadioMistake as mistake:
            on_reply(CommandEvent(CommandEvent.RESULT, False, str(mistake), outcome="refused"))
            return
        self._outlet.switch_radio(self._now_ns, on=on)
        on_reply(CommandEvent(CommandEvent.ACCEPTED, True))
        text = f"radio {'on' if on else 'off'}"
        on_reply(CommandEvent(CommandEvent.RESULT, True, text, outcome="reached"))

    def client_did(self, item: Input) -> None:
        """A MAVLink client's input takes effect at this instant."""
        self._record.write_input(RecordedInput(self._now_ns, item.kind, item.link, item.raw))
