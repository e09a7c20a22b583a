"""One recorded input, and its form as the fields of a JSON object."""

from __future__ import annotations

import dataclasses
import json
import math
from dataclasses import dataclass
from typing import Any, Final, Literal, NamedTuple, get_args

from bridge.bus.keys import ALL, IP, MAIN, KeyMistake, checked_chunk
from bridge.bus.messages.types import CommandGoal
from bridge.bus.radio_command import RADIO

Kind = Literal["open", "frame", "close", "command", "packet", "serial"]
KINDS: Final = get_args(Kind)
VERBS: Final = (
    *(
        "arm",
        "disarm",
        "mode",
        "takeoff",
        "hold",
        "goto",
        "goto_ned",
        "velocity",
        "follow",
        "orbit",
        "speed",
        "rtl",
        "land",
    ),
    *("reboot", "mission", "mission_set_current", "mission_upload", "mission_download", "mission_clear"),
    *("parameter_get", "parameter_set", "parameters_set", "parameters", "message", "send"),
    RADIO,
)
"""What can be commanded: those of `aps.vehicle.commander`, named here so that readers do without aps, and the radio."""
TICK_MAX_NS: Final = (1 << 63) - 1
LINK_MAX: Final = (1 << 31) - 1
PACKET_MAX_BYTES: Final = 65535
"""Of a packet that enters a node from outside: the longest that IP has."""
_GOAL_FIELDS: Final = tuple(field.name for field in dataclasses.fields(CommandGoal))
_KEYS: Final = {
    "open": ("tick_ns", "kind", "link"),
    "close": ("tick_ns", "kind", "link"),
    "frame": ("tick_ns", "kind", "link", "hex", "name"),
    "command": ("tick_ns", "kind", "verb", *_GOAL_FIELDS),
    "packet": ("tick_ns", "kind", "radio", "to", "channel", "hex"),
    "serial": ("tick_ns", "kind", "radio", "hex"),
}
_OPTIONAL: Final = {"name", *_GOAL_FIELDS}
_NO_NUMBERS: Final = ("nan", "inf", "-inf")
"""JSON has no numbers for these: they are written as text."""


class InputError(ValueError):
    """An input is wrong; the text names the key and what is allowed (and file and line, if it was read)."""


class PacketWay(NamedTuple):
    """Which way a packet goes that enters a node from outside.

    Attributes:
        radio: name of the node's radio.
        to: the node, or the group of nodes, that it is for, or all.
        channel: of the packet.
    """

    radio: str = MAIN
    to: str = ALL
    channel: str = IP


