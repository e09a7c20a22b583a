"""Where what a node says goes in a run of one process: to the radio and to listeners, by calls."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from typing import NamedTuple, Protocol

from bridge.bus.handling import PLAIN, Handling
from bridge.bus.keys import MAIN, Address
from bridge.bus.messages import AgentStatus, AircraftState
from bridge.bus.session import Stamp
from bridge.radio.radio import RecordedRadio
from bridge.record.logged import LoggedValue


class Listeners(Protocol):
    """Gets what a node says, besides the radio."""

    def state(self, state: AircraftState) -> None:
        """The aircraft's state."""

    def report(self, node: str, status: AgentStatus) -> None:
        """What the node's agent is doing."""

    def warning(self, node: str, text: str, sim_time_ns: int) -> None:
        """What somebody must see of the node."""

    def logged(self, node: str, item: LoggedValue, sim_time_ns: int) -> None:
        """A value that the node's agent logged."""


class _Packet(NamedTuple):
    address: Address
    payload: bytes
    encoding: str
    stamp: Stamp
    handling: Handling


class CalledOutlet:
    """What one node says (`bridge.agents.outlet.NodeOutlet`).

    What its agent says comes in the agent's thread; it is passed on in the event loop's, in its order, ahead of the
    node's answer.

    Args:
        node: its id.
        radio: of the run.
        listeners: who else is called.
        on_answer: called when the node is done with an instant.
    """

    def __init__(
        self, node: str, radio: RecordedRadio, listeners: Listeners, on_answer: Callable[[str, int], object]
    ) -> None:
        self._node, self._radio, self._listeners, self._on_answer = node, radio, listeners, on_answer
        self._loop = asyncio.get_running_loop()
        self._said: deque[_Packet | AgentStatus] = deque()

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
        """Give a packet to the radio."""
        address = Address(self._node, radio, to, channel)
        self._said.append(_Packet(address, bytes(payload), encoding, stamp, handling))

    def report(self, status: AgentStatus) -> None:
        """Report what the agent is doing."""
        self._said.append(status)
        self._loop.call_soon_threadsafe(self.pass_on)

    def warn(self, text: str, sim_time_ns: int) -> None:
        """Tell whoever watches the run what they must see."""
        with suppress(RuntimeError):  # the loop is closed: the run is over
            self._loop.call_soon_threadsafe(self._listeners.warning, self._node, text, sim_time_ns)

    def pass_on(self) -> None:
        """Pass on what the agent has said so far."""
        while self._said:
            item = self._said.popleft()
            if isinstance(item, _Packet):
                self._radio.packet(*item)
            else:
                self._radio.agent(self._node, item)
                self._listeners.report(self._node, item)

    def state(self, state: AircraftState) -> None:
        """Publish the aircraft's state."""
        self._listeners.state(state)

    def log(self, item: LoggedValue, sim_time_ns: int) -> None:
        """Publish what the agent logged, if anybody wants it."""
        self._listeners.logged(self._node, item, sim_time_ns)

    def switch_radio(self, sim_time_ns: int, *, on: bool) -> None:
        """Report to the radio that this node's was switched."""
        self._radio.switch(self._node, sim_time_ns, on=on)

    def serial(self, radio: str, data: bytes, sim_time_ns: int) -> None:
        """Give bytes of a host to the node's modem."""
        self._radio.serial(self._node, radio, data, sim_time_ns)

    def answer(self, sim_time_ns: int) -> None:
        """Report to the radio that this node is done with an instant."""
        self.pass_on()
        self._on_answer(self._node, sim_time_ns)
