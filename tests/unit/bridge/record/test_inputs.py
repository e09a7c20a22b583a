"""Inputs read back as they took effect, can be edited by hand, and mistakes in them are told with their place."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path

import pytest

from aps.wire.dialect import Encoder, mavlink
from bridge.bus.messages import CommandGoal
from bridge.record.inputs.file import (
    InputError,
    InputWriter,
    PacketWay,
    RecordedInput,
    all_inputs,
    inputs_of,
    read_inputs,
)
from bridge.record.names import inputs_path

FRAME = Encoder(255, 190).encode(mavlink.MAVLink_set_mode_message(1, 1, 4))
ITEMS = [
    RecordedInput.opened(0, 3),
    RecordedInput.frame(50_000_000, 3, FRAME),
    RecordedInput.command(50_000_000, "goto", CommandGoal("", 1.1, -0.0, 20.0, 5.0)),
    RecordedInput.command(60_000_000, "mode", CommandGoal("GUIDED", speed_mps=math.inf)),
    RecordedInput.closed(100_000_000, 3),
    RecordedInput.opened(100_000_000, 3),
    RecordedInput.packet(150_000_000, PacketWay("mesh", "gcs"), b"\x45\x00"),
]


def write(path: Path, items: list[RecordedInput]) -> None:
    writer = InputWriter(path)
    for item in items:
        writer.write(item)
    writer.close()


def test_inputs_come_back(tmp_path: Path) -> None:
    path = inputs_path(tmp_path, "0")
    write(path, ITEMS)
    assert read_inputs(path) == ITEMS == inputs_of(tmp_path, "0")
    assert math.copysign(1, read_inputs(path)[2].goal.latitude_deg) == -1  # type: ignore[union-attr]
    assert all_inputs(tmp_path) == {"0": ITEMS}


def test_there_is_no_file_without_inputs(tmp_path: Path) -> None:
    InputWriter(inputs_path(tmp_path, "0")).close()
    assert list(tmp_path.iterdir()) == []
    assert inputs_of(tmp_path, "0") == []
    assert all_inputs(tmp_path) == {}
    with pytest.raises(OSError, match="No such file"):
        read_inputs(inputs_path(tmp_path, "0"))


def test_each_line_is_there_at_once_and_for_people(tmp_path: Path) -> None:
    path = tmp_path / "0.jsonl"
    writer = InputWriter(path)
    for item in ITEMS[:3]:
        writer.write(item)
    lines = [json.loads(line) for line in path.read_text().splitlines()]
    assert lines[1] == {
        "tick_ns": 50_000_000,
        "kind": "frame",
        "link": 3,
        "name": "SET_MODE",
        "hex": FRAME.hex(),
    }
    assert lines[2] == {
        "tick_ns": 50_000_000,
        "kind": "command",
        "verb": "goto",
        "longitude_deg": 1.1,
        "latitude_deg": -0.0,
        "altitude_rel_m": 20.0,
        "speed_mps": 5.0,
    }
    writer.write(ITEMS[6])
    assert json.loads(path.read_text().splitlines()[-1]) == {
        "tick_ns": 150_000_000,
        "kind": "packet",
        "radio": "mesh",
        "to": "gcs",
        "channel": "ip",
        "hex": "4500",
    }
    writer.close()


def test_names_are_for_people_and_hex_is_what_counts(tmp_path: Path) -> None:
    path = tmp_path / "0.jsonl"
    path.write_text(
        '{"tick_ns":0,"kind":"open","link":0}\n\n'
        f'{{"kind":"frame","tick_ns":0,"link":0,"hex":"{FRAME.hex(" ").upper()}","name":["anything"]}}\n'
        '{"tick_ns":1,"kind":"command","verb":"takeoff","altitude_rel_m":20}\n'
    )
    assert read_inputs(path)[1:] == [
        RecordedInput.frame(0, 0, FRAME),
        RecordedInput.command(1, "takeoff", CommandGoal(altitude_rel_m=20.0)),
    ]


OPEN = '{"tick_ns": 5, "kind": "open", "link": 3}'
MISTAKES = [
    ("[1]", "a JSON object is expected"),
    ("{", "not JSON"),
    (
        '{"tick_ns": 5, "kind": "opened", "link": 3}',
        "'kind': 'opened' is not allowed; one of open, frame, close, command",
    ),
    ('{"tick_ns": 5, "link": 3}', "'kind': None is not allowed"),
    ('{"tick_ns": 5, "kind": "close"}', "'link' is missing; 'close' has tick_ns, kind, link"),
    ('{"tick_ns": 5, "kind": "close", "link": 3, "hex": ""}', "'hex' is unknown"),
    ('{"tick_ns": 5, "tick_ns": 6, "kind": "close", "link": 3}', "'tick_ns' is there more than once"),
    ('{"tick_ns": 4, "kind": "close", "link": 3}', "'tick_ns': 4 goes back; at least 5"),
    ('{"tick_ns": 5.5, "kind": "close", "link": 3}', "'tick_ns': 5.5 is not a whole number from 0"),
    ('{"tick_ns": true, "kind": "close", "link": 3}', "'tick_ns': True is not a whole number"),
    ('{"tick_ns": 5, "kind": "close", "link": -1}', "'link': -1 is not a whole number"),
    ('{"tick_ns": 5, "kind": "close", "link": 4}', "link 4 is not open"),
    ('{"tick_ns": 5, "kind": "open", "link": 3}', "link 3 is open already"),
    (
        '{"tick_ns": 5, "kind": "frame", "link": 3, "hex": "fd0"}',
        "'hex': 'fd0' is not an even number of digits",
    ),
    *(
        (json.dumps({"tick_ns": 5, "kind": "frame", "link": 3, "hex": data.hex()}), f"key 'hex': {text}")
        for data, text in (
            (FRAME[:-1], f"one whole MAVLink frame is expected: its {len(FRAME) - 1} bytes are none"),
            (FRAME + FRAME, "one whole MAVLink frame is expected: its"),
            (FRAME + b"\x00", "one whole MAVLink frame is expected: its"),
            (b"hello", "one whole MAVLink frame is expected: its 5 bytes are none"),
            (FRAME[:10] + b"\x05" + FRAME[11:], "one whole MAVLink frame is expected: its checksum is wrong"),
        )
    ),
    ('{"tick_ns": 5, "kind": "frame", "link": 3, "hex": ""}', "'hex': a frame has at least one byte"),
    ('{"tick_ns": 5, "kind": "frame", "link": 3, "hex": 9}', "'hex': 9 is not text"),
    ('{"tick_ns": 5, "kind": "command", "verb": "fly"}', "'verb': 'fly' is not allowed; one of arm, disarm"),
    ('{"tick_ns": 5, "kind": "command", "verb": "mode", "mode": 4}', "'mode': 4 is not text"),
    (
        '{"tick_ns": 5, "kind": "command", "verb": "goto", "speed_mps": "5"}',
        "'speed_mps': '5' is not a number",
    ),
    ('{"tick_ns": 5, "kind": "command", "verb": "goto", "link": 3}', "'link' is unknown"),
    *(
        (
            json.dumps(
                {"tick_ns": 5, "kind": "packet", "radio": "main", "to": "1", "channel": "ip"} | fields
            ),
            text,
        )
        for fields, text in (
            ({}, "'hex' is missing; 'packet' has tick_ns, kind, radio, to, channel, hex"),
            ({"hex": ""}, "'hex': a frame or a packet has at least one byte"),
            ({"hex": "4"}, "'hex': '4' is not an even number of digits"),
            ({"hex": "00" * 65536}, "'hex': 65536 bytes; a packet has at most 65535"),
            ({"hex": "45", "to": "a/b"}, "'to': 'a/b' cannot be part of a key"),
            ({"hex": "45", "radio": 1}, "'radio': 1 is not text"),
            ({"hex": "45", "channel": "*"}, "'channel': '*' cannot be part of a key"),
            ({"hex": "45", "link": 3}, "'link' is unknown"),
        )
    ),
]


@pytest.mark.parametrize(("line", "message"), MISTAKES)
def test_mistake_is_told_with_file_line_and_key(tmp_path: Path, line: str, message: str) -> None:
    (tmp_path / "0.jsonl").write_text(f"{OPEN}\n{line}\n")
    with pytest.raises(InputError) as caught:
        read_inputs(tmp_path / "0.jsonl")
    assert str(caught.value).startswith(f"{tmp_path / '0.jsonl'}:2: ")
    assert message in str(caught.value)


def test_writer_refuses_what_the_reader_would(tmp_path: Path) -> None:
    writer = InputWriter(tmp_path / "0.jsonl")
    writer.write(RecordedInput.opened(5, 1))
    for item in (RecordedInput.closed(4, 1), RecordedInput.opened(5, 1), RecordedInput.frame(5, 2, b"x")):
        with pytest.raises(InputError):
            writer.write(item)
    writer.close()
    assert len(read_inputs(tmp_path / "0.jsonl")) == 1


@pytest.mark.parametrize(
    "make",
    [
        lambda: RecordedInput(0, "frame", 1),
        lambda: RecordedInput(0, "open", 1, b"x"),
        lambda: RecordedInput(0, "open"),
        lambda: RecordedInput(0, "command", verb="arm"),
        lambda: RecordedInput(0, "open", 1, verb="arm"),
        lambda: RecordedInput(0, "command", 1, verb="arm", goal=CommandGoal()),
        lambda: RecordedInput(1 << 63, "open", 1),
        lambda: RecordedInput(0, "packet", data=b"x"),
        lambda: RecordedInput(0, "packet", 1, b"x", way=PacketWay()),
        lambda: RecordedInput(0, "frame", 1, b"x", way=PacketWay()),
    ],
)
def test_values_that_do_not_go_together_are_refused(make: Callable[[], RecordedInput]) -> None:
    with pytest.raises(InputError, match="key"):
        make()


def test_bytes_of_a_modem_are_read_back_and_need_their_radio(tmp_path: Path) -> None:
    item = RecordedInput.serial(50_000_000, "telemetry", b"\x00\xfd")
    writer = InputWriter(tmp_path / "gcs.jsonl")
    writer.write(item)
    writer.close()
    assert (tmp_path / "gcs.jsonl").read_text() == (
        '{"tick_ns": 50000000, "kind": "serial", "radio": "telemetry", "hex": "00fd"}\n'
    )
    assert read_inputs(tmp_path / "gcs.jsonl") == [item]
    with pytest.raises(InputError, match="key 'radio'"):
        RecordedInput(0, "serial", data=b"x")
    with pytest.raises(InputError, match="key 'hex'"):
        RecordedInput.serial(0, "telemetry", b"")
