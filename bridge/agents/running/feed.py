"""How an agent is fed, on board and beside the run: what comes waits for the tick, and then comes in the one order.

That order is clock, state, who was heard, what its sensor measured, what its own radios say (queue, unicasts), the
packets that the radio delivered, what became of its commands, and then the tick itself.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple

from bridge.agents.client import LookAtStatus, UaClient
from bridge.agents.commands import CommandFailed
from bridge.agents.measurements import Measurement
from bridge.agents.outlet import OnEvent
from bridge.agents.radio import OwnRadio, QueueState, UnicastReply
from bridge.agents.running.whereabouts import place_of
from bridge.bus.keys import MAIN
from bridge.bus.messages import AircraftState, CommandEvent, DecodeError
from bridge.bus.reception import UNKNOWN, Instants, Reception
from bridge.bus.session import Stamp
from sitl_configs.own_code import OwnCodeError

log = logging.getLogger("agent")

Arrival = Callable[[UaClient], object]
"""Something that came for the agent: called with its client, in its event loop."""


class DeliveredPacket(NamedTuple):
    """What the radio delivered, the same for all that got it."""

    sender: str
    channel: str
    payload: bytes
    stamp: Stamp
    radio: str = MAIN


class Arrivals:
    """What came for a node's agent since its last tick."""

    def __init__(self) -> None:
        self._state: AircraftState | None = None
        self._warning, self._severity = "", 0
        self._comm_status: LookAtStatus | None = None
        self._measurements: list[Measurement] = []
        self._packets: list[tuple[DeliveredPacket, float, float, Instants]] = []
        self._replies: dict[str, list[UnicastReply]] = {}
        self._queues: dict[str, QueueState] = {}
        self._events: list[tuple[OnEvent, CommandEvent]] = []

    def state_came(self, state: AircraftState) -> None:
        """The aircraft's state at the tick."""
        self._state = state

    def warning_came(self, text: str, severity: int) -> None:
        """The autopilot warns of something: the gravest counts (MAV_SEVERITY), of equal ones the newest."""
        if not self._warning or severity <= self._severity:
            self._warning, self._severity = text, severity

    def comm_status_came(self, look: LookAtStatus) -> None:
        """The radio says who was heard."""
        self._comm_status = look

    def measurements_came(self, measurements: Sequence[Measurement]) -> None:
        """The node's RF sensor says what it measured."""
        self._measurements += measurements

    def packet_came(
        self, packet: DeliveredPacket, rssi_dbm: float, snr_db: float, instants: Instants = UNKNOWN
    ) -> None:
        """The radio delivered a packet, in this power and over this noise. They come in the order of arrival."""
        self._packets.append((packet, rssi_dbm, snr_db, instants))

    def reply_came(self, reply: UnicastReply, radio: str = MAIN) -> None:
        """A radio says what became of a unicast of the node's."""
        self._replies.setdefault(radio, []).append(reply)

    def queue_changed(self, queue: QueueState, radio: str = MAIN) -> None:
        """A radio says what waits in its transmit queue."""
        self._queues[radio] = queue

    def event_came(self, on_event: OnEvent, event: CommandEvent) -> None:
        """Something became of a command."""
        self._events.append((on_event, event))

    def take(self) -> list[Arrival]:
        """What the agent gets at this tick, in the one order that there is; it is not kept."""
        arrivals: list[Arrival] = []
        state, self._state = self._state, None
        if state is not None:
            arrivals.append(lambda ua: ua.take_state(state))
        warning, self._warning = self._warning, ""
        if warning:
            arrivals.append(lambda ua: ua.take_warning(warning))
        status, self._comm_status = self._comm_status, None
        if status is not None:
            arrivals.append(lambda ua: ua.take_comm_status(status))
        measurements, self._measurements = self._measurements, []
        arrivals.append(lambda ua: ua.take_measurements(measurements))
        queues, self._queues = self._queues, {}
        replies, self._replies = self._replies, {}
        for radio in sorted({*queues, *replies}):
            arrivals.append(partial(_tell_radio, radio, queues.get(radio), replies.get(radio, [])))
        packets, self._packets = self._packets, []
        arrivals += [partial(_give_packet, *packet) for packet in packets]
        return arrivals + self.take_events()

    def take_events(self) -> list[Arrival]:
        """What became of the agent's commands; it is not kept."""
        events, self._events = self._events, []
        return [partial(_give_event, on_event, event) for on_event, event in events]