@dataclass(frozen=True, slots=True)
class RecordedInput:
    """What came from outside and took effect at a tick.

    Attributes:
        tick_ns: sim time of the tick.
        kind: a link was opened or closed, a MAVLink frame came over one, a command, a packet for a radio, or bytes for
            a modem's serial side.
        link: number of the link; None for a command, a packet, and bytes of a modem.
        data: the bytes of a frame or a packet, or a modem's; empty for the others.
        verb: what is commanded; None for the others.
        goal: the command's arguments; None for the others.
        way: which way a packet goes; None for the others.
        radio: name of the modem's radio; None for the others.

    Raises:
        InputError: the values do not go together.
    """

    tick_ns: int
    kind: Kind
    link: int | None = None
    data: bytes = b""
    verb: str | None = None
    goal: CommandGoal | None = None
    way: PacketWay | None = None
    radio: str | None = None

    def __post_init__(self) -> None:
        _check_choice("kind", self.kind, KINDS)
        _check_whole("tick_ns", self.tick_ns, TICK_MAX_NS)
        is_command, is_packet, is_serial = (self.kind == each for each in ("command", "packet", "serial"))
        if is_command:
            _check_choice("verb", self.verb, VERBS)
        elif not (is_packet or is_serial):
            _check_whole("link", self.link, LINK_MAX)
        if bool(self.data) != (self.kind in ("frame", "packet", "serial")):
            raise InputError(f"key 'hex': a frame or a packet has at least one byte, {self.kind!r} has none")
        if is_serial != (self.radio is not None) or (is_serial and self.link is not None):
            raise InputError("key 'radio': bytes of a modem have one, and no link; the other kinds have none")
        if is_command != (self.goal is not None) or is_command != (self.verb is not None):
            raise InputError("keys 'verb' and goal: a command has both, the other kinds have neither")
        if (is_command or is_packet) and self.link is not None:
            raise InputError(f"key 'link': a {self.kind} has none")
        if is_packet != (self.way is not None):
            raise InputError("keys 'radio', 'to' and 'channel': a packet has them, the other kinds have none")
        if self.way is not None:
            _check_way(self.way, self.data)

    @classmethod
    def opened(cls, tick_ns: int, link: int) -> RecordedInput:
        """A link was opened."""
        return cls(tick_ns, "open", link)

    @classmethod
    def frame(cls, tick_ns: int, link: int, data: bytes) -> RecordedInput:
        """A MAVLink frame came."""
        return cls(tick_ns, "frame", link, data)

    @classmethod
    def closed(cls, tick_ns: int, link: int) -> RecordedInput:
        """A link was closed."""
        return cls(tick_ns, "close", link)

    @classmethod
    def serial(cls, tick_ns: int, radio: str, data: bytes) -> RecordedInput:
        """Bytes came for the serial side of a modem."""
        return cls(tick_ns, "serial", data=data, radio=radio)

    @classmethod
    def command(cls, tick_ns: int, verb: str, goal: CommandGoal) -> RecordedInput:
        """An operator's command came."""
        return cls(tick_ns, "command", verb=verb, goal=goal)

    @classmethod
    def packet(cls, tick_ns: int, way: PacketWay, data: bytes) -> RecordedInput:
        """A packet came for a radio of the node."""
        return cls(tick_ns, "packet", data=data, way=way)


def to_fields(item: RecordedInput) -> dict[str, Any]:
    """The input as a JSON object."""
    fields: dict[str, Any] = {"tick_ns": item.tick_ns, "kind": item.kind}
    if item.link is not None:
        fields["link"] = item.link
    if item.kind == "serial":
        return fields | {"radio": item.radio, "hex": item.data.hex()}
    if item.kind == "frame":
        return fields | {"name": frame_name(item.data), "hex": item.data.hex()}
    if item.way is not None:
        return fields | item.way._asdict() | {"hex": item.data.hex()}
    if item.verb is not None and item.goal is not None:
        goal = {name: getattr(item.goal, name) for name in _GOAL_FIELDS}
        empty = CommandGoal()
        # repr: -0.0 equals 0.0, but is not left out
        kept = {name: v for name, v in goal.items() if repr(v) != repr(getattr(empty, name))}
        fields |= {"verb": item.verb, **{name: _plain(v) for name, v in kept.items()}}
        if "arguments" in kept:
            fields["arguments"] = _as_object(item.goal.arguments)
    return fields


def from_fields(fields: dict[str, Any]) -> RecordedInput:
    """The input in a JSON object.

    Raises:
        InputError: a key is missing, unknown or has a value that is not allowed.
    """
    _check_choice("kind", fields.get("kind"), KINDS)
    kind: Kind = fields["kind"]
    allowed = _KEYS[kind]
    for key in fields:
        if key not in allowed:
            raise InputError(f"key {key!r} is unknown; {kind!r} has {', '.join(allowed)}")
    for key in allowed:
        if key not in fields and key not in _OPTIONAL:
            raise InputError(f"key {key!r} is missing; {kind!r} has {', '.join(allowed)}")
    tick_ns = fields["tick_ns"]
    if kind == "command":
        return RecordedInput(tick_ns, kind, verb=fields["verb"], goal=_goal(fields))
    if kind == "packet":
        way = PacketWay(*(_text(key, fields[key]) for key in PacketWay._fields))
        return RecordedInput.packet(tick_ns, way, _bytes(fields["hex"]))
    if kind == "serial":
        return RecordedInput(tick_ns, kind, data=_bytes(fields["hex"]), radio=_text("radio", fields["radio"]))
    data = _frame(fields["hex"]) if kind == "frame" else b""
    return RecordedInput(tick_ns, kind, fields["link"], data)


