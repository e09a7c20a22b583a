"""Messages to CDR bytes and back, by the rosbags library from `msg/*.msg`.

The Zenoh encoding of a payload names its type (``application/cdr;lostlink_msgs/msg/Truth``), so that a reader
needs nothing but the sample.
"""

from __future__ import annotations

import dataclasses
import typing
from collections.abc import Callable
from importlib import resources
from typing import Any

import numpy as np
from rosbags.serde import SerdeError
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from bridge.bus.messages import types
from bridge.bus.messages.types import Message

CDR = "application/cdr"

M = typing.TypeVar("M", bound=Message)
Converter = Callable[[Any], Any]


class DecodeError(ValueError):
    """The payload is not a message of the type that its encoding names."""


def definitions() -> dict[str, str]:
    """Text of every message definition by ROS 2 type name."""
    folder = resources.files("bridge.bus.messages") / "msg"
    ours = {
        f"{types.PACKAGE}/msg/{f.name[:-4]}": f.read_text()
        for f in folder.iterdir()
        if f.name.endswith(".msg")
    }
    return {
        "std_msgs/msg/Header": "builtin_interfaces/Time stamp\nstring frame_id\n",
        "geometry_msgs/msg/Vector3": "float64 x\nfloat64 y\nfloat64 z\n",
        "geometry_msgs/msg/Quaternion": "float64 x\nfloat64 y\nfloat64 z\nfloat64 w\n",
        **ours,
    }


def _typestore() -> Any:
    store = get_typestore(Stores.EMPTY)
    found: dict[str, Any] = {}
    for name, text in definitions().items():
        found |= get_types_from_msg(text, name)
    store.register(found)
    return store


_STORE = _typestore()
_CLASSES: dict[str, type[Message]] = {c.TYPE: c for c in vars(types).values() if hasattr(c, "TYPE")}
"""Every record of `types` by its ROS 2 type name."""


def _converter(annotation: Any) -> Converter | None:
    """How to turn what rosbags gives for a field into what the record holds; None where it is the same."""
    if isinstance(annotation, type) and issubclass(annotation, Message):
        return _message_converter(annotation)
    if typing.get_origin(annotation) is tuple:
        item = _converter(typing.get_args(annotation)[0])
        if item is None:
            return lambda values: tuple(values.tolist() if hasattr(values, "tolist") else values)
        return lambda values: tuple(item(v) for v in values)
    return None


def _message_converter(cls: type[Message]) -> Converter:
    hints = typing.get_type_hints(cls)
    fields = [(f.name, _converter(hints[f.name])) for f in dataclasses.fields(cls)]  # type: ignore[arg-type]

    def convert(raw: Any) -> Any:
        return cls(*[getattr(raw, n) if c is None else c(getattr(raw, n)) for n, c in fields])

    return convert


_CONVERTERS: dict[str, Converter] = {name: _message_converter(cls) for name, cls in _CLASSES.items()}


def encoding_of(cls: type[Message]) -> str:
    """The Zenoh encoding of a message class."""
    return f"{CDR};{cls.TYPE}"


def encode(message: Message) -> bytes:
    """CDR bytes, little-endian, with the four-byte header (OMG DDSI-RTPS 10.2)."""
    return bytes(_STORE.serialize_cdr(_wire(message), message.TYPE))


def _number_sequences(cls: type[Message]) -> dict[str, str]:
    """Fields that rosbags wants as numpy arrays, with their dtype."""
    dtypes = {float: "float64", bool: "bool", int: "int64"}
    hints = typing.get_type_hints(cls).items()
    tuples = ((n, typing.get_args(h)[0]) for n, h in hints if typing.get_origin(h) is tuple)
    return {name: dtypes[item] for name, item in tuples if item in dtypes}


_NUMBER_SEQUENCES = {name: found for name, cls in _CLASSES.items() if (found := _number_sequences(cls))}


def _wire(message: Message) -> Any:
    """The record in the form that rosbags serialises."""
    found = _NUMBER_SEQUENCES.get(message.TYPE)
    if found is None:
        return message
    arrays = {name: np.asarray(getattr(message, name), dtype=dtype) for name, dtype in found.items()}
    return dataclasses.replace(message, **arrays)  # type: ignore[type-var]


def decode(payload: bytes, cls: type[M]) -> M:
    """The message in ``payload``.

    Raises:
        DecodeError: if the bytes are not one.
    """
    try:
        return typing.cast("M", _CONVERTERS[cls.TYPE](_STORE.deserialize_cdr(payload, cls.TYPE)))
    except (SerdeError, ValueError, IndexError, AssertionError, UnicodeDecodeError) as error:
        raise DecodeError(f"not a {cls.TYPE}: {error}") from error


def class_of(encoding: str) -> type[Message] | None:
    """The message class that a Zenoh encoding names, or None if it is not one of ours."""
    media_type, _, name = encoding.partition(";")
    return _CLASSES.get(name) if media_type == CDR else None
