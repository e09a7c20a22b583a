"""What agents log: named values, and what they say of their work; a stream per node.

An entry's payload is a uint8 kind and the rest. Kind 0, a value: uint16 length of its name, that name in UTF-8, and
the value as JSON (as Python writes it: ``NaN`` and ``Infinity`` are numbers there). Kind 1, a report: an AgentStatus in
CDR. Numbers are little-endian.
"""

from __future__ import annotations

import json
import math
import re
import struct
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

from bridge.bus.keys import is_chunk
from bridge.bus.messages import AgentStatus, decode, encode
from bridge.record import names
from bridge.record.streams import decoded

NAME_MAX: Final = 64
TEXT_MAX: Final = 4096
VECTOR_MAX: Final = 1024
KEYS_MAX: Final = 64
INTEGER_MAX: Final = (1 << 63) - 1
ALLOWED: Final = (
    f"a number, a bool, a text of up to {TEXT_MAX} characters, a vector of up to {VECTOR_MAX} numbers, or a flat "
    f"mapping of up to {KEYS_MAX} names to these"
)
_KEY: Final = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,63}")
_VALUE, _REPORT = 0, 1
_HEAD: Final = struct.Struct("<BH")

Scalar = bool | int | float | str
Value = Scalar | list[float] | dict[str, Scalar | list[float]]
"""What can be logged, in plain types."""


class LoggedValue(NamedTuple):
    """A value that an agent logged."""

    name: str
    value: Value


def checked_name(name: str) -> str:
    """Return ``name`` if values can be logged under it.

    Raises:
        ValueError: they cannot.
    """
    if len(name) > NAME_MAX:
        raise ValueError(f"log({name[:20]!r}...): a name has up to {NAME_MAX} characters, not {len(name)}")
    if not is_chunk(name):
        raise ValueError(
            f"log({name!r}): a name is a letter or digit, then up to {NAME_MAX - 1} letters, digits, '_', '-' and '.'"
        )
    return name


def checked_text(what: str, text: object) -> str:
    """Return ``text`` if it is one that UTF-8 has.

    Raises:
        TypeError: it is no text.
        ValueError: it has half of a surrogate pair, such as ``"\\ud83d"``, which no message or file can hold.
    """
    if not isinstance(text, str):
        raise TypeError(f"{what}: {text!r} is no text")
    try:
        text.encode()
    except UnicodeEncodeError as error:
        raise ValueError(f"{what}: {text[:40]!r} is no text in UTF-8: {error.reason}") from None
    return text


def checked_value(name: str, value: object) -> Value:
    """``value`` in plain types: numpy's numbers and arrays become Python's.

    Raises:
        TypeError: it has a type that cannot be logged; the text names it and what is allowed.
        ValueError: it is too large, or a text that UTF-8 does not have.
    """
    if isinstance(value, Mapping):
        if len(value) > KEYS_MAX:
            raise ValueError(f"log({name!r}): {len(value)} names in a mapping; allowed is {ALLOWED}")
        return {_checked_key(name, key): _single(f"{name}.{key}", each) for key, each in value.items()}
    return _single(name, value)


def _checked_key(name: str, key: object) -> str:
    if not isinstance(key, str) or not _KEY.fullmatch(key):
        raise ValueError(
            f"log({name!r}): key {key!r}; a key is a letter, then up to 63 letters, digits and '_'"
        )
    return key


def _single(name: str, value: object) -> Scalar | list[float]:
    value = value.tolist() if hasattr(value, "tolist") else value  # numpy's scalars and arrays
    if isinstance(value, bool | float):
        return value
    if isinstance(value, int):
        return _whole(name, value)
    if isinstance(value, str):
        if len(value) > TEXT_MAX:
            raise ValueError(f"log({name!r}): a text of {len(value)} characters; allowed is {ALLOWED}")
        return checked_text(f"log({name!r})", value)
    if isinstance(value, Sequence) and not isinstance(value, bytes | bytearray):
        return _vector(name, value)
    raise TypeError(f"log({name!r}): a value of type {type(value).__name__}; allowed is {ALLOWED}")


def _whole(name: str, value: int) -> int:
    if not -INTEGER_MAX - 1 <= value <= INTEGER_MAX:
        raise ValueError(f"log({name!r}): {value} does not fit 64 bits")
    return value


def _vector(name: str, value: Sequence[object]) -> list[float]:
    if len(value) > VECTOR_MAX:
        raise ValueError(f"log({name!r}): {len(value)} items in a vector; allowed is {ALLOWED}")
    found: list[float] = []
    for each in value:
        number = each.tolist() if hasattr(each, "tolist") else each
        if not isinstance(number, bool | int | float):
            raise TypeError(
                f"log({name!r}): {type(number).__name__} in a vector, which has numbers only; allowed is {ALLOWED}"
            )
        found.append(_whole(name, number) if isinstance(number, int) else number)
    return found


def kind_of(value: Value) -> str:
    """``number``, ``bool``, ``text``, ``vector`` or ``mapping``: what a name keeps from its first value on."""
    if isinstance(value, bool):
        return "bool"
    if isinstance(value, str):
        return "text"
    if isinstance(value, list):
        return "vector"
    return "mapping" if isinstance(value, dict) else "number"


def as_json(value: Value) -> str:
    """The value as JSON that any reader takes: ``null`` for what is no finite number."""
    return json.dumps(_finite(value), ensure_ascii=False, allow_nan=False)


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _finite(each) for key, each in value.items()}
    if isinstance(value, list):
        return [_finite(each) for each in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def encode_logged(item: LoggedValue | AgentStatus) -> bytes:
    """A value or a report as the payload of a stream's entry."""
    if isinstance(item, AgentStatus):
        return bytes([_REPORT]) + encode(item)
    name = item.name.encode()
    return _HEAD.pack(_VALUE, len(name)) + name + json.dumps(item.value, ensure_ascii=False).encode()


def decode_logged(payload: bytes) -> LoggedValue | AgentStatus:
    """What is in an entry.

    Raises:
        ValueError: the bytes are neither a value nor a report.
    """
    if payload[:1] == bytes([_REPORT]):
        return decode(payload[1:], AgentStatus)
    if len(payload) < _HEAD.size or payload[0] != _VALUE:
        raise ValueError(f"{len(payload)} bytes that are nothing an agent logged")
    end = _HEAD.size + _HEAD.unpack_from(payload)[1]
    name = payload[_HEAD.size : end].decode()
    try:
        return LoggedValue(name, checked_value(name, json.loads(payload[end:])))
    except (TypeError, RecursionError) as error:
        raise ValueError(f"not a value that an agent logged: {error}") from error


def logged_of(run: Path, node: str) -> Iterator[tuple[int, LoggedValue | AgentStatus]]:
    """What the agent of ``node`` logged in the run in ``run``, with the ticks; none if it has no such stream.

    Raises:
        StreamError, OSError: as `decoded`.
        ValueError: the id cannot be one.
    """
    return decoded(names.logged(node).path(run), decode_logged)