def frame_name(data: bytes) -> str:
    """Name of the message in a MAVLink frame; empty if it is none."""
    from aps.wire.dialect import message_name  # pymavlink takes its time, and readers do without

    if data[:1] == b"\xfd" and len(data) >= 10:
        return message_name(int.from_bytes(data[7:10], "little"))
    if data[:1] == b"\xfe" and len(data) >= 6:
        return message_name(data[5])
    return ""


def _goal(fields: dict[str, Any]) -> CommandGoal:
    values: dict[str, Any] = {}
    for name in _GOAL_FIELDS:
        if name in fields:
            read = _READERS.get(name, _number)
            values[name] = read(name, fields[name])
    return CommandGoal(**values)


def _text(key: str, value: object) -> str:
    if isinstance(value, str):
        return value
    raise InputError(f"key {key!r}: {value!r} is not text")


def _arguments(key: str, value: object) -> str:
    return json.dumps(value) if isinstance(value, dict) else _text(key, value)


def _as_object(text: str) -> dict[str, Any] | str:
    """Arguments as an object for people to edit, if they come back the same; else the text as it came."""
    try:
        content = json.loads(text)
        same = isinstance(content, dict) and json.dumps(content, allow_nan=False) == text
    except (ValueError, RecursionError):
        return text
    return content if same else text


_READERS: Final = {"mode": _text, "arguments": _arguments}


def _number(key: str, value: object) -> float:
    if isinstance(value, int | float) and not isinstance(value, bool):
        try:
            return float(value)
        except OverflowError as error:
            raise InputError(f"key {key!r}: the number is too large") from error
    if isinstance(value, str) and value in _NO_NUMBERS:
        return float(value)
    raise InputError(f"key {key!r}: {value!r} is not a number (nor one of {', '.join(_NO_NUMBERS)} as text)")


def _bytes(value: object) -> bytes:
    text = _text("hex", value)
    try:
        data = bytes.fromhex(text)
    except ValueError as error:
        raise InputError(f"key 'hex': {text[:40]!r} is not an even number of digits 0-9 a-f") from error
    return data


def _frame(value: object) -> bytes:
    """The bytes of one whole frame: anything else would be found out in flight only, or never."""
    from aps.wire.framer import Framer  # as in frame_name

    data = _bytes(value)
    framer = Framer(trusting=True)
    if [frame.raw for frame in framer.receive(data)] == [data]:
        return data
    if not data:
        raise InputError("key 'hex': a frame has at least one byte")
    text = (
        "its checksum is wrong" if framer.counters.bad_crc else f"its {len(data)} bytes are none, or not one"
    )
    raise InputError(f"key 'hex': one whole MAVLink frame is expected: {text}")


def _check_way(way: PacketWay, data: bytes) -> None:
    for key, value in way._asdict().items():
        try:
            checked_chunk(value)
        except KeyMistake as mistake:
            raise InputError(f"key {key!r}: {mistake}") from mistake
    if len(data) > PACKET_MAX_BYTES:
        raise InputError(f"key 'hex': {len(data)} bytes; a packet has at most {PACKET_MAX_BYTES}")


def _plain(value: str | float) -> str | float:
    return str(value) if isinstance(value, float) and not math.isfinite(value) else value


def _check_choice(key: str, value: object, allowed: tuple[str, ...]) -> None:
    if value not in allowed:
        raise InputError(f"key {key!r}: {value!r} is not allowed; one of {', '.join(allowed)}")


def _check_whole(key: str, value: object, most: int) -> None:
    if not isinstance(value, int) or isinstance(value, bool) or not 0 <= value <= most:
        raise InputError(f"key {key!r}: {value!r} is not a whole number from 0 to {most}")
