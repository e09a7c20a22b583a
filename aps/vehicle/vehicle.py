"""One vehicle as the daemon sees it: state, streams and commands. No I/O, no asyncio, no clock.

Frames of its autopilot and instants go in; what is to be said to it is handed to ``put``. The hub, which
forwards frames, is not known here.
"""

from __future__ import annotations

import logging
import re
import struct
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import asdict
from typing import Any, Final

from aps.callbacks import Callbacks
from aps.timeouts import SILENCE_TIMEOUT_S, SILENT_HEARTBEATS
from aps.vehicle.acks import FOREIGN, AckLedger
from aps.vehicle.autopilots.choice import autopilot_of
from aps.vehicle.commander import Commander
from aps.vehicle.events import EVENT_ID, EventTexts
from aps.vehicle.execution import CommandResult
from aps.vehicle.messages import MessageBoard
from aps.vehicle.parameters.ftp import ReadExecution
from aps.vehicle.status_text import STATUSTEXT_ID, StatusText, StatusTextAssembler
from aps.vehicle.sticks import MiddleStick
from aps.vehicle.streams import StreamArbiter, StreamWish, command_of
from aps.vehicle.subscription import Subscriptions
from aps.vehicle.telemetry import Telemetry
from aps.wire.dialect import (
    AUTOPILOT_COMPID,
    ONBOARD_COMPUTER_COMPID,
    Encoder,
    mavlink,
    message_fields,
    message_name,
    onboard_computer_heartbeat,
    set_message_interval,
)
from aps.wire.framer import Frame

FOREIGN_HEARTBEATS: Final = 3
_HEARTBEAT: Final = 0
_COMMANDS: Final = frozenset({75, 76})
"""COMMAND_INT and COMMAND_LONG: what is answered by a COMMAND_ACK."""
_PARAM_VALUE: Final = 22
_COMMAND_ACK: Final = 77
_ACK: Final = struct.Struct("<HBBiBB")
EVENT_MARK: Final = "\t"
"""PX4 ends texts with it that are events as well."""
_NO_STREAM: Final = re.compile(rb"No ap_message for mavlink id \((\d+)\)")
_ACCEPTED: Final = int(mavlink.MAV_RESULT_ACCEPTED)
_IN_PROGRESS: Final = int(mavlink.MAV_RESULT_IN_PROGRESS)

_log = logging.getLogger(__name__)


def _fields(frame: Frame) -> dict[str, Any]:
    """The fields of a frame; of PARAM_VALUE with the bytes of its value, which may be those of a whole number."""
    fields = message_fields(frame.raw)
    if frame.msg_id == _PARAM_VALUE and fields:
        fields["param_bytes"] = frame.payload[:4].ljust(4, b"\0")
    return fields


