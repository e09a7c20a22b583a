"""One node as its agent sees it: state, commands, radio, sim time. Nothing of another node or of the truth.

`UaClient` does no I/O: what comes in is given to it, what goes out goes to its `AgentOutlet`. On board that is the host
(`bridge.host`), for a script beside the run it is Zenoh (`bridge.agents.beside`).
"""

from __future__ import annotations

import asyncio
import inspect
import itertools
import logging
import math
from collections.abc import Callable, Collection, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from bridge.agents.commands import CommandFailed, Commands, RunOver, failure
from bridge.agents.frames import Frames, Place, has_fix
from bridge.agents.measurements import Measurement, SensorMemory
from bridge.agents.outlet import AgentOutlet
from bridge.agents.own_files import OwnFiles
from bridge.agents.radio import OwnRadio
from bridge.bus.handling import PLAIN, Handling, handling_of
from bridge.bus.keys import ALL, IP, MAIN, checked_chunk
from bridge.bus.messages import (
    AgentStatus,
    AircraftState,
    CommandEvent,
    CommandGoal,
    CommunicationStatus,
    DecodeError,
    Header,
    Message,
    decode,
    encode,
    encoding_of,
)
from bridge.bus.messages.ages import age_s
from bridge.bus.reception import Reception
from bridge.bus.session import Stamp
from bridge.record.logged import LoggedValue, checked_name, checked_text, checked_value, kind_of
from bridge.scenario.own.calls import CALLED_WITH, wrong_call

if TYPE_CHECKING:
    from channel.sensing.sensor import Sensor

M = TypeVar("M", bound=Message)
log = logging.getLogger("agent")
LOGGED_MAX = 1000
"""Values that an agent may log at a tick."""
REFUSED = "refused"
"""Outcome in the feedback of a `goto`: the autopilot flies it without the speed or heading that was asked for."""
ROUNDING_NS = 0.5
"""Times are whole nanoseconds, but for the rounding of seconds."""
OnPacket = Callable[[str, str, bytes, Reception], object]
"""Called with each packet: sender, channel, payload, and what the receiver knows of it."""
LookAtStatus = Callable[[], CommunicationStatus | None]
"""Makes, or reads, a communication status; None if it is none."""


_Waiter = tuple[Callable[[AircraftState], bool], "asyncio.Future[AircraftState]", float]


