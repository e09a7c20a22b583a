"""The daemon's logic: state, streams, commands and routing of one UA. No I/O, no asyncio, no clock.

Frames and instants go in; what is to be sent is put into the queues in front of the links. Who reads the
links, writes the queues and says what time it is are the shells: ``aps.daemon`` by wall time,
``aps.held`` by sim time.
"""

from __future__ import annotations

import logging
import struct
from collections.abc import Callable
from dataclasses import asdict
from typing import Any, Final, Protocol

from aps.acks import FOREIGN, AckLedger
from aps.callbacks import Callbacks
from aps.commander import Commander
from aps.config import NS_PER_S, DaemonConfig
from aps.dialect import (
    AUTOPILOT_COMPID,
    ONBOARD_COMPUTER_COMPID,
    Encoder,
    mavlink,
    onboard_computer_heartbeat,
    set_message_interval,
)
from aps.framer import Frame, Framer
from aps.routing import Router
from aps.status_text import STATUSTEXT_ID, StatusText, StatusTextAssembler
from aps.streams import StreamArbiter, command_of
from aps.subscription import Subscriptions
from aps.telemetry import Telemetry
from aps.timeouts import HEARTBEAT_PERIOD_S, SILENCE_TIMEOUT_S, SILENT_HEARTBEATS

__all__ = ["AUTOPILOT_LINK", "Core", "Queue"]

AUTOPILOT_LINK: Final = 0
"""Link id of the autopilot; clients have others."""
HEARTBEAT_PERIOD_NS: Final = round(HEARTBEAT_PERIOD_S * NS_PER_S)

_HEARTBEAT: Final = 0
_PARAM_VALUE: Final = 22
_COMMAND_ACK: Final = 77
_PARAM_VALUE_START: Final = struct.Struct("<fHH16s")
_ACK: Final = struct.Struct("<HBBiBB")
_ACCEPTED: Final = int(mavlink.MAV_RESULT_ACCEPTED)
_IN_PROGRESS: Final = int(mavlink.MAV_RESULT_IN_PROGRESS)

_log = logging.getLogger(__name__)


class Queue(Protocol):
    """What waits to be sent on one link."""

    def put(self, frame: bytes) -> None:
        """Queue one frame."""