class Vehicle:
    """State, streams and commands of one vehicle.

    Args:
        sysid: its system id, which is ours as well.
        stream_rates_hz: message id -> rate that we ask for ourselves.
        put: sends the bytes of one frame to the autopilot.
        clock: what time it is, ns, for what users start and ask between two events.
        wake: called when a command has queued messages or changed deadlines.
        silence_s: for how long, by that clock, the autopilot's may stand still under an accepted command.
        name: what the autopilot is called in the log.
        middle_stick: whether to hold a copter's throttle stick in the middle where a mode reads it.

    Every event takes ``now_ns``, an instant of the same clock; instants never go back.
    """

    def __init__(
        self,
        sysid: int,
        stream_rates_hz: Mapping[int, float],
        put: Callable[[bytes], None],
        clock: Callable[[], int],
        wake: Callable[[], None],
        silence_s: float = SILENCE_TIMEOUT_S,
        name: str = "",
        *,
        middle_stick: bool = False,
    ) -> None:
        self.sysid = sysid
        self.telemetry = Telemetry(sysid)
        self.streams = StreamArbiter(stream_rates_hz)
        self.acks = AckLedger()
        self.callbacks = Callbacks()
        self.messages = MessageBoard()
        """The autopilot's messages, the last of each type."""
        self.subscriptions = Subscriptions(self.callbacks)
        self.commands = Commander(
            lambda: self.telemetry.state(clock()), self._send, clock, wake, self.callbacks, silence_s
        )
        self._stick = MiddleStick(sysid, put) if middle_stick else None
        if self._stick is not None:
            self.commands.on_flight = self._stick.flight_begins
        self.texts: Callable[[StatusText], None] | None = None
        """Called with each text of the autopilot, if set."""
        self.text_listeners: list[Callable[[StatusText], None]] = []
        """Called likewise."""
        self.on_heard: Callable[[], None] | None = None
        """Called with the first heartbeat of each connection, if set."""
        self.on_foreign: Callable[[int], None] | None = None
        """Called, if set, with the system id of an autopilot that is heard in place of ours, which never was: with its
        third heartbeat, as what hands on others' heartbeats may begin with one of them."""
        self.heard = False
        """Whether the autopilot's heartbeat has been heard on this connection."""
        self.events = EventTexts()
        """What the autopilot's events mean."""
        self._clock = clock
        self._name = name
        self._put = put
        self._encoder = Encoder(sysid, ONBOARD_COMPUTER_COMPID)
        self._assembler = StatusTextAssembler()
        self._foreign: Counter[int] = Counter()
        """Heartbeats of other systems' autopilots."""
        self._ever_heard = False
        self._silent_heartbeats = 0
        self._clock_ms = 0

    def statistics(self) -> dict[str, Any]:
        """Counters, as plain data."""
        return {
            "decode_errors": self.telemetry.decode_errors,
            "streams": asdict(self.streams.counters),
            "acknowledgements": asdict(self.acks.counters),
            "callback_errors": self.callbacks.errors,
            "other_systems": sorted(self._foreign),
        }

    # What happens.

    def link_up(self) -> None:
        """There is a connection to the autopilot."""
        self.acks.forget()
        self.telemetry.link_up()
        self.heard = False
        self.commands.on_link(True)

    def link_down(self, *, another: bool = False) -> None:
        """The connection is gone; ``another``: there is one in its place."""
        self.heard = False
        self.streams.disconnected()
        if not another:
            self.telemetry.link_down()
            self.commands.on_link(False)

    def receive(self, frame: Frame, now_ns: int) -> bool:
        """A frame from the autopilot's link; returns whether the state may have changed (see ``state_changed``)."""
        _, msg_id, sysid, compid, _, _, _, _ = frame
        if compid != AUTOPILOT_COMPID:
            return False
        if sysid != self.sysid:
            self._from_foreign(frame)
            return False
        self.messages.take(frame, now_ns)
        changed = self._from_autopilot(frame, now_ns)
        commands = self.commands
        if commands.busy and commands.wants(msg_id) and self._is_for_us(frame):
            commands.on_message(message_name(msg_id), _fields(frame))
        if self.subscriptions.rated and self.subscriptions.due(self.telemetry.clock_ms):
            self.subscriptions.offer_due(self.telemetry.state(now_ns))
        return changed

    def answers_us(self, frame: Frame) -> bool:
        """Whether a STATUSTEXT is ArduPilot's word on a stream that we have asked for and it does not have."""
        found = _NO_STREAM.match(frame.payload[1:])
        return found is not None and self.streams.asks_for(int(found[1]))

    def state_changed(self, now_ns: int) -> None:
        """Call subscribers and commands, after all frames that came at once."""
        if self.subscriptions:
            self.subscriptions.offer(self.telemetry.state(now_ns))
        if self._stick is not None:
            telemetry = self.telemetry
            self._stick.state_changed(telemetry.mode, telemetry.armed, telemetry.clock_ms)
        if self.commands.busy:
            self.commands.poll()

    def client_frame(self, frame: Frame, link: int) -> bytes | None:
        """A client's frame on its way to the autopilot's link: the bytes to pass on, or ``None``."""
        if not self._is_for_autopilot(frame):
            return frame.raw  # another vehicle or component is behind the link, too
        raw = self.streams.client_frame(frame, link)
        if self._stick is not None:
            self._stick.client_frame(frame)
        if raw is not None:
            self._note_command(frame)
        return raw

    def client_left(self, link: int) -> None:
        """A client is gone, and its wishes with it (see ``on_time`` for what follows from that)."""
        self.streams.client_left(link)

    def heartbeat(self) -> bytes:
        """Our own heartbeat, for the autopilot's links."""
        return self._encoder.encode(onboard_computer_heartbeat())

    def timesync(self, ts1_ns: int) -> bytes:
        """A request for the autopilot's time; the answer brings ``ts1_ns`` back."""
        return self._encoder.encode(mavlink.MAVLink_timesync_message(0, ts1_ns))

    def deadline_ns(self) -> int | None:
        """When ``on_time`` is due even if nothing happens."""
        commands_ns = self.commands.deadline_ns() if self.commands.busy else None
        first_ns = self._assembler.due_ns
        for due_ns in (self.streams.deadline_ns(), commands_ns):  # no generator: it is asked after each read
            if due_ns is not None and (first_ns is None or due_ns < first_ns):
                first_ns = due_ns
        return first_ns

    def on_time(self, now_ns: int) -> None:
        """Do what is due: stream requests, texts whose end has not come, commands."""
        self._tell_texts(self._assembler.overdue(now_ns))
        self._pump_streams(now_ns)
        if self.commands.busy:
            self.commands.poll()

    # The autopilot's messages.

    def _from_autopilot(self, frame: Frame, now_ns: int) -> bool:
        """Feed state, streams and commands; returns whether the state may have changed."""
        telemetry = self.telemetry
        reboots = telemetry.reboots
        if telemetry.update(frame, now_ns):
            if telemetry.reboots != reboots:
                self._autopilot_rebooted(now_ns)
            if frame.msg_id == _HEARTBEAT:
                self._autopilot_heartbeat(now_ns)
            return True
        if frame.msg_id == _COMMAND_ACK:
            self._command_ack(frame, now_ns)
        elif frame.msg_id == STATUSTEXT_ID:
            self._status_text(frame, now_ns)
        elif frame.msg_id == EVENT_ID:
            self._tell_text(self.events.take(frame, self.telemetry.custom_mode))
        return False

    def _is_for_autopilot(self, frame: Frame) -> bool:
        """Whether a message is addressed to the autopilot, or to everybody."""
        return frame.target_system in (0, self.sysid) and frame.target_component in (0, AUTOPILOT_COMPID)

    def _is_for_us(self, frame: Frame) -> bool:
        """Whether a message is addressed to us, or to everybody."""
        if frame.target_system == 0:
            return True
        return frame.target_system == self.sysid and frame.target_component in (0, ONBOARD_COMPUTER_COMPID)

    def _from_foreign(self, frame: Frame) -> None:
        if frame.msg_id == _PARAM_VALUE and self.commands.wants(_PARAM_VALUE):
            self.commands.on_other_system(frame.sysid, _fields(frame))
        if frame.msg_id != _HEARTBEAT:
            return
        self._foreign[frame.sysid] += 1
        if self._foreign[frame.sysid] == 1:
            _log.warning(
                "the autopilot at %s calls itself system %d, expected %d (--sysid)",
                self._name,
                frame.sysid,
                self.sysid,
            )
        if self._foreign[frame.sysid] == FOREIGN_HEARTBEATS and not self._ever_heard:
            self.callbacks.call("the callback for a foreign system", self.on_foreign, frame.sysid)

    def _autopilot_heartbeat(self, now_ns: int) -> None:
        self.acks.heartbeat()
        clock_ms = self.telemetry.clock_ms
        self._silent_heartbeats = 0 if clock_ms != self._clock_ms else self._silent_heartbeats + 1
        self._clock_ms = clock_ms
        if not self.heard:
            self.heard = self._ever_heard = True
            _log.info("autopilot of system %d heard: %s", self.sysid, self.telemetry.state(now_ns).mode)
            self.callbacks.call("the callback for the first heartbeat", self.on_heard)
            self._fetch_events()
        elif self._silent_heartbeats < SILENT_HEARTBEATS or not self.streams.idle:
            return
        else:
            _log.info("nothing but heartbeats from the autopilot: asking for its streams anew")
        self._silent_heartbeats = 0
        self.streams.twins = autopilot_of(self.telemetry.autopilot).stream_twins
        self._ask_for_streams(now_ns)

    def _autopilot_rebooted(self, now_ns: int) -> None:
        _log.warning("the autopilot's clock went back: it has rebooted")
        self.acks.forget()
        self.messages.forget()
        self.commands.on_reboot()
        self._ask_for_streams(now_ns)

    def _ask_for_streams(self, now_ns: int) -> None:
        self.streams.connected()
        self._pump_streams(now_ns)

    def _command_ack(self, frame: Frame, now_ns: int) -> None:
        payload = frame.payload.ljust(_ACK.size, b"\0")
        command, result, progress, _, system, component = _ACK.unpack_from(payload)
        request = self.acks.answered(command, system, component, final=result != _IN_PROGRESS)
        if request is FOREIGN:
            return
        if isinstance(request, StreamWish):
            if result not in (_ACCEPTED, _IN_PROGRESS):
                self.streams.denied(request)
                self._pump_streams(now_ns)
            return
        counters = self.acks.counters
        if request is None:
            counters.stray += 1
        elif request is self.streams.request:
            counters.matched += 1
            self.streams.acknowledged(result == _ACCEPTED)
            self._pump_streams(now_ns)
        elif self.commands.on_ack(request, command, result, progress):
            counters.matched += 1
        else:
            counters.late += 1

    def _status_text(self, frame: Frame, now_ns: int) -> None:
        if self.answers_us(frame):
            return
        self._tell_texts(self._assembler.take(frame, now_ns))

    def _tell_texts(self, texts: list[StatusText]) -> None:
        for text in texts:
            if not text.text.endswith(EVENT_MARK):
                self._tell_text(text)
            elif not self.events.known:  # else an event says the same
                self._tell_text(StatusText(text.severity, text.text.rstrip(EVENT_MARK)))

    def _tell_text(self, text: StatusText | None) -> None:
        if text is not None:
            _log.info("autopilot: %s", text.text)
            self.commands.on_text(text)
            for listener in (self.texts, *self.text_listeners):
                self.callbacks.call("the callback for texts", listener, text)

    def _fetch_events(self) -> None:
        """Get what the autopilot's events mean from itself, where it has that and files may be read."""
        path = autopilot_of(self.telemetry.autopilot).events_path
        if path and self.commands.ftp and not self.events.known:
            reading = ReadExecution(self.telemetry.state(self._clock()), path, "events")
            self.commands.begin(reading, on_done=self._events_fetched)

    def _events_fetched(self, result: CommandResult) -> None:
        try:
            if not result.reached:
                raise ValueError(str(result))
            self.events.learn(result.value)
        except ValueError as error:
            _log.info("the autopilot's events are told by number: %s", error)

    # Our own messages.

    def _note_command(self, frame: Frame) -> None:
        """Remember a client's command to the autopilot: its answer must not be taken for one of ours."""
        command = command_of(frame)
        if command is not None:
            self.acks.sent(command, frame.sysid, frame.compid, self.streams.wish(frame) or FOREIGN)
            self.commands.command_sent(command)

    def _send(self, messages: list[Any], request: object) -> None:
        """Queue messages; ``request`` waits for the acknowledgement of those that are commands, if anything does."""
        for message in messages:
            self._put(self._encoder.encode(message))
            if message.get_msgId() in _COMMANDS:
                waits = FOREIGN if request is None else request
                self.acks.sent(message.command, self.sysid, ONBOARD_COMPUTER_COMPID, waits)
                self.commands.command_sent(message.command)

    def _pump_streams(self, now_ns: int) -> None:
        request = self.streams.poll(now_ns)
        if request is not None:
            self._send([set_message_interval(self.sysid, *request)], self.streams.request)
