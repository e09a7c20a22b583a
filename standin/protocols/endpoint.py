"""The MAVLink side without I/O: a client's bytes and the simulation time in, bytes out."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable

from pymavlink.dialects.v20 import ardupilotmega as dialect

from standin.protocols import absent
from standin.protocols.commands import CommandProtocol, request_from
from standin.protocols.flow import BUFFER_BYTES, FlowControl
from standin.protocols.mission_protocol import MissionProtocol
from standin.protocols.parameter_protocol import ParameterProtocol
from standin.protocols.streams import Streams
from standin.protocols.targets import fly_global_target, fly_local_target, hold_sticks
from standin.protocols.telemetry import TelemetryProtocol
from standin.vehicle.events import Event, HomeChanged, ItemReached, ModeChanged, TextEvent
from standin.vehicle.vehicle import StandinVehicle
from standin.wire.mavlink_codec import MavlinkCodec, Message

SLOW_STEP_NS = 10_000_000
STATUS_TEXT_BYTES = 50
TEXT_ID_MAX = 65_535
NS_PER_MS = 1_000_000
LIST_STRETCH = 4
"""Streams are so many times as slow while a list of parameters goes out (`get_reschedule_interval_ms`)."""
PARAMETER_FRAME_BYTES = 37
"""PARAM_VALUE in MAVLink 2, at its longest."""


class MavlinkEndpoint:
    """Speaks MAVLink for one vehicle with one client at a time, at one of its ports.

    Args:
        vehicle: whose port it is.
        boot_unix_us: GPS time at boot.
        baud: of the port's line; 0: bytes leave at once.

    Attributes:
        told_together: all ports of the vehicle, which are told what happens to it.
    """

    def __init__(self, vehicle: StandinVehicle, boot_unix_us: int, baud: int = 0) -> None:
        self._vehicle = vehicle
        self.told_together: tuple[MavlinkEndpoint, ...] = (self,)
        self.flow = FlowControl(baud)
        self._codec = MavlinkCodec(round(vehicle.parameters["MAV_SYSID"]))
        self._telemetry = TelemetryProtocol(vehicle, boot_unix_us)
        self.streams = Streams()
        self._commands = CommandProtocol(vehicle, self._telemetry, self.streams)
        self._missions = MissionProtocol(vehicle, self._telemetry, self._send)
        self._parameters = ParameterProtocol(vehicle.parameters, self._send)
        self._parameter_due_ns = 0
        self._handlers: dict[str, Callable[[Message], None]] = {
            "COMMAND_LONG": self._run_command,
            "COMMAND_INT": self._run_command,
            **self._missions.handlers,
            **self._parameters.handlers,
            **absent.handlers(self._send),
            "SET_MODE": self._set_mode,
            "SET_POSITION_TARGET_LOCAL_NED": lambda message: fly_local_target(vehicle, message),
            "SET_POSITION_TARGET_GLOBAL_INT": lambda message: fly_global_target(vehicle, message),
            "RC_CHANNELS_OVERRIDE": lambda message: hold_sticks(vehicle, message),
            "MANUAL_CONTROL": lambda message: hold_sticks(vehicle, message),
            "REQUEST_DATA_STREAM": self._stream_group,
            "TIMESYNC": self._answer_timesync,
            "RADIO_STATUS": self._slow_down,
        }
        self._inbox: list[Message] = []
        self._out = bytearray()
        self._connected = False
        self._slow_due_ns = 0
        self._text_id = 0
        """Of the last text that was sent in chunks."""
        self.ignored: Counter[str] = Counter()
        """Messages that were understood but not used, by type or reason."""

    def connect(self) -> None:
        """A client is there: what streams was asked for before goes on."""
        self._connected = True
        self._codec.reset()
        self._out.clear()

    def disconnect(self) -> None:
        """The client is gone."""
        self._connected = False
        self._out.clear()

    def receive(self, data: bytes) -> None:
        """Take bytes from the client; they take effect at ``obey``."""
        self._inbox += self._codec.receive(data)

    def obey(self) -> None:
        """Do what the client has asked for; answers wait in ``data_to_send``."""
        if not self._inbox:
            return
        inbox, self._inbox = self._inbox, []
        for message in inbox:
            self._handle(message)
            self._flush_events()

    def report(self) -> None:
        """Send what is due at the vehicle's time: events, streams, lists under way."""
        now_ns = self._vehicle.sim_time_ns
        if self._vehicle.has_events:
            self._flush_events()
        if now_ns >= self._slow_due_ns:
            self._slow_due_ns = now_ns + SLOW_STEP_NS
            self._missions.step()
            self._go_on_with_list(now_ns)
        if now_ns >= self.streams.next_due_ns and self._has_room:
            stretch = LIST_STRETCH if self._parameters.is_listing and self.flow.baud else 1
            for message_id in self.streams.take_due(now_ns, self.flow.slowdown_ms * NS_PER_MS, stretch):
                self._send_by_id(message_id)

    def _go_on_with_list(self, now_ns: int) -> None:
        """Send the next parameters of a list, as far as the port's line and its modem have room."""
        if not self.flow.baud:
            self._parameters.step()
        elif now_ns >= self._parameter_due_ns and self._has_room and self.flow.takes_parameters(now_ns):
            self._parameters.step(1)
            self._parameter_due_ns = now_ns + self.flow.parameter_interval_ns(PARAMETER_FRAME_BYTES)

    @property
    def _has_room(self) -> bool:
        """Whether what can wait need not wait for the port's line."""
        return not self.flow.baud or len(self._out) < BUFFER_BYTES

    def data_to_send(self) -> bytes:
        """Return and forget the bytes for the client that have left over the port's line."""
        count = self.flow.leaves_bytes(len(self._out), self._vehicle.sim_time_ns)
        data = bytes(self._out[:count])
        del self._out[:count]
        return data

    @property
    def has_data(self) -> bool:
        """Whether ``data_to_send`` would return any."""
        return bool(self._out)

    # --- out

    def _send(self, message: Message) -> None:
        if self._connected:
            self._out += self._codec.pack(message)

    def _send_by_id(self, message_id: int) -> None:
        message = self._telemetry.builders[message_id]() if self._connected else None
        if message is not None:
            self._send(message)

    def _flush_events(self) -> None:
        for event in self._vehicle.take_events():
            for port in self.told_together:
                port._tell(event)

    def _tell_text(self, event: TextEvent) -> None:
        """Send a text; a long one in chunks, of which the last is not full, as ArduPilot (``GCS::send_textv``)."""
        text, end = event.text.encode("ascii", "replace"), 1
        text_id = 0
        if len(text) > STATUS_TEXT_BYTES:
            self._text_id = text_id = self._text_id % TEXT_ID_MAX + 1
            end = len(text) + 1
        for number, at in enumerate(range(0, end, STATUS_TEXT_BYTES)):
            chunk = text[at : at + STATUS_TEXT_BYTES]
            self._send(dialect.MAVLink_statustext_message(int(event.severity), chunk, text_id, number))

    def _tell(self, event: Event) -> None:
        if isinstance(event, TextEvent):
            self._tell_text(event)
        elif isinstance(event, ItemReached):
            self._send(dialect.MAVLink_mission_item_reached_message(event.seq))
        elif isinstance(event, HomeChanged):
            self._send_by_id(dialect.MAVLINK_MSG_ID_HOME_POSITION)
        elif isinstance(event, ModeChanged):
            self.streams.hasten(dialect.MAVLINK_MSG_ID_HEARTBEAT, self._vehicle.sim_time_ns)

    # --- in

    def _handle(self, message: Message) -> None:
        handler = self._handlers.get(message.get_type())
        if not self._for_us(message):
            self.ignored["other_target"] += 1
        elif handler is None:
            self.ignored[message.get_type()] += 1
        else:
            handler(message)

    def _for_us(self, message: Message) -> bool:
        """Whether it is for our system; ArduPilot, too, takes what is for a component that it does not know."""
        return getattr(message, "target_system", 0) in (0, self._codec.system)

    def _run_command(self, message: Message) -> None:
        request = request_from(message)
        result = int(self._commands.run(request))
        sender = (message.get_srcSystem(), message.get_srcComponent())
        self._send(dialect.MAVLink_command_ack_message(request.command, result, 0, 0, *sender))
        for requested in self._commands.take_requested():
            self._send(requested)

    def _set_mode(self, message: Message) -> None:
        self._vehicle.set_mode(message.custom_mode)  # no acknowledgement, as in ArduPilot

    def _stream_group(self, message: Message) -> None:
        rate_hz = message.req_message_rate if message.start_stop else 0
        self.streams.set_group(message.req_stream_id, rate_hz, self._vehicle.sim_time_ns)

    def _slow_down(self, message: Message) -> None:
        self.flow.radio_status(message.txbuf, self._vehicle.sim_time_ns)

    def _answer_timesync(self, message: Message) -> None:
        if message.tc1 == 0:
            self._send(dialect.MAVLink_timesync_message(self._vehicle.sim_time_ns, message.ts1))
