"""From the streams of MAVLink: whole frames as bytes, or messages by their fields."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Final

from aps.wire.dialect import message_fields, message_name, unsigned_64_bit_fields
from aps.wire.framer import Framer
from bridge.bus.messages import Header, Mavlink, encode
from bridge.record import names
from bridge.record.streams import Entry, read_stream, stream_exists
from lostlink.export.mcap.file import McapFile
from lostlink.export.mcap.source import Feed, Item
from lostlink.export.mcap.topics import chunk
from lostlink.export.mcap.values import ValueType, kind_of, type_name

DIRECTIONS: Final = (names.Kind.FROM_AUTOPILOT, names.Kind.TO_AUTOPILOT)
_V1, _V2 = 0xFE, 0xFD
_V1_BYTES, _V2_BYTES, _SIGNATURE_BYTES = 8, 12, 13
_SIGNED: Final = 0x01


def mavlink_sources(run: Path, file: McapFile, node: str, prefix: str) -> Iterator[Feed]:
    """MAVLink from and to the autopilot of a node, as far as that is wanted and there."""
    if not file.settings.has("mavlink"):
        return
    items = _frames if file.settings.mavlink == "frames" else _messages
    for direction in DIRECTIONS:
        path = names.Stream(direction, node).path(run)
        if stream_exists(path):
            yield Feed(items(read_stream(path), file, node, f"/{prefix}/mavlink/{direction}"))


def _frames(entries: Iterator[Entry], file: McapFile, node: str, topic: str) -> Iterator[Item]:
    channel = file.channel(topic, Mavlink.TYPE, "mavlink")
    begun = b""
    for entry in entries:
        data = begun + entry.payload
        end = end_of_frames(data)
        begun = data[end:]
        if end:
            message = Mavlink(Header.at(entry.tick_ns, node), data[:end])
            yield entry.tick_ns, channel, encode(message)


def end_of_frames(data: bytes) -> int:
    """Where the last whole frame ends. Bytes that begin none are passed over, and belong to what follows."""
    position, size = 0, len(data)
    while position < size:
        mark = data[position]
        if mark == _V2:
            if position + 3 > size:
                return position
            signed = data[position + 2] & _SIGNED
            length = _V2_BYTES + data[position + 1] + (_SIGNATURE_BYTES if signed else 0)
        elif mark == _V1:
            if position + 2 > size:
                return position
            length = _V1_BYTES + data[position + 1]
        else:
            length = 1
        if position + length > size:
            return position
        position += length
    return position


def _messages(entries: Iterator[Entry], file: McapFile, node: str, topic: str) -> Iterator[Item]:
    framer, types = Framer(trusting=True), dict[str, ValueType]()
    for entry in entries:
        for frame in framer.receive(entry.payload):
            fields = message_fields(frame.raw)
            if not fields:
                continue
            values = {"sysid": frame.sysid, "compid": frame.compid, **fields}
            name = message_name(frame.msg_id)
            if name not in types:
                kinds = {key: kind_of(value) for key, value in values.items()}
                large = [key for key in unsigned_64_bit_fields(frame.msg_id) if kinds[key] == "integer"]
                kinds |= dict.fromkeys(large, "unsigned")
                types[name] = ValueType(f"lostlink_mavlink/msg/{type_name(name.lower())}", kinds)
                file.schemas.add({types[name].name: types[name].definition})
            channel = file.channel(f"{topic}/{chunk(name)}", types[name].name, "mavlink")
            yield entry.tick_ns, channel, types[name].encode(entry.tick_ns, node, values)
