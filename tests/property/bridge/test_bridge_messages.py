"""Messages are coded as rosbags codes them, for any content, and no bytes make the decoder fail but by DecodeError."""

from __future__ import annotations

import dataclasses
import typing
from functools import cache
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rosbags.serde import SerdeError
from rosbags.typesys import get_types_from_msg

from benchmarks.bench_messages import for_rosbags, store
from bridge.bus.messages import (
    DataPackage,
    DecodeError,
    Message,
    Waypoint,
    decode,
    encode,
    types,
)
from bridge.bus.messages.definitions import definitions, fields_of

TEXT = st.text(max_size=20)
MESSAGES = [cls for cls in vars(types).values() if hasattr(cls, "TYPE")]
CLASSES = {cls.TYPE: cls for cls in MESSAGES}
NUMBERS = {
    "bool": st.booleans(),
    "float32": st.floats(width=32),
    "float64": st.floats(),
    **{f"uint{n}": st.integers(0, 2**n - 1) for n in (8, 16, 32, 64)},
    **{f"int{n}": st.integers(-(2 ** (n - 1)), 2 ** (n - 1) - 1) for n in (8, 16, 32, 64)},
}


@cache
def messages(name: str) -> st.SearchStrategy[Message]:
    """Any message of a type, by its definition."""
    values = []
    for field in fields_of(name):
        item = NUMBERS.get(field.type, TEXT) if field.type not in CLASSES else messages(field.type)
        if field.is_sequence and field.type == "uint8":
            values.append(st.binary(max_size=4))
        else:
            values.append(st.lists(item, max_size=4).map(tuple) if field.is_sequence else item)
    return st.tuples(*values).map(lambda given: CLASSES[name](*given))


ANY_MESSAGE = st.sampled_from(sorted(CLASSES)).flatmap(messages)


def plain(message: Any, name: str) -> Any:
    """All leaves, as text: NaN equals NaN, and -0.0 is not 0.0."""
    return [_plain(getattr(message, field.name), field.type) for field in fields_of(name)]


def _plain(value: Any, kind: str) -> Any:
    if isinstance(value, np.ndarray):
        value = value.tolist()
    if isinstance(value, list | tuple | bytes):
        return [_plain(item, kind) for item in value]
    return plain(value, kind) if kind in CLASSES else repr(value)


def of_rosbags(payload: bytes, name: str) -> Any:
    """What rosbags reads, or None if it refuses."""
    try:
        return plain(store().deserialize_cdr(payload, name), name)
    except (SerdeError, ValueError, AssertionError):
        return None


def ours(payload: bytes, name: str) -> Any:
    """What we read, or None if we refuse."""
    try:
        return plain(decode(payload, CLASSES[name]), name)
    except DecodeError:
        return None


@given(ANY_MESSAGE)
def test_bytes_are_those_of_rosbags(message: Message) -> None:
    assert encode(message) == bytes(store().serialize_cdr(for_rosbags(message), message.TYPE))


@given(ANY_MESSAGE)
def test_bytes_of_rosbags_in_either_order_come_back(message: Message) -> None:
    for little_endian in (True, False):
        raw = store().serialize_cdr(for_rosbags(message), message.TYPE, little_endian=little_endian)
        read = decode(bytes(raw), type(message))
        assert plain(read, message.TYPE) == plain(message, message.TYPE)
        assert type(read) is type(message)
        with pytest.raises(dataclasses.FrozenInstanceError):
            setattr(read, fields_of(message.TYPE)[0].name, None)


@given(st.binary(max_size=400), st.sampled_from(sorted(CLASSES)))
def test_arbitrary_bytes_are_read_or_refused_as_by_rosbags(payload: bytes, name: str) -> None:
    for raw in (payload, b"\0\1\0\0" + payload):
        assert ours(raw, name) == of_rosbags(raw, name)


@given(ANY_MESSAGE, st.data())
def test_damaged_bytes_are_read_or_refused_as_by_rosbags(message: Message, data: st.DataObject) -> None:
    raw = bytearray(encode(message))
    for _ in range(data.draw(st.integers(0, 3))):
        raw[data.draw(st.integers(0, len(raw) - 1))] = data.draw(st.sampled_from((0, 1, 4, 127, 128, 255)))
    cut = data.draw(st.integers(0, len(raw)))
    for payload in (bytes(raw), bytes(raw[:cut]), bytes(raw) + bytes(len(raw) - cut)):
        assert ours(payload, message.TYPE) == of_rosbags(payload, message.TYPE)


@given(ANY_MESSAGE)
def test_cut_off_bytes_are_refused(message: Message) -> None:
    raw = encode(message)
    for end in range(len(raw)):
        with pytest.raises(DecodeError, match=message.TYPE):
            decode(raw[:end], type(message))


@given(st.sampled_from(sorted(CLASSES)))
def test_definitions_are_read_as_rosbags_reads_them(name: str) -> None:
    parsed = get_types_from_msg(definitions()[name], name)[name][1]
    assert [field.name for field in fields_of(name)] == [field for field, _ in parsed]
    for field, (_, (kind, what)) in zip(fields_of(name), parsed, strict=True):
        assert field.is_sequence == (kind.name == "SEQUENCE")
        leaf = what[0] if field.is_sequence else (kind, what)
        assert field.type == (leaf[1] if isinstance(leaf[1], str) else leaf[1][0])


@typing.no_type_check
@pytest.mark.parametrize(
    "message",
    [
        DataPackage(frequency_mhz=65536),
        DataPackage(frequency_mhz=-1),
        DataPackage(frequency_mhz="1"),
        DataPackage(state=types.AircraftState(groundspeed_mps=1e39)),
        DataPackage(state=types.AircraftState(mode="\ud800")),
        DataPackage(waypoints=(Waypoint("north"),)),
    ],
)
def test_what_does_not_fit_its_field_is_the_callers_mistake(message: Message) -> None:
    with pytest.raises(ValueError, match=r"cannot be coded|surrogates"):
        encode(message)
