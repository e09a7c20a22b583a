"""The autopilot's messages by name: the last of each and its rate, asking for one, sending one. No I/O, no clock."""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

from aps.timeouts import ACK_TIMEOUTS_S
from aps.vehicle.execution import NS_PER_S, Execution, Outcome
from aps.vehicle.flight.steps import checked
from aps.vehicle.telemetry import VehicleState
from aps.wire.dialect import (
    AUTOPILOT_COMPID,
    enum_label,
    mavlink,
    message_class,
    message_fields,
    message_name,
)
from aps.wire.framer import Frame

RATE_WINDOW_S: Final = 2.0
"""Least time over which a rate is counted."""
_RATE_WINDOW_NS: Final = round(RATE_WINDOW_S * NS_PER_S)
_REQUEST_MESSAGE: Final = int(mavlink.MAV_CMD_REQUEST_MESSAGE)
_ACCEPTED: Final = int(mavlink.MAV_RESULT_ACCEPTED)
_IN_PROGRESS: Final = int(mavlink.MAV_RESULT_IN_PROGRESS)
_INT32: Final = 1 << 31


def as_json(fields: Mapping[str, Any]) -> dict[str, Any]:
    """Fields of a message as JSON can hold them: NaN and infinity become ``None``, bytes a list of numbers."""
    return {name: plain(value) for name, value in fields.items()}


def plain(value: Any) -> Any:
    """A value as JSON can hold it: see ``as_json``."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, dict):
        return {name: plain(one) for name, one in value.items()}
    if isinstance(value, bytes | bytearray | list | tuple):
        return [plain(one) for one in value]
    return value


@dataclass(slots=True)
class _Entry:
    raw: bytes
    heard_ns: int
    count: int
    window_ns: int
    window_count: int
    rate_hz: float = 0.0


@dataclass(frozen=True, slots=True)
class LastMessage:
    """The last message of a type."""

    name: str
    msg_id: int
    fields: dict[str, Any]
    age_s: float
    """By the daemon's clock."""
    rate_hz: float
    """Over the last seconds, by the daemon's clock; 0 until there are two."""
    count: int


class MessageBoard:
    """The last message of each type from the autopilot, whole; decoded when somebody looks."""

    def __init__(self) -> None:
        self._entries: dict[int, _Entry] = {}

    def take(self, frame: Frame, now_ns: int) -> None:
        """A frame of the autopilot."""
        raw, msg_id, _, _, _, _, _, _ = frame
        entry = self._entries.get(msg_id)
        if entry is None:
            self._entries[msg_id] = _Entry(raw, now_ns, 1, now_ns, 0)
            return
        entry.raw, entry.heard_ns = raw, now_ns
        entry.count += 1
        entry.window_count += 1
        elapsed_ns = now_ns - entry.window_ns
        if elapsed_ns >= _RATE_WINDOW_NS:
            entry.rate_hz = entry.window_count * NS_PER_S / elapsed_ns
            entry.window_ns, entry.window_count = now_ns, 0

    def names(self) -> list[str]:
        """The types that were heard, sorted."""
        return sorted(message_name(msg_id) for msg_id in self._entries)

    def last(self, name: str, now_ns: int) -> LastMessage | None:
        """The last message of a type, ``None`` if none came.

        Raises:
            ValueError: there is no message of this name.
        """
        msg_id = int(message_class(name).id)
        entry = self._entries.get(msg_id)
        if entry is None:
            return None
        age_s = (now_ns - entry.heard_ns) / NS_PER_S
        rate_hz = entry.rate_hz if age_s < 2 * RATE_WINDOW_S or entry.rate_hz * age_s < 2.0 else 0.0
        fields = as_json(message_fields(entry.raw))
        return LastMessage(message_name(msg_id), msg_id, fields, age_s, rate_hz, entry.count)

    def forget(self) -> None:
        """A new boot: nothing of the one before is shown as current."""
        self._entries.clear()