class Core:
    """One UA's daemon without its links.

    Args:
        config: its settings.
        to_autopilot: what waits to be sent to the autopilot.
        clock: the shell's clock, ns, for what users start and ask between two events.
        wake: called when a command has queued messages or changed deadlines.
        silence_s: for how long, by that clock, the autopilot's may stand still under an accepted command.

    Every event takes ``now_ns``, an instant of the same clock; instants never go back.
    """

    def __init__(
        self,
        config: DaemonConfig,
        to_autopilot: Queue,
        clock: Callable[[], int],
        wake: Callable[[], None],
        silence_s: float = SILENCE_TIMEOUT_S,
    ) -> None:
        self.config = config
        self.telemetry = Telemetry(config.sysid)
        self.streams = StreamArbiter(config.stream_rates_hz)
        self.router = Router(
            config.sysid,
            ONBOARD_COMPUTER_COMPID,
            AUTOPILOT_COMPID,
            round(config.route_expiry_s * NS_PER_S),
        )
        self.framer = Framer()
        self.acks = AckLedger()
        self.callbacks = Callbacks()
        self.subscriptions = Subscriptions(self.callbacks)
        self.commands = Commander(
            lambda: self.telemetry.state(clock()), self._send, clock, wake, self.callbacks, silence_s
        )
        self.texts: Callable[[StatusText], None] | None = None
        """Called with each text of the autopilot, if set."""
        self.on_heard: Callable[[], None] | None = None
        """Called with the first heartbeat of each connection, if set."""
        self.link_up = False
        self.heard = False
        """Whether the autopilot's heartbeat has been heard on this connection."""
        self._encoder = Encoder(config.sysid, ONBOARD_COMPUTER_COMPID)
        self._assembler = StatusTextAssembler()
        self._to_autopilot = to_autopilot
        self._queues: dict[int, Queue] = {AUTOPILOT_LINK: to_autopilot}
        self._foreign: set[int] = set()
        self._silent_heartbeats = 0
        self._clock_ms = 0
        self._heartbeat_due_ns = 0
        self.router.add_link(AUTOPILOT_LINK, autopilot=True)

    def statistics(self) -> dict[str, Any]:
        """Counters of the logic, as plain data."""
        return {
            "routes": {outcome.value: count for outcome, count in self.router.counters.items()},
            "decode_errors": self.telemetry.decode_errors,
            "streams": asdict(self.streams.counters),
            "acknowledgements": asdict(self.acks.counters),
            "callback_errors": self.callbacks.errors,
        }

    # The autopilot's link.

    def autopilot_up(self, now_ns: int) -> None:
        """There is a connection."""
        self.link_up = True
        self.framer.reset()
        self.acks.forget()
        self.heard = False
        self._heartbeat_due_ns = now_ns  # introduce ourselves at once
        self.commands.on_link(True)

    def autopilot_down(self) -> None:
        """The connection is gone."""
        self.link_up = self.heard = False
        self.streams.disconnected()
        self.commands.on_link(False)

    def autopilot_data(self, data: bytes, now_ns: int) -> None:
        """Bytes from the autopilot, in any chunking."""
        own = self.config.sysid
        changed = False
        for frame in self.framer.receive(data):
            if frame.compid == AUTOPILOT_COMPID:
                if frame.sysid == own:
                    changed |= self._from_autopilot(frame, now_ns)
                    if self.subscriptions.due(self.telemetry.clock_ms):
                        self.subscriptions.offer_due(self.telemetry.state(now_ns))
                else:
                    self._from_foreign(frame)
            for link in self.router.route(frame, AUTOPILOT_LINK, now_ns).links:
                self._queues[link].put(frame.raw)
        if changed:
            self._state_changed(now_ns)

    def _from_autopilot(self, frame: Frame, now_ns: int) -> bool:
        """Feed state, streams and commands; returns whether the state may have changed."""
        reboots = self.telemetry.reboots
        if self.telemetry.update(frame, now_ns):
            if self.telemetry.reboots != reboots:
                self._autopilot_rebooted(now_ns)
            if frame.msg_id == _HEARTBEAT:
                self._autopilot_heartbeat(now_ns)
            return True
        if frame.msg_id == _COMMAND_ACK:
            self._command_ack(frame, now_ns)
        elif frame.msg_id == STATUSTEXT_ID:
            self._status_text(frame)
        elif frame.msg_id == _PARAM_VALUE:
            self._parameter(frame)
            return True
        return False

    def _parameter(self, frame: Frame) -> None:
        payload = frame.payload.ljust(_PARAM_VALUE_START.size, b"\0")
        value, _, _, name = _PARAM_VALUE_START.unpack_from(payload)
        self.commands.on_parameter(name.split(b"\0", 1)[0].decode("ascii", "replace"), value)

    def _from_foreign(self, frame: Frame) -> None:
        if frame.msg_id == _HEARTBEAT and frame.sysid not in self._foreign:
            self._foreign.add(frame.sysid)
            _log.warning(
                "the autopilot at %s calls itself system %d, expected %d (--sysid)",
                self.config.autopilot,
                frame.sysid,
                self.config.sysid,
            )

    def _autopilot_heartbeat(self, now_ns: int) -> None:
        self.acks.heartbeat()
        clock_ms = self.telemetry.clock_ms
        self._silent_heartbeats = 0 if clock_ms != self._clock_ms else self._silent_heartbeats + 1
        self._clock_ms = clock_ms
        if not self.heard:
            self.heard = True
            _log.info(
                "autopilot of system %d heard: %s", self.config.sysid, self.telemetry.state(now_ns).mode
            )
            self.callbacks.call("the callback for the first heartbeat", self.on_heard)
        elif self._silent_heartbeats < SILENT_HEARTBEATS or not self.streams.idle:
            return
        else:
            _log.info("nothing but heartbeats from the autopilot: asking for its streams anew")
        self._silent_heartbeats = 0
        self._ask_for_streams(now_ns)

    def _autopilot_rebooted(self, now_ns: int) -> None:
        _log.warning("the autopilot's clock went back: it has rebooted")
        self.acks.forget()
        self.commands.interrupt_all("the autopilot rebooted")
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

    def _status_text(self, frame: Frame) -> None:
        text = self._assembler.take(frame)
        if text is not None:
            _log.info("autopilot: %s", text.text)
            self.commands.on_text(text)
            self.callbacks.call("the callback for texts", self.texts, text)

    def _state_changed(self, now_ns: int) -> None:
        if self.subscriptions:
            self.subscriptions.offer(self.telemetry.state(now_ns))
        if self.commands.busy:
            self.commands.poll()

    # The clients' links.

    def client_opened(self, link: int, queue: Queue) -> None:
        """A client is there; ``queue`` is what waits to be sent to it."""
        self.router.add_link(link)
        self._queues[link] = queue

    def client_closed(self, link: int) -> None:
        """A client is gone, and its wishes with it (see ``on_time`` for what follows from that)."""
        self.router.remove_link(link)
        del self._queues[link]
        self.streams.client_left(link)

    def client_frame(self, frame: Frame, link: int, now_ns: int) -> None:
        """A frame from a client (call ``on_time`` after the last of several)."""
        for other in self.router.route(frame, link, now_ns).links:
            raw: bytes | None = frame.raw
            if other == AUTOPILOT_LINK:
                self._note_command(frame)
                raw = self.streams.client_frame(frame, link)
            if raw is not None:
                self._queues[other].put(raw)

    def _note_command(self, frame: Frame) -> None:
        """Remember a client's command to the autopilot: its answer must not be taken for one of ours."""
        command = command_of(frame)
        ours = frame.target_system in (0, self.config.sysid)
        if command is not None and ours and frame.target_component in (0, AUTOPILOT_COMPID):
            self.acks.sent(command, frame.sysid, frame.compid, FOREIGN)

    # Our own messages, and time.

    def _send(self, messages: list[Any], request: object) -> None:
        """Queue messages; ``request`` waits for the acknowledgement of those that are commands."""
        for message in messages:
            self._to_autopilot.put(self._encoder.encode(message))
            command = getattr(message, "command", None)
            if command is not None:
                self.acks.sent(command, self.config.sysid, ONBOARD_COMPUTER_COMPID, request)

    def _pump_streams(self, now_ns: int) -> None:
        request = self.streams.poll(now_ns)
        if request is not None:
            self._send([set_message_interval(self.config.sysid, *request)], self.streams.request)

    def deadline_ns(self) -> int:
        """When ``on_time`` is due even if nothing happens."""
        deadlines = (self._heartbeat_due_ns, self.streams.deadline_ns(), self.commands.deadline_ns())
        return min(deadline for deadline in deadlines if deadline is not None)

    def on_time(self, now_ns: int) -> None:
        """Do what is due: heartbeat, expiry of routes, stream requests, commands."""
        if now_ns >= self._heartbeat_due_ns:
            self._heartbeat_due_ns = now_ns + HEARTBEAT_PERIOD_NS
            if self.link_up:
                # To the autopilot alone: a script that takes the first heartbeat for the vehicle's would take ours.
                self._send([onboard_computer_heartbeat()], None)
            self.router.expire(now_ns)
        self._pump_streams(now_ns)
        if self.commands.busy:
            self.commands.poll()
