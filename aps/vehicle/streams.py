"""Who gets which message how often: the daemon owns the autopilot's stream rates. No I/O, no clock.

An autopilot's link has one interval per message, so the last client to ask would decide for all. Here the
daemon keeps its own default set and every client's wishes apart, and asks the autopilot for the fastest of
them; a client that leaves takes its wishes with it, and all is asked for anew when the autopilot reboots or
the link comes back.

Clients ask with MAV_CMD_SET_MESSAGE_INTERVAL (COMMAND_LONG or COMMAND_INT) or REQUEST_DATA_STREAM:

- a SET_MESSAGE_INTERVAL is passed on under the client's own ids, so that the autopilot's COMMAND_ACK finds
  its way back to it, but with the interval that serves everybody; what the autopilot refuses is forgotten;
- a REQUEST_DATA_STREAM is never passed on (it would reset the whole group's intervals): it becomes a wish
  for each message of the group.

Senseless numbers in these, and in MAV_CMD_GET_MESSAGE_INTERVAL and MAV_CMD_REQUEST_MESSAGE, reach no autopilot:
they are denied here. (ArduPilot converts them to integers as they come: what an integer cannot hold ends a
simulated one.)

Rates are in the autopilot's own time: at 20 times real time, 10 Hz are 200 messages a second of wall time.
"""

from __future__ import annotations

import math
import struct
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from aps.timeouts import STREAM_ACK_TIMEOUT_S, STREAM_TRIES
from aps.wire.dialect import mavlink
from aps.wire.framer import Frame, with_payload

NS_PER_S: Final = 1_000_000_000
US_PER_S: Final = 1_000_000
ACK_TIMEOUT_NS: Final = round(STREAM_ACK_TIMEOUT_S * NS_PER_S)
MAX_TRIES: Final = STREAM_TRIES
MAX_WISHES: Final = 512
"""Bound on a client's wishes: more messages than any autopilot can send."""
DISABLED_US: Final = -1
"""SET_MESSAGE_INTERVAL's value for "do not send"."""
AUTOPILOT_DEFAULT_US: Final = 0
"""SET_MESSAGE_INTERVAL's value for "the autopilot's own rate"."""

SHORTEST_US: Final = 1000
"""Autopilots refuse what is faster, and with it the requests of all who share the message."""
_INT32: Final = 1 << 31
_MESSAGE_IDS: Final = 1 << 24

_UNKNOWN_US: Final = -2
"""Differs from every interval: to be asked for again."""

SET_MESSAGE_INTERVAL: Final = int(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL)
_GET_MESSAGE_INTERVAL: Final = int(mavlink.MAV_CMD_GET_MESSAGE_INTERVAL)
_REQUEST_MESSAGE: Final = int(mavlink.MAV_CMD_REQUEST_MESSAGE)
_ABOUT_MESSAGES: Final = frozenset({SET_MESSAGE_INTERVAL, _GET_MESSAGE_INTERVAL, _REQUEST_MESSAGE})
"""Commands whose first parameter is the id of a message."""
_INDEXED: Final = frozenset({int(mavlink.MAVLINK_MSG_ID_MESSAGE_INTERVAL), 435})
"""Messages that a MAV_CMD_REQUEST_MESSAGE asks for by a number in its second parameter; 435: AVAILABLE_MODES."""
_REQUEST_DATA_STREAM: Final = 66
_COMMAND_INT: Final = 75
_COMMAND_LONG: Final = 76
# COMMAND_LONG and COMMAND_INT both begin with param1, param2 and hold the command at offset 28.
_INTERVAL_PARAMS: Final = struct.Struct("<ff")
_COMMAND_AT: Final = 28
_COMMAND_BYTES: Final = {_COMMAND_LONG: 33, _COMMAND_INT: 35}
_FLOATS: Final = {_COMMAND_LONG: struct.Struct("<7f"), _COMMAND_INT: struct.Struct("<4f")}
_STREAM_REQUEST: Final = struct.Struct("<HBBBB")

DEFAULT_RATES_HZ: Final[Mapping[int, float]] = {
    0: 1.0,  # HEARTBEAT
    1: 2.0,  # SYS_STATUS
    2: 1.0,  # SYSTEM_TIME
    24: 2.0,  # GPS_RAW_INT
    30: 10.0,  # ATTITUDE
    32: 20.0,  # LOCAL_POSITION_NED
    33: 20.0,  # GLOBAL_POSITION_INT
    42: 1.0,  # MISSION_CURRENT
    62: 1.0,  # NAV_CONTROLLER_OUTPUT
    74: 5.0,  # VFR_HUD
    147: 1.0,  # BATTERY_STATUS
    168: 2.0,  # WIND
    193: 1.0,  # EKF_STATUS_REPORT
    242: 0.5,  # HOME_POSITION
    245: 5.0,  # EXTENDED_SYS_STATE
}
"""What the state and MAVSDK's health flags need. Positions at 20 Hz, since agents transmit at up to 20 Hz."""

