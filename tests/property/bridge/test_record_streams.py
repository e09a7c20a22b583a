"""Streams and inputs: any entries come back, and arbitrary bytes are read or refused, never more."""

from __future__ import annotations

import hashlib
import json
import tempfile
from contextlib import suppress
from pathlib import Path

from hypothesis import given
from hypothesis import strategies as st

from aps.wire.dialect import Encoder, mavlink
from bridge.bus.messages import CommandGoal
from bridge.record.digests import stream_digest
from bridge.record.inputs.fields import VERBS
from bridge.record.inputs.file import InputError, InputWriter, RecordedInput, read_inputs
from bridge.record.packets import SentPacket, decode_packet, encode_packet
from bridge.record.streams import (
    MAGIC,
    Entry,
    StreamError,
    StreamWriter,
    open_stream,
    pack_stream,
    packed_path,
    read_stream,
)

TICKS = st.integers(0, 2**63 - 1)
ENTRIES = st.lists(st.builds(Entry, TICKS, st.binary(max_size=300)), max_size=20).map(
    lambda entries: sorted(entries, key=lambda e: e.tick_ns)
)


def file_of(folder: str, raw: bytes) -> Path:
    path = Path(folder) / "f"
    path.write_bytes(raw)
    return path


@given(ENTRIES, st.integers(0, 10_000))
def test_entries_come_back_whole_up_to_any_cut(entries: list[Entry], cut: int) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "s.bin"
        with StreamWriter(path) as writer:
            for entry in entries:
                writer.write(*entry)
        assert list(read_stream(path)) == entries
        raw = path.read_bytes()
        found = list(read_stream(file_of(folder, raw[:cut])))
        assert found == entries[: len(found)]
        if cut >= len(raw):
            assert found == entries
        pack_stream(path)
        assert not path.exists()
        assert list(read_stream(path)) == entries
        assert stream_digest(path) == hashlib.sha256(raw).hexdigest()
        with open_stream(path) as file:
            file.seek(min(cut, len(raw)))
            assert file.read() == raw[cut:]


@given(ENTRIES.filter(len), st.integers(0, 400), st.integers(0, 255))
def test_a_packed_stream_that_is_damaged_is_told_or_cut(entries: list[Entry], at: int, byte: int) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "s.bin"
        with StreamWriter(path) as writer:
            for entry in entries:
                writer.write(*entry)
        pack_stream(path)
        packed = packed_path(path)
        whole = packed.read_bytes()
        at %= len(whole)
        for raw in (whole[:at], whole[:at] + bytes([whole[at] ^ byte]) + whole[at + 1 :]):
            packed.write_bytes(raw)
            with suppress(StreamError):
                found = list(read_stream(path))
                assert found == entries[: len(found)]


@given(st.one_of(st.binary(max_size=200), st.binary(max_size=200).map(lambda b: MAGIC + b"\1\0\0\0" + b)))
def test_arbitrary_bytes_are_entries_or_damage(raw: bytes) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = file_of(folder, raw)
        entries: list[Entry] = []
        try:
            entries.extend(read_stream(path))
        except StreamError as error:
            told = str(error).startswith(f"{path}: offset ")
        else:
            told = True
        assert told
        assert sum(12 + len(entry.payload) for entry in entries) <= max(0, len(raw) - 12)


UTF8 = st.text(st.characters(codec="utf-8"), max_size=40)


@given(st.integers(-(2**63), 2**63 - 1), TICKS, UTF8, st.binary(), UTF8)
def test_any_packet_round_trips(
    seq: int, sim_time_ns: int, address: str, payload: bytes, encoding: str
) -> None:
    packet = SentPacket(seq, sim_time_ns, address, payload, encoding)
    assert decode_packet(encode_packet(packet)) == packet


@given(st.binary(max_size=60))
def test_arbitrary_bytes_are_a_packet_or_refused(raw: bytes) -> None:
    try:
        packet = decode_packet(raw)
    except ValueError:
        return
    assert encode_packet(packet) == raw


FLOATS = st.floats(allow_nan=False)
TEXT = st.text(st.characters(codec="utf-8"), max_size=20)
PLAIN = st.none() | st.booleans() | st.integers() | FLOATS | TEXT
ARGUMENTS = TEXT | st.dictionaries(TEXT, PLAIN | st.lists(PLAIN, max_size=3), max_size=3).map(json.dumps)
COMMANDS = st.builds(
    RecordedInput.command,
    TICKS,
    st.sampled_from(VERBS),
    st.builds(CommandGoal, TEXT, FLOATS, FLOATS, FLOATS, FLOATS, ARGUMENTS),
)
MESSAGES = st.one_of(
    st.builds(
        mavlink.MAVLink_set_mode_message, st.integers(0, 255), st.integers(0, 255), st.integers(0, 2**32 - 1)
    ),
    st.builds(
        mavlink.MAVLink_play_tune_message, st.integers(0, 255), st.integers(0, 255), st.binary(max_size=30)
    ),
)
FRAMES = st.builds(
    lambda tick_ns, message: RecordedInput.frame(tick_ns, 1, Encoder(255, 190).encode(message)),
    TICKS,
    MESSAGES,
)


@given(st.lists(st.one_of(COMMANDS, FRAMES), max_size=10))
def test_any_inputs_come_back(items: list[RecordedInput]) -> None:
    items = [RecordedInput.opened(0, 1), *sorted(items, key=lambda i: i.tick_ns)]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "0.jsonl"
        writer = InputWriter(path)
        for item in items:
            writer.write(item)
        writer.close()
        assert [repr(item) for item in read_inputs(path)] == [repr(item) for item in items]


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=5,
)
LIKELY = st.dictionaries(
    st.sampled_from(["tick_ns", "kind", "link", "hex", "verb", "mode", "speed_mps", "arguments"]),
    JSON | st.sampled_from(["open", "frame", "close", "command", "goto", "fd09"]),
    max_size=7,
)


@given(st.one_of(st.binary(max_size=100), LIKELY.map(lambda c: json.dumps(c).encode())))
def test_arbitrary_lines_are_inputs_or_refused(raw: bytes) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = file_of(folder, raw)
        told = ""
        try:
            items = read_inputs(path)
        except InputError as error:
            told = str(error)
        if told:
            assert told.startswith(f"{path}:")
        else:
            assert all(isinstance(item, RecordedInput) for item in items)