def _tell_radio(radio: str, queue: QueueState | None, replies: Sequence[UnicastReply], ua: UaClient) -> None:
    ua.radios.setdefault(radio, OwnRadio()).take(queue, replies)


def _give_packet(
    packet: DeliveredPacket, rssi_dbm: float, snr_db: float, instants: Instants, ua: UaClient
) -> None:
    sender, channel, payload, stamp, radio = packet
    reception = Reception(stamp.seq, stamp.sim_time_ns, ua.sim_time_ns, rssi_dbm, snr_db, instants, radio)
    ua.take_packet(sender, channel, payload, reception)


def _give_event(on_event: OnEvent, event: CommandEvent, _: UaClient) -> None:
    on_event(event)


def _words(error: BaseException) -> str:
    """What an error says; of a group, as TaskGroup raises it, also its first one by name."""
    if not isinstance(error, BaseExceptionGroup):
        return str(error)
    first = error.exceptions[0]
    return f"{error}: {type(first).__name__}: {_words(first)}"


class Feeder:
    """Gives an agent its ticks, and reports what its code raises.

    Args:
        ua: the node as the agent sees it.
        reported: what is reported in place of being raised: of an agent that has a thread to itself, SystemExit, too.

    Attributes:
        has_failed: the failure was reported; once is enough.
    """

    def __init__(self, ua: UaClient, reported: type[BaseException] = Exception) -> None:
        self.has_failed = False
        self._ua, self._reported = ua, reported

    def tick(self, sim_time_ns: int, arrivals: Sequence[Arrival]) -> None:
        """Have the agent get all that came with a tick, and the tick itself."""
        self._ua.take_clock(sim_time_ns)
        for arrival in arrivals:
            self._call("in a callback", partial(arrival, self._ua))
        self._call("at a tick", self._ua.tick)

    def _call(self, when: str, callback: Callable[[], object]) -> None:
        try:
            callback()
        except DecodeError as error:
            self._ua.malformed += 1
            log.warning("%s: %s", when, error)
        except self._reported as error:  # an agent is somebody's own code: what it raises is reported by name
            self.fail(when, error)

    def fail(self, when: str, error: BaseException | None, text: str = "") -> None:
        """Report what the agent's code raised, and where."""
        log.error("%s, at %.3f s: %s", when, self._ua.sim_time_ns / 1e9, text, exc_info=error)
        if not self.has_failed:
            why = ("" if error is None else _words(error)) or text
            what = "an error" if error is None else type(error).__name__
            self.tell(f"{what} {when}" + (f": {why}" if why else ""), error)

    def fail_in_flight(self, error: Exception) -> None:
        """Report what ended the agent's flight: a command that failed by its own words, anything else by name."""
        if isinstance(error, CommandFailed):
            log.error("in flight, at %.3f s", self._ua.sim_time_ns / 1e9, exc_info=error)
            self.tell(str(error).removeprefix(f"UA {self._ua.node}: "), error)
        else:
            self.fail("in flight", error)

    def fail_unbuilt(self, sim_time_ns: int, error: BaseException) -> None:
        """Report at the first tick, which all parts of the run hear, why there is no agent."""
        self._ua.take_clock(sim_time_ns)
        if self.has_failed:
            return
        if isinstance(error, OwnCodeError):
            log.error("%s", error, exc_info=error.__cause__)
            self.tell(str(error))
        else:
            self.fail("in its constructor", error)

    def tell(self, text: str, error: BaseException | None = None) -> None:
        """Report that the agent failed, and in which line of its author's code.

        What is no text in UTF-8 is reported as Python writes it.
        """
        self.has_failed = True
        if place := place_of(error):
            first, *more = text.split("\n", 1)
            text = "\n".join((f"{first} ({place})", *more))
        self._ua.report(text.encode(errors="backslashreplace").decode(), failed=True)