STREAM_GROUPS: Final[Mapping[int, tuple[int, ...]]] = {
    1: (26, 27, 29, 116, 129, 137, 143),  # RAW_SENSORS: IMUs and pressures
    2: (1, 24, 42, 62, 87, 124, 125, 127, 128, 152, 162),  # EXTENDED_STATUS
    3: (35, 36, 65),  # RC_CHANNELS
    4: (),  # RAW_CONTROLLER: empty in ArduCopter and ArduPlane
    6: (32, 33),  # POSITION
    10: (30, 163, 178, 194, 226),  # EXTRA1: attitude and its relatives
    11: (74,),  # EXTRA2
    12: (2, 100, 132, 136, 147, 168, 173, 193, 241),  # EXTRA3
}
"""MAV_DATA_STREAM -> message ids, as ArduPilot groups them (those that copter and plane can both send)."""
_ALL_STREAMS: Final = 0


def command_of(frame: Frame) -> int | None:
    """MAV_CMD of a COMMAND_LONG or COMMAND_INT; ``None`` of another message."""
    if frame.msg_id not in _COMMAND_BYTES:
        return None
    return int.from_bytes(frame.payload[_COMMAND_AT : _COMMAND_AT + 2], "little")


def _makes_sense(command: int, params: Sequence[float]) -> bool:
    """Whether an autopilot can read the numbers of a command about messages; NaN: not given."""
    msg_id, second = params[:2]
    if not 0.0 <= msg_id < _MESSAGE_IDS or any(not math.isnan(one) and abs(one) >= _INT32 for one in params):
        return False
    if command == SET_MESSAGE_INTERVAL:
        return -1.0 <= second <= 0.0 or second >= SHORTEST_US
    return command != _REQUEST_MESSAGE or msg_id not in _INDEXED or not math.isnan(second)


@dataclass(slots=True)
class StreamCounters:
    """What was asked and how it went."""

    client_requests: int = 0
    rewritten: int = 0
    """Clients' requests passed on with a faster interval that somebody else needs."""
    absorbed: int = 0
    """REQUEST_DATA_STREAM turned into wishes."""
    malformed: int = 0
    """With numbers that make no sense: not passed on, and commands are denied."""
    too_many: int = 0
    """Wishes beyond MAX_WISHES: neither kept nor passed on."""
    sent: int = 0
    accepted: int = 0
    refused: int = 0
    postponed: int = 0
    """Not acknowledged after MAX_TRIES, put behind the others: tried again for as long as the link is up."""


@dataclass(frozen=True, slots=True)
class StreamWish:
    """A client's request on its way to the autopilot: what the autopilot is asked for."""

    msg_id: int
    interval_us: int


@dataclass(slots=True)
class _Outstanding:
    msg_id: int
    interval_us: int
    tries: int
    deadline_ns: int


