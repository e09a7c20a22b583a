"""A stream file reads back as it was written; what was cut off ends it, what is damaged is told with its place."""

from __future__ import annotations

import struct
import tracemalloc
from itertools import pairwise
from pathlib import Path

import pytest

from bridge.record.packets import SentPacket, decode_packet, encode_packet
from bridge.record.streams import (
    BUFFER_BYTES,
    ENTRY_HEAD_BYTES,
    PAYLOAD_MAX_BYTES,
    START_BYTES,
    Entry,
    StreamError,
    StreamFollower,
    StreamWriter,
    pack_stream,
    read_stream,
)
from tests.full_disk import no_file_beyond

ENTRIES = [Entry(0, b""), Entry(50_000_000, b"abc"), Entry(50_000_000, b"d" * 1000)]


def written(path: Path, entries: list[Entry]) -> Path:
    with StreamWriter(path) as writer:
        for entry in entries:
            writer.write(*entry)
    return path


def test_entries_come_back_and_folders_are_made(tmp_path: Path) -> None:
    assert list(read_stream(written(tmp_path / "a" / "s.bin", ENTRIES))) == ENTRIES


def test_bytes_are_as_documented(tmp_path: Path) -> None:
    path = written(tmp_path / "s.bin", [Entry(7, b"xy")])
    assert path.read_bytes() == b"LLSTREAM" + struct.pack("<IqI", 2, 7, 2) + b"xy"


def test_flushed_entries_are_on_disk_before_close(tmp_path: Path) -> None:
    writer = StreamWriter(tmp_path / "s.bin")
    writer.write(1, b"x")
    writer.flush()
    assert list(read_stream(tmp_path / "s.bin")) == [Entry(1, b"x")]
    writer.close()
    writer.close()


def test_any_cut_leaves_the_whole_entries_before_it(tmp_path: Path) -> None:
    raw = written(tmp_path / "s.bin", ENTRIES).read_bytes()
    for size in range(len(raw)):
        (tmp_path / "s.bin").write_bytes(raw[:size])
        found = list(read_stream(tmp_path / "s.bin"))
        assert found == ENTRIES[: len(found)]
    assert len(found) == len(ENTRIES) - 1


def test_damage_is_told_with_file_and_offset(tmp_path: Path) -> None:
    path, start = tmp_path / "s.bin", b"LLSTREAM" + struct.pack("<I", 2)
    for raw, message in (
        (b"sim_time_ns,tx", r"s\.bin: offset 0: not a stream file"),
        (b"LLSTREAM" + struct.pack("<I", 1), r"s\.bin: offset 8: version 1; this lostlink reads version 2"),
        (start + struct.pack("<qIqI", 9, 0, 8, 0), r"s\.bin: offset 24: tick 8 ns comes after 9 ns"),
        (start + struct.pack("<qI", -1, 0), r"s\.bin: offset 12: tick -1 ns"),
        (
            start + struct.pack("<qI", 1, PAYLOAD_MAX_BYTES + 1),
            r"s\.bin: offset 12: an entry of 16777217 bytes",
        ),
    ):
        path.write_bytes(raw)
        with pytest.raises(StreamError, match=message):
            list(read_stream(path))


def test_caller_mistakes_are_refused(tmp_path: Path) -> None:
    with StreamWriter(tmp_path / "s.bin") as writer:
        writer.write(5, b"")
        for tick_ns, payload in ((4, b""), (1 << 63, b""), (6, bytes(PAYLOAD_MAX_BYTES + 1))):
            with pytest.raises(ValueError, match=r"s\.bin: "):
                writer.write(tick_ns, payload)
    assert list(read_stream(tmp_path / "s.bin")) == [Entry(5, b"")]


def test_reading_holds_one_entry_at_a_time(tmp_path: Path) -> None:
    written(tmp_path / "s.bin", [Entry(i, bytes(100_000)) for i in range(200)])
    tracemalloc.start()
    assert sum(len(entry.payload) for entry in read_stream(tmp_path / "s.bin")) == 20_000_000
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 2_000_000


