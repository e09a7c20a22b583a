"""Where what a node says goes: one protocol, whoever speaks and whatever carries it.

An agent says packets, reports, values and commands; the node around it says the first three on, and its state, the
switches of its radio and that it is done with a tick. On board, what an agent logs and commands waits until its tick is
over (`HeldOutlet`); what leaves a node is carried by the bus (`bridge.agents.bus_outlet`).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from bridge.bus.handling import PLAIN, Handling
from bridge.bus.keys import MAIN
from bridge.bus.messages import AgentStatus, AircraftState, CommandEvent, CommandGoal
from bridge.bus.session import Stamp
from bridge.record.logged import LoggedValue

OnEvent = Callable[[CommandEvent | None], object]
"""Called with each event of a command; None: there will be no more."""


class Outlet(Protocol):
    """What is said as a node."""

    def transmit(
        self,
        to: str,
        channel: str,
        payload: bytes,
        encoding: str,
        stamp: Stamp,
        handling: Handling = PLAIN,
        radio: str = MAIN,
    ) -> None:
        """Give a packet to the radio; called in the agent's thread.

        Args:
            to: id of the addressee, a group, or all.
            channel: last part of the keys.
            payload: what is transmitted.
            encoding: what the payload is, as Zenoh names it; "" for bytes of which nothing is said.
            stamp: its number and time.
            handling: what its radio is to do with it.
            radio: name of the radio.

        Raises:
            PermissionError: whoever says it is not the node's agent.
        """

    def report(self, status: AgentStatus) -> None:
        """Report what the agent is doing; called in the agent's thread."""

    def log(self, item: LoggedValue, sim_time_ns: int) -> None:
        """Report a value of this instant that the agent logged."""


class AgentOutlet(Outlet, Protocol):
    """What an agent, or a program beside the run, says."""

    def command(self, verb: str, goal: CommandGoal, on_event: OnEvent) -> None:
        """Have the aircraft carry out ``verb``; ``on_event`` is called in the event loop of the caller."""


class NodeOutlet(Outlet, Protocol):
    """What a whole node says."""

    def warn(self, text: str, sim_time_ns: int) -> None:
        """Tell whoever watches the run, in words that name the node, what they must see; from any thread."""

    def state(self, state: AircraftState) -> None:
        """Publish the aircraft's state."""

    def switch_radio(self, sim_time_ns: int, *, on: bool) -> None:
        """Report to the radio that an operator switched this node's from an instant on; ahead of the answer to it."""

    def serial(self, radio: str, data: bytes, sim_time_ns: int) -> None:
        """Give bytes of a host to the node's modem at a radio: what it had sent when the fleet was held.

        They come ahead of the answer to that instant.
        """

    def answer(self, sim_time_ns: int) -> None:
        """Report to the radio that all is done that this node does at a tick."""


class HeldOutlet:
    """What an agent on board says (`AgentOutlet`): packets and reports go at once, the rest when it is idle.

    Args:
        outlet: of its node.
    """

    def __init__(self, outlet: Outlet) -> None:
        self.transmit = outlet.transmit
        self._report = outlet.report
        self.commands: list[tuple[str, CommandGoal, OnEvent]] = []
        self.logged: list[LoggedValue | AgentStatus] = []

    def report(self, status: AgentStatus) -> None:
        """Report at once, and keep it for the record."""
        self._report(status)
        self.logged.append(status)

    def log(self, item: LoggedValue, sim_time_ns: int) -> None:  # noqa: ARG002
        """Keep a value until the agent's tick is over."""
        self.logged.append(item)

    def command(self, verb: str, goal: CommandGoal, on_event: OnEvent) -> None:
        """Keep a command until the agent's tick is over."""
        self.commands.append((verb, goal, on_event))