class UaClient(Commands):
    """A node's view of the run. Its callbacks run in the event loop of whoever feeds it.

    Args:
        node: id of the node.
        outlet: where what it says goes.
        seed: of the run, for the agent's own random numbers.
        folder: where its own files go; ``None``: nowhere.
        reach: ids of the nodes on the network of each of the node's radios, and names of the groups there, by the
            radio's name, if they are known.
        sensor: what the node knows of its RF sensor; None: it has none.
        frames: the node's and the fleet's frame, if they are known.
        take_off_at_s: sim time before which no aircraft of the run is to take off.

    Attributes:
        state: of its aircraft, newest; None until the autopilot knows where it is.
        told: the same, also without a fix: numbers that are not known are nan.
        warning: what its autopilot last warned of, the gravest of a tick; on board only, and "" before that.
        measurements: what the sensor measured at the tick before, and the newest of each emitter.
    """

    def __init__(
        self,
        node: str,
        outlet: AgentOutlet,
        seed: int = 0,
        folder: Path | None = None,
        *,
        reach: Mapping[str, Collection[str]] = MappingProxyType({}),
        sensor: Sensor | None = None,
        frames: Frames | None = None,
        take_off_at_s: float = 0.0,
    ) -> None:
        self.node = node
        self.files = OwnFiles(folder)
        self._others = {name: tuple(each for each in nodes if each != node) for name, nodes in reach.items()}
        self.seed = seed
        self.state: AircraftState | None = None
        self.told = AircraftState()
        self.warning = ""
        self.sensor = sensor
        self.frames = frames
        self.take_off_at_s = take_off_at_s
        self.measurements = SensorMemory(frames)
        self._comm_status: CommunicationStatus | None = None
        self._new_comm_status: LookAtStatus | None = None
        self.malformed = 0
        """Packets and the like that the agent could not read."""
        self.sim_time_ns = 0
        self.is_over, self._why_over = False, ""
        """Whether the run is over; what is still transmitted or commanded has no effect, as nobody could hear it."""
        self.sent = 0
        self.received = 0
        self.radios = {name: OwnRadio() for name in (MAIN, *reach)}
        """What waits in the transmit queues of the node's radios, and what became of its unicasts, by radio."""
        self.radio = self.radios[MAIN]
        self._outlet = outlet
        self._waiters: dict[int, _Waiter] = {}
        self._commanded: dict[int, asyncio.Queue[CommandEvent | None]] = {}
        self._awaited = itertools.count()
        self._has_clock = False
        self._kinds: dict[str, str] = {}
        self._logged_at_ns, self._logged = -1, 0
        self._on_tick: list[Callable[[int], object]] = []
        self._on_packet: list[tuple[OnPacket, str]] = []
        self._on_measurement: list[Callable[[Measurement], object]] = []

    # --- what comes in

    @property
    def comm_status(self) -> CommunicationStatus | None:
        """Which other nodes were heard, newest; None before anything was transmitted. Decoded when it is looked at."""
        look, self._new_comm_status = self._new_comm_status, None
        if look is not None:
            self._comm_status = look() or self._comm_status
        return self._comm_status

    def read(self, payload: bytes, cls: type[M]) -> M | None:
        """The message in what came from elsewhere; None, and counted in ``malformed``, if it is none."""
        try:
            return decode(payload, cls)
        except DecodeError as error:
            self.malformed += 1
            log.warning("%s", error)
            return None

    def age_s(self, field: str) -> float:
        """How old a field of ``state`` is, s, such as ``latitude_deg``; inf if the autopilot has not sent it yet.

        Raises:
            ValueError: there is no such field, or it is none that the autopilot sends.
        """
        return age_s(self.told, field)

    @property
    def place_ned_m(self) -> Place | None:
        """Where the node is by its own state, in the fleet's frame; None if it is not known."""
        return None if self.state is None or self.frames is None else self.frames.place_of(self.state)

    def on_tick(self, callback: Callable[[int], object]) -> None:
        """Call ``callback(sim_time_ns)`` at each tick of the fleet clock.

        Raises:
            TypeError: the callback cannot be called so.
        """
        _check_callback("on_tick", callback)
        self._on_tick.append(callback)

    def on_packet(self, callback: OnPacket, *, channel: str = "") -> None:
        """Call ``callback(sender, channel, payload, reception)`` for each packet that the radio delivers.

        Args:
            callback: called in the agent's loop.
            channel: of this one only; of all but ``ip``, which is for programs attached to the node, if not given.

        Raises:
            TypeError: the callback cannot be called so.
        """
        _check_callback("on_packet", callback)
        self._on_packet.append((callback, channel))

    def on_measurement(self, callback: Callable[[Measurement], object]) -> None:
        """Call ``callback(measurement)`` for each measurement of the node's RF sensor, one tick after it was taken.

        Raises:
            TypeError: the callback cannot be called so.
        """
        _check_callback("on_measurement", callback)
        self._on_measurement.append(callback)

    async def wait_for(
        self, condition: Callable[[AircraftState], bool], *, timeout_s: float = math.inf
    ) -> AircraftState:
        """Wait until the aircraft's state meets ``condition``; returns that state.

        Raises:
            TimeoutError: it did not within ``timeout_s`` of sim time.
            RunOver: it did not before the end of the run; only beside the run, as an agent ends with it.
            Exception: whatever ``condition`` raises.
            ValueError: ``timeout_s`` is nan.
        """
        if math.isnan(timeout_s):
            raise ValueError("wait_for: timeout_s has to be a number of seconds, and is nan")
        if self.state is not None and condition(self.state):
            return self.state
        if self.is_over:
            raise self._over("wait_for")
        if timeout_s <= 0.0:
            raise self._still_waiting()
        future: asyncio.Future[AircraftState] = asyncio.get_running_loop().create_future()
        number = next(self._awaited)
        self._waiters[number] = (condition, future, self.sim_time_ns + timeout_s * 1e9)
        try:
            return await future
        finally:
            del self._waiters[number]

    # --- what goes out

    def transmit(
        self,
        channel: str,
        payload: bytes | Message,
        *,
        to: str | int = ALL,
        radio: str = MAIN,
        priority: int = 0,
        lifetime_s: float | None = None,
        key: str = "",
    ) -> int:
        """Give a packet to a radio, stamped with the present sim time. Returns its sequence number.

        A node counts the packets of all its radios together. The last three matter where packets wait, which is on
        media that take time.

        Args:
            channel: last part of the keys.
            payload: what is transmitted.
            to: the node, or the group of nodes, that it is for; every other one on the network if not given; a
                number is a node's id.
            radio: name of the node's radio, which is that of the network.
            priority: packets of higher ones leave the queue first; from -128 to 127.
            lifetime_s: after so long in the queue it is dropped, s; it waits for ever if not given.
            key: in the queue a newer packet takes the place of the older one with its key.

        Raises:
            ValueError: ``channel``, ``to`` or ``radio`` cannot be part of a key, the node has no such radio, there is
                no such node or group on its network, or one of the last three cannot be.
            TypeError: ``payload`` is neither bytes nor a message, or one of the first three is no text.
            PermissionError: this is not the node's agent, which alone numbers its packets.
        """
        to = str(to) if isinstance(to, int | np.integer) else to
        for name, text in (("channel", channel), ("to", to), ("radio", radio)):
            if not isinstance(text, str):
                raise TypeError(f"transmit: {name}={text!r} is no text")
        checked_chunk(channel)
        checked_chunk(to)
        self._check_reach(radio, to)
        encoding = encoding_of(type(payload)) if isinstance(payload, Message) else ""
        raw = encode(payload) if isinstance(payload, Message) else _checked_bytes(payload)
        if self.is_over:
            return self.sent
        handling = handling_of(priority, lifetime_s, key)
        return self._give(to, channel, raw, encoding, handling, radio)

    def _give(self, to: str, channel: str, raw: bytes, encoding: str, handling: Handling, radio: str) -> int:
        seq = self.sent
        self._outlet.transmit(to, channel, raw, encoding, Stamp(seq, self.sim_time_ns), handling, radio)
        self.sent += 1
        return seq

    def _check_reach(self, radio: str, to: str) -> None:
        """See that the node has a radio, and who is on its network, as far as that is known."""
        if not self._others:
            checked_chunk(radio)
            return
        if radio not in self._others:
            raise ValueError(f"radio={radio!r}: node {self.node} has {', '.join(self._others)}")
        others = self._others[radio]
        if others and to != ALL and to not in others:
            known = ", ".join((ALL, *others))
            raise ValueError(f"to={to!r}: on radio {radio} node {self.node} reaches {known}")

    def report(self, activity: str, *, done: bool = False, failed: bool = False) -> None:
        """Say what the agent is doing.

        Raises:
            TypeError: ``activity`` is no text.
            ValueError: it is none that UTF-8 has.
        """
        checked_text("report", activity)
        header = Header.at(self.sim_time_ns, self.node)
        self._outlet.report(AgentStatus(header, activity, done, failed, self.sent, self.received))

    def log(self, name: str, value: object) -> None:
        """Record ``value`` under ``name`` with the present sim time; `node/<id>/log/<name>` has it at once.

        Args:
            name: letters, digits, ``_``, ``-`` and ``.``.
            value: a number, a bool, a text, a short vector of numbers, or a flat mapping of names to these (a
                message of one's own); numpy's are taken, too. All values of a name are of one kind.

        Raises:
            TypeError: it is something else, or of another kind than the values before.
            ValueError: it, or its name, is too long, or no text in UTF-8; or there are more than
                LOGGED_MAX values at this tick.
        """
        if self.is_over:
            return
        item = LoggedValue(checked_name(name), checked_value(name, value))
        kind = kind_of(item.value)
        if self._kinds.setdefault(name, kind) != kind:
            raise TypeError(
                f"log({name!r}): {value!r} is a {kind}; the values before were of kind {self._kinds[name]}"
            )
        if self._logged_at_ns != self.sim_time_ns:
            self._logged_at_ns, self._logged = self.sim_time_ns, 0
        if self._logged >= LOGGED_MAX:
            raise ValueError(
                f"log({name!r}): there are {LOGGED_MAX} values at this tick already, which is the limit"
            )
        self._logged += 1
        self._outlet.log(item, self.sim_time_ns)

    # --- commands

    async def command(
        self,
        verb: str,
        goal: CommandGoal | None = None,
        on_feedback: Callable[[CommandEvent], object] | None = None,
    ) -> CommandEvent:
        """Have the aircraft carry out ``verb``; returns the result once it is there.

        Raises:
            CommandRefused: the aircraft says no.
            CommandTimedOut: it does not get there in time, or does not answer.
            CommandInterrupted: another command, a pilot or a reboot came between.
            RunOver: the run ended before the command did; only beside the run.
            CommandFailed: nobody serves the command; base of the four above.
            ValueError: ``verb`` cannot be part of a key, or a text in ``goal`` is none that UTF-8 has.
        """
        checked_chunk(verb)
        goal = goal or CommandGoal()
        checked_text(f"{verb}: mode", goal.mode)
        checked_text(f"{verb}: arguments", goal.arguments)
        if self.is_over:
            raise self._over(verb)
        events: asyncio.Queue[CommandEvent | None] = asyncio.Queue()
        number = next(self._awaited)
        self._commanded[number] = events
        try:
            self._outlet.command(verb, goal, events.put_nowait)
            return await self._result(verb, events, on_feedback)
        finally:
            del self._commanded[number]

    async def _result(
        self,
        verb: str,
        events: asyncio.Queue[CommandEvent | None],
        on_feedback: Callable[[CommandEvent], object] | None,
    ) -> CommandEvent:
        is_answered = False
        while (event := await events.get()) is not None:
            is_answered = True
            if event.phase == CommandEvent.RESULT:
                if not event.success:
                    raise failure(event.outcome, f"UA {self.node}: {verb}: {event.text}")
                return event
            if event.phase == CommandEvent.FEEDBACK:
                if on_feedback is not None:
                    on_feedback(event)
                elif verb == "goto" and event.outcome == REFUSED:
                    self.report(f"{verb}: {event.text}")
        if self.is_over:
            raise self._over(verb)
        if is_answered:
            raise CommandFailed(f"UA {self.node}: {verb}: nobody carried it out to the end")
        raise CommandFailed(
            f"node {self.node}: {verb}: nobody answers: a node on the ground whose agent is free takes no commands"
        )

    def _still_waiting(self) -> TimeoutError:
        return TimeoutError(f"still waiting at {self.sim_time_ns / 1e9:.2f} s of sim time")

    def _over(self, what: str) -> RunOver:
        return RunOver(f"UA {self.node}: {what}: {self._why_over}")

    # --- fed by the host, or by Zenoh

    def enter(self, *, channel: str, payload: bytes, to: str, radio: str) -> None:
        """Give a packet from outside to a radio: it has the node's next number, and the agent hears no more of it."""
        if self.is_over:
            return
        self.radios.setdefault(radio, OwnRadio()).leave_out(
            self._give(to, channel, payload, "", PLAIN, radio)
        )

    def take_clock(self, sim_time_ns: int) -> None:
        """The tick ``sim_time_ns`` has come."""
        if not self._has_clock:  # whoever joins a run waits from here on
            self._has_clock, passed_ns = True, sim_time_ns - self.sim_time_ns
            self._waiters = {
                n: (met, future, at + passed_ns) for n, (met, future, at) in self._waiters.items()
            }
        self.sim_time_ns = sim_time_ns
        for radio in self.radios.values():
            radio.begin()

    def go_on_from(self, stamp: Stamp) -> None:
        """Another one has transmitted as the node before: its next packet has this number, and is no earlier."""
        self.sent = stamp.seq
        self.sim_time_ns = max(self.sim_time_ns, stamp.sim_time_ns)

    def end(self, why: str = "the run is over") -> None:
        """No tick comes any more: whoever waits for a state or a command is told."""
        self.is_over, self._why_over = True, why
        for _, future, _ in tuple(self._waiters.values()):
            if not future.done():
                future.set_exception(self._over("wait_for"))
        for events in self._commanded.values():
            events.put_nowait(None)

    def take_state(self, state: AircraftState) -> None:
        """The aircraft's state: who waits for it goes on."""
        self.told, self.state = state, state if has_fix(state) else None
        if self.state is None:
            return
        if self.sensor is not None:
            self.measurements.take_state(self.sim_time_ns, state)
        for condition, future, _ in tuple(self._waiters.values()):
            if future.done():
                continue
            try:
                if condition(state):
                    future.set_result(state)
            except Exception as error:  # somebody's own code: it is for whoever waits
                future.set_exception(error)

    def take_warning(self, text: str) -> None:
        """The autopilot warns of something."""
        self.warning = text

    def take_comm_status(self, look: LookAtStatus) -> None:
        """Which other nodes were heard: ``look`` is called if the agent wants to know."""
        self._new_comm_status = look

    def take_measurements(self, measurements: Sequence[Measurement]) -> None:
        """What the RF sensor measured at the tick before, or nothing; raises what the callbacks raise."""
        self.measurements.take(measurements)
        for measurement in self.measurements:
            for callback in self._on_measurement:
                callback(measurement)

    def take_packet(self, sender: str, channel: str, payload: bytes, reception: Reception) -> None:
        """A packet that the radio delivered; raises what the callbacks raise."""
        self.received += 1
        for callback, wanted in self._on_packet:
            if channel == wanted or (not wanted and channel != IP):
                callback(sender, channel, payload, reception)

    def tick(self) -> None:
        """All that came with this tick was taken: end waits whose time is up, and call the callbacks.

        What these raise is passed on.
        """
        for _, future, deadline_ns in tuple(self._waiters.values()):
            if self.sim_time_ns > deadline_ns - ROUNDING_NS and not future.done():
                future.set_exception(self._still_waiting())
        for callback in self._on_tick:
            callback(self.sim_time_ns)


def _check_callback(event: str, callback: Callable[..., object]) -> None:
    """See that a callback takes what it will be called with: then an error is told with the line that gave it."""
    try:
        wrong = wrong_call(inspect.signature(callback), CALLED_WITH[event])
    except (TypeError, ValueError):  # a function of C may have no signature
        if callable(callback):
            return
        raise TypeError(f"{event}: {callback!r} is no function") from None
    if wrong:
        raise TypeError(f"{event}: {getattr(callback, '__qualname__', repr(callback))} {wrong}")


def _checked_bytes(payload: object) -> bytes:
    """What is transmitted, as it is now."""
    if isinstance(payload, bytes | bytearray | memoryview):
        return bytes(payload)
    raise TypeError(f"transmit: a payload of type {type(payload).__name__}; allowed is bytes or a message")