@pytest.mark.parametrize(
    "packet",
    [SentPacket(0, 0, "", b""), SentPacket(7, 1 << 62, "tëam", b"\0\xff" * 9, "text/plain")],
)
def test_packet_round_trips(packet: SentPacket) -> None:
    assert decode_packet(encode_packet(packet)) == packet


def test_packet_mistakes_are_refused() -> None:
    with pytest.raises(ValueError, match="int64"):
        encode_packet(SentPacket(1 << 63, 0, "c", b""))
    with pytest.raises(ValueError, match="65536"):
        encode_packet(SentPacket(1, 0, "c" * 65536, b""))
    whole = encode_packet(SentPacket(1, 2, "team", b""))
    for size in range(len(whole)):
        with pytest.raises(ValueError, match="too few"):
            decode_packet(whole[:size])


@pytest.mark.parametrize("most_bytes", [1, 7, 1 << 16])
def test_a_follower_reads_on_as_the_file_grows(tmp_path: Path, most_bytes: int) -> None:
    path = tmp_path / "s.bin"
    follower = StreamFollower(path)
    assert follower.read(most_bytes) is None
    whole = written(tmp_path / "whole.bin", ENTRIES).read_bytes()
    found: list[Entry] = []
    for begin, end in pairwise((0, 3, 12, 20, 30, len(whole) - 1, len(whole))):
        with path.open("ab") as file:
            file.write(whole[begin:end])
        while (more := follower.read(most_bytes)) is not None:
            found += more
        assert found == list(read_stream(path))
    assert found == ENTRIES
    follower.close()


def test_a_follower_reads_what_is_packed_before_and_meanwhile(tmp_path: Path) -> None:
    path = written(tmp_path / "s.bin", ENTRIES)
    early, late = StreamFollower(path), StreamFollower(path)
    assert early.read(30) == ENTRIES[:1]
    pack_stream(path)
    assert early.read(1 << 16) == ENTRIES[1:]
    assert late.read(1 << 16) == ENTRIES
    early.close()
    late.close()


def test_a_follower_names_the_place_of_damage(tmp_path: Path) -> None:
    path = written(tmp_path / "s.bin", ENTRIES[1:])
    with path.open("ab") as file:
        file.write(struct.pack("<qI", 1, 0))
    with pytest.raises(StreamError, match="offset 1039: tick 1 ns comes after 50000000 ns"):
        (follower := StreamFollower(path)).read(1 << 16)
    follower.close()


def test_a_stream_that_finds_no_room_to_be_packed_stays_as_it_is(tmp_path: Path) -> None:
    path = written(tmp_path / "a.bin", ENTRIES)
    with no_file_beyond(10), pytest.raises(OSError, match="too large"):
        pack_stream(path)
    assert list(tmp_path.iterdir()) == [path]
    assert list(read_stream(path, is_whole=True)) == ENTRIES


def test_an_entry_that_found_no_room_is_not_there_and_those_after_it_are(tmp_path: Path) -> None:
    path = tmp_path / "a.bin"
    writer = StreamWriter(path)
    first = bytes(BUFFER_BYTES - START_BYTES - ENTRY_HEAD_BYTES - 20)
    writer.write(0, first)
    with no_file_beyond(100), pytest.raises(OSError, match="too large"):
        writer.write(50, b"x" * 50)  # its head alone would have room
    with no_file_beyond(BUFFER_BYTES + 100), pytest.raises(OSError, match="too large"):
        writer.write(60, b"x" * 2 * BUFFER_BYTES)  # half of it would have room
    writer.write(100, b"after")
    longest = b"y" * 2 * BUFFER_BYTES
    writer.write(110, longest)
    writer.write(120, b"")
    writer.close()
    assert list(read_stream(path, is_whole=True)) == [(0, first), (100, b"after"), (110, longest), (120, b"")]
