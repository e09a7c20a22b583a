"""Messages: our records mirror the .msg files, and their bytes are CDR that any other reader agrees with."""

from __future__ import annotations

import dataclasses
import math
import struct
import typing

import pytest
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from bridge.bus.messages import (
    AgentStatus,
    AircraftState,
    Clock,
    CommandEvent,
    CommandGoal,
    CommunicationMatrix,
    CommunicationStatus,
    DataPackage,
    DecodeError,
    Fates,
    Header,
    Heard,
    Links,
    Mavlink,
    Measurements,
    Message,
    Packet,
    RadioStatus,
    RadioSwitch,
    Time,
    Truth,
    Truths,
    Vector3,
    Waypoint,
    decode,
    encode,
    encoding_of,
)
from bridge.bus.messages.codec import class_of
from bridge.bus.messages.definitions import definitions

OURS = (
    AgentStatus,
    AircraftState,
    Clock,
    CommandEvent,
    CommandGoal,
    CommunicationMatrix,
    CommunicationStatus,
    DataPackage,
    Fates,
    Heard,
    Links,
    Mavlink,
    Measurements,
    Packet,
    RadioStatus,
    RadioSwitch,
    Truth,
    Truths,
    Waypoint,
)


@pytest.mark.parametrize("cls", OURS)
def test_record_has_the_fields_of_its_definition_in_order(cls: type[Message]) -> None:
    parsed = get_types_from_msg(definitions()[cls.TYPE], cls.TYPE)
    defined = [name for name, _ in parsed[cls.TYPE][1]]
    assert [f.name for f in dataclasses.fields(cls)] == defined


@pytest.mark.parametrize("cls", OURS)
def test_constants_of_the_definition_are_those_of_the_record(cls: type[Message]) -> None:
    for name, _, value in get_types_from_msg(definitions()[cls.TYPE], cls.TYPE)[cls.TYPE][0]:
        assert getattr(cls, name) == value


def test_every_definition_has_a_record() -> None:
    assert {cls.TYPE for cls in OURS} == {name for name in definitions() if name.startswith("lostlink_msgs")}


def test_package_comes_back_as_it_was() -> None:
    state = AircraftState(
        Header.at(12_345_678_901, "1"), 2, Vector3(0.1, -0.2, 3.0), mode="GUIDED", armed=True
    )
    package = DataPackage(
        Header.at(5, "1"),
        2412,
        state,
        (Waypoint(-105.0, 40.0, 40.0), Waypoint(1.0, 2.0, 3.0)),
        (-80.5, math.inf),
    )
    assert decode(encode(package), DataPackage) == package


def test_sequences_of_booleans_and_texts_come_back() -> None:
    status = CommunicationStatus(Header.at(1, "0"), ("1", "gcs"), (True, False))
    assert decode(encode(status), CommunicationStatus) == status


def test_bytes_are_little_endian_cdr() -> None:
    payload = encode(Header.at(3_000_000_007, "ua"))
    assert payload[:4] == b"\x00\x01\x00\x00"
    assert struct.unpack_from("<iII", payload, 4) == (3, 7, 3)
    assert payload[16:19] == b"ua\0"


def test_another_reader_reads_the_same() -> None:
    """rosbags' own classes, from the definitions alone, see what the record held."""
    store = get_typestore(Stores.EMPTY)
    found: dict[str, typing.Any] = {}
    for name, text in definitions().items():
        found |= get_types_from_msg(text, name)
    store.register(found)
    truth = Truth(Header.at(9, "0"), 1.0, 2.0, 3.0, Vector3(4.0, 5.0, 6.0), airspeed_mps=7.0)
    other = store.deserialize_cdr(encode(truth), Truth.TYPE)
    assert (other.position_ned_m.y, other.airspeed_mps, other.header.frame_id) == (5.0, 7.0, "0")


@pytest.mark.parametrize("cut", [0, 3, 4, 10, 60])
def test_short_payload_is_a_decode_error(cut: int) -> None:
    with pytest.raises(DecodeError, match="AircraftState"):
        decode(encode(AircraftState())[:cut], AircraftState)


def test_encoding_names_the_type() -> None:
    assert encoding_of(Clock) == "application/cdr;lostlink_msgs/msg/Clock"
    assert class_of(encoding_of(Clock)) is Clock
    assert class_of("application/json") is None
    assert class_of("application/cdr;other_msgs/msg/Clock") is None


def test_time_keeps_nanoseconds_of_a_long_run() -> None:
    thirty_days_ns = 30 * 86_400 * 1_000_000_000 + 1
    assert Time.from_ns(thirty_days_ns).ns == thirty_days_ns