class RequestExecution(Execution):
    """Asks for one message and waits for it: the result's value is its fields.

    Args:
        state: the UA now.
        name: of the message.
        param: what further says which one is meant, where the message's definition asks for that.
    """

    def __init__(self, state: VehicleState, name: str, param: float = 0.0) -> None:
        super().__init__("message")
        self._sysid = state.sysid
        self._name = str(message_class(name).msgname)
        self.wanted = frozenset({int(message_class(name).id)})
        which = checked("param", param, -_INT32, _INT32 - 1)  # ArduPilot makes an integer of it
        self._params = (float(message_class(name).id), which, 0.0, 0.0, 0.0, 0.0, 0.0)
        self._tries = 0
        self._due_at_ns = 0
        self._request = object()

    @property
    def request(self) -> object | None:
        """What waits for the acknowledgement."""
        return self._request

    def _poll(self, state: VehicleState, now_ns: int) -> list[Any]:  # noqa: ARG002
        if now_ns < self._due_at_ns:
            return []
        if self._tries >= len(ACK_TIMEOUTS_S):
            self.end(Outcome.TIMED_OUT, f"no {self._name} after {self._tries} tries")
            return []
        self._due_at_ns = now_ns + round(ACK_TIMEOUTS_S[self._tries] * NS_PER_S)
        self._tries += 1
        return [
            mavlink.MAVLink_command_long_message(
                self._sysid, AUTOPILOT_COMPID, _REQUEST_MESSAGE, self._tries - 1, *self._params
            )
        ]

    def _due_ns(self) -> int | None:
        return self._due_at_ns

    def on_ack(self, command: int, result: int, progress: int = 0xFF) -> None:  # noqa: ARG002
        """It may have no such message."""
        if command == _REQUEST_MESSAGE and result not in (_ACCEPTED, _IN_PROGRESS):
            self.refuse(f"{enum_label('MAV_RESULT', result)}: no {self._name} from this autopilot")

    def on_message(self, name: str, fields: Mapping[str, Any], now_ns: int) -> None:  # noqa: ARG002
        """The message, asked for or of a stream: both are of now."""
        if name == self._name:
            self.end(Outcome.REACHED, value=as_json(fields))


class SendExecution(Execution):
    """Sends one message to the autopilot, as the daemon's own; nothing is waited for."""

    def __init__(self, message: Any) -> None:
        super().__init__("send")
        self._message = message

    def _poll(self, state: VehicleState, now_ns: int) -> list[Any]:  # noqa: ARG002
        self.end(Outcome.REACHED)
        return [self._message]

    def _due_ns(self) -> int | None:
        return 0


def request(state: VehicleState, name: str, param: float = 0.0) -> RequestExecution:
    """Get a message of the autopilot as it is now: the result's value is its fields.

    Args:
        state: the UA now.
        name: of the message, such as ``WIND``.
        param: what further says which one is meant, where the message's definition asks for that.
    """
    return RequestExecution(state, name, param)


def send(state: VehicleState, name: str, fields: dict[str, Any]) -> SendExecution:
    """Send a message to the autopilot, under the daemon's own ids; nothing is waited for.

    Args:
        state: the UA now.
        name: of the message, such as ``RC_CHANNELS_OVERRIDE``.
        fields: its fields by name; the target is the autopilot unless it is named, others that are not named are 0.
    """
    kind = message_class(name)
    if not isinstance(fields, Mapping):
        raise ValueError(f"fields must be names and values, not {fields!r}")
    unknown = set(fields) - set(kind.fieldnames)
    if unknown:
        raise ValueError(
            f"{kind.msgname} has no field {min(unknown, key=str)!r}: {', '.join(kind.fieldnames)}"
        )
    target = {"target_system": state.sysid, "target_component": AUTOPILOT_COMPID}
    given = {key: value for key, value in target.items() if key in kind.fieldnames} | dict(fields)
    arguments = [_argument(kind, key, given) for key in kind.fieldnames]
    try:
        message = kind(*arguments)
        message.pack(mavlink.MAVLink(None))
    except (
        TypeError,
        ValueError,
        OverflowError,
        AttributeError,
        LookupError,
        mavlink.MAVError,
        struct.error,
    ) as error:
        raise ValueError(f"{kind.msgname} cannot be made of {dict(fields)!r}: {error}") from error
    return SendExecution(message)


def _argument(kind: Any, key: str, given: Mapping[str, Any]) -> Any:
    index = kind.ordered_fieldnames.index(key)
    count, is_text = kind.array_lengths[index], kind.fieldtypes[kind.fieldnames.index(key)] == "char"
    value = given.get(key)
    if is_text:
        text = str(value or "").encode()
        if len(text) > count:
            raise ValueError(
                f"{kind.msgname} cannot be made of {len(text)} bytes of text in {key}: {count} at most"
            )
        return text
    if count:
        values = list(value or [])
        if len(values) > count:
            raise ValueError(
                f"{kind.msgname} cannot be made of {len(values)} values in {key}: {count} at most"
            )
        return values + [0] * (count - len(values))
    if value is None:
        return 0
    return math.nan if isinstance(value, str) and value == "nan" else value