class StreamArbiter:
    """Keeps wishes, asks for the fastest of each, one request at a time until it is acknowledged.

    Args:
        defaults_hz: message id -> rate of the daemon's own default set.
    """

    def __init__(self, defaults_hz: Mapping[int, float] = DEFAULT_RATES_HZ) -> None:
        for msg_id, rate_hz in defaults_hz.items():
            if not 0.0 < rate_hz <= 1000.0:
                raise ValueError(f"stream rate of message {msg_id} must be in (0, 1000] Hz, not {rate_hz}")
        self.counters = StreamCounters()
        self.refused: set[int] = set()
        """Message ids that this autopilot cannot send."""
        self._defaults_us = {msg_id: round(US_PER_S / rate_hz) for msg_id, rate_hz in defaults_hz.items()}
        self.twins: Mapping[int, int | None] = {}
        """Of our own defaults: messages that this autopilot has under another id, or sends unasked (``None``)."""
        self._wishes: dict[int, dict[int, int]] = {}
        """Client link -> message id -> interval, us."""
        self._asked: dict[int, int] = {}
        """Message id -> interval that the autopilot has, or is about to get, us."""
        self._queue: deque[int] = deque()
        self._outstanding: _Outstanding | None = None
        self._connected = False

    # What is wanted.

    def interval_us(self, msg_id: int) -> int:
        """The interval that serves everybody, us; 0 leaves it to the autopilot, -1 switches it off."""
        wishes = [wish[msg_id] for wish in self._wishes.values() if msg_id in wish]
        wishes += [interval_us for own, interval_us in self._own() if own == msg_id]
        wanted = [interval_us for interval_us in wishes if interval_us > 0]
        if wanted:
            return min(wanted)
        return AUTOPILOT_DEFAULT_US if not wishes or AUTOPILOT_DEFAULT_US in wishes else DISABLED_US

    def _own(self) -> list[tuple[int, int]]:
        """Our own defaults for this autopilot: message id and interval, us."""
        twins = ((self.twins.get(msg_id, msg_id), us) for msg_id, us in self._defaults_us.items())
        return [(msg_id, us) for msg_id, us in twins if msg_id is not None]

    def client_left(self, link: int) -> None:
        """Forget a client's wishes; what only it wanted goes back to the autopilot's default."""
        for msg_id in self._wishes.pop(link, {}):
            if self.interval_us(msg_id) == AUTOPILOT_DEFAULT_US:
                self.refused.discard(msg_id)
            self._want(msg_id)

    def client_frame(self, frame: Frame, link: int) -> bytes | None:
        """Take a client's frame for the autopilot.

        Returns:
            The bytes to pass on: the original ones unless the frame asks for a stream rate; ``None`` when
            nothing is to be passed on. (A command is then to be denied.)
        """
        if frame.msg_id == _REQUEST_DATA_STREAM:
            self._data_stream(frame, link)
            return None
        command = command_of(frame)
        if command not in _ABOUT_MESSAGES:
            return frame.raw
        if command == SET_MESSAGE_INTERVAL:
            self.counters.client_requests += 1
        payload = frame.payload.ljust(_COMMAND_BYTES[frame.msg_id], b"\0")
        if not _makes_sense(command, _FLOATS[frame.msg_id].unpack_from(payload)):
            self.counters.malformed += 1
            return None
        return self._message_interval(frame, payload, link) if command == SET_MESSAGE_INTERVAL else frame.raw

    def _message_interval(self, frame: Frame, payload: bytes, link: int) -> bytes | None:
        id_value, interval_value = _INTERVAL_PARAMS.unpack_from(payload)
        msg_id, interval_us = int(id_value), int(interval_value)
        if not self._wish(link, msg_id, interval_us):
            return None
        serving_us = self.interval_us(msg_id)
        if serving_us == interval_us:
            self._note_asked(msg_id, interval_us)
            return frame.raw
        if frame.signed:
            # Cannot be rewritten without its key: it goes through, and ours follows to set things right.
            self._asked.pop(msg_id, None)
            self._want(msg_id)
            return frame.raw
        self.counters.rewritten += 1
        self._note_asked(msg_id, serving_us)
        return with_payload(frame, _INTERVAL_PARAMS.pack(id_value, serving_us) + payload[8:])

    def wish(self, frame: Frame) -> StreamWish | None:
        """What a command that goes to the autopilot asks of it, if that is a stream."""
        if command_of(frame) != SET_MESSAGE_INTERVAL:
            return None
        msg_id, interval_us = map(int, _INTERVAL_PARAMS.unpack_from(frame.payload.ljust(8, b"\0")))
        return StreamWish(msg_id, interval_us if frame.signed else self.interval_us(msg_id))

    def denied(self, wish: StreamWish) -> None:
        """The autopilot refused a client's request: it keeps the interval that it has, and so do the other clients."""
        self._forget(wish.msg_id, wish.interval_us)
        if self._asked.get(wish.msg_id) == wish.interval_us:  # else something else has been asked for since
            del self._asked[wish.msg_id]
            if self.interval_us(wish.msg_id) > 0:
                self._want(wish.msg_id)

    def _forget(self, msg_id: int, interval_us: int) -> None:
        """Drop what clients wish that the autopilot cannot do: it would be asked of it in place of others' wishes."""
        for wishes in self._wishes.values():
            if wishes.get(msg_id) == interval_us:
                del wishes[msg_id]

    def _data_stream(self, frame: Frame, link: int) -> None:
        rate_hz, _, _, stream, start = _STREAM_REQUEST.unpack(frame.payload.ljust(6, b"\0")[:6])
        self.counters.client_requests += 1
        is_known = stream == _ALL_STREAMS or stream in STREAM_GROUPS
        if start > 1 or not is_known or rate_hz > US_PER_S / SHORTEST_US:
            self.counters.malformed += 1
            return
        self.counters.absorbed += 1
        groups = STREAM_GROUPS.values() if stream == _ALL_STREAMS else (STREAM_GROUPS[stream],)
        interval_us = round(US_PER_S / rate_hz) if start and rate_hz else DISABLED_US
        for msg_id in (msg_id for group in groups for msg_id in group):
            if self._wish(link, msg_id, interval_us):
                self._want(msg_id)

    def _wish(self, link: int, msg_id: int, interval_us: int) -> bool:
        """Keep a client's wish; False if it has too many."""
        wishes = self._wishes.setdefault(link, {})
        if interval_us == AUTOPILOT_DEFAULT_US:
            wishes.pop(msg_id, None)
            self.refused.discard(msg_id)
        elif msg_id not in wishes and len(wishes) >= MAX_WISHES:
            self.counters.too_many += 1
            return False
        else:
            wishes[msg_id] = interval_us
        return True

    def _note_asked(self, msg_id: int, interval_us: int) -> None:
        """Remember what the autopilot is sent, as long as it is there and the interval is not its own."""
        if self._connected and interval_us != AUTOPILOT_DEFAULT_US:
            self._asked[msg_id] = interval_us
        else:
            self._asked.pop(msg_id, None)

    # Asking the autopilot.

    def connected(self) -> None:
        """The link is up, or the autopilot has rebooted: ask for everything anew."""
        self._connected = True
        self._asked.clear()
        self.refused.clear()
        self._outstanding = None
        self._queue.clear()
        wished = {msg_id for wishes in self._wishes.values() for msg_id in wishes}
        own = [msg_id for msg_id, _ in self._own()]
        for msg_id in [*own, *sorted(wished.difference(own))]:
            self._want(msg_id)

    def disconnected(self) -> None:
        """The link is down: ask nothing until it is back."""
        self._connected = False
        self._outstanding = None
        self._queue.clear()
        self._asked.clear()

    def _want(self, msg_id: int) -> None:
        if self._connected and msg_id not in self._queue and msg_id not in self.refused:
            self._queue.append(msg_id)

    def poll(self, now_ns: int) -> tuple[int, int] | None:
        """The next request that is due: (message id, interval us) to send now, or ``None``."""
        outstanding = self._outstanding
        if outstanding is not None:
            if now_ns < outstanding.deadline_ns:
                return None
            if outstanding.tries < MAX_TRIES:
                outstanding.tries += 1
                outstanding.deadline_ns = now_ns + ACK_TIMEOUT_NS * outstanding.tries
                self.counters.sent += 1
                return outstanding.msg_id, outstanding.interval_us
            self._postpone(outstanding.msg_id)
        return self._next(now_ns)

    def _postpone(self, msg_id: int) -> None:
        """Nobody answers (a paused simulation, for one): the others first, but this one is not lost."""
        self.counters.postponed += 1
        self._outstanding = None
        self._asked[msg_id] = _UNKNOWN_US
        self._want(msg_id)

    def _next(self, now_ns: int) -> tuple[int, int] | None:
        while self._queue:
            msg_id = self._queue.popleft()
            interval_us = self.interval_us(msg_id)
            if self._asked.get(msg_id, AUTOPILOT_DEFAULT_US) == interval_us:
                continue
            self._note_asked(msg_id, interval_us)
            self._outstanding = _Outstanding(msg_id, interval_us, 1, now_ns + ACK_TIMEOUT_NS)
            self.counters.sent += 1
            return msg_id, interval_us
        return None

    @property
    def request(self) -> object | None:
        """What waits for an acknowledgement: the same object for all tries of one request."""
        return self._outstanding

    def asks_for(self, msg_id: int) -> bool:
        """Whether we are asking for a message, or have, and were refused."""
        outstanding = self._outstanding
        return msg_id in self.refused or (outstanding is not None and outstanding.msg_id == msg_id)

    @property
    def idle(self) -> bool:
        """Whether everything that is wanted has been asked for and answered."""
        return self._outstanding is None and not self._queue

    def deadline_ns(self) -> int | None:
        """When to poll again without an acknowledgement; ``None`` when nothing is outstanding."""
        return None if self._outstanding is None else self._outstanding.deadline_ns

    def acknowledged(self, accepted: bool) -> None:
        """The autopilot answered the request that waits."""
        outstanding, self._outstanding = self._outstanding, None
        if outstanding is None:
            return
        if accepted:
            self.counters.accepted += 1
        else:
            self.counters.refused += 1
            self._asked.pop(outstanding.msg_id, None)
            self._forget(outstanding.msg_id, outstanding.interval_us)
            if 0 < self.interval_us(outstanding.msg_id) != outstanding.interval_us:
                self._want(outstanding.msg_id)
            elif outstanding.interval_us != AUTOPILOT_DEFAULT_US:
                self.refused.add(outstanding.msg_id)
