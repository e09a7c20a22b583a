"""The payload of ``packets/<node>``: one packet that the node transmitted and the radio took.

int64 sequence number, int64 sim time of transmission in ns, uint16 length of the address, that address in UTF-8
(``radio/to/channel``, as in the key),
and the packet's own bytes; all numbers are little-endian.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from bridge.record import names
from bridge.record.streams import decoded

_HEAD: Final = struct.Struct("<qqH")
CHANNEL_MAX_BYTES: Final = 0xFFFF


@dataclass(frozen=True, slots=True)
class SentPacket:
    """What a node gave to the radio; ``payload`` is opaque."""

    seq: int
    sim_time_ns: int
    channel: str
    payload: bytes


def encode_packet(packet: SentPacket) -> bytes:
    """The packet as the payload of a stream's entry.

    Raises:
        ValueError: a number does not fit 64 bits, or the address is too long.
    """
    channel = packet.channel.encode()
    try:
        head = _HEAD.pack(packet.seq, packet.sim_time_ns, len(channel))
    except struct.error as error:
        raise ValueError(
            f"seq {packet.seq} and sim_time_ns {packet.sim_time_ns} have to fit int64, and the channel's "
            f"{len(channel)} bytes must be at most {CHANNEL_MAX_BYTES}"
        ) from error
    return head + channel + packet.payload


def decode_packet(entry: bytes) -> SentPacket:
    """The packet in an entry.

    Raises:
        ValueError: the bytes are not one.
    """
    if len(entry) < _HEAD.size:
        raise ValueError(f"{len(entry)} bytes are too few for a packet")
    seq, sim_time_ns, length = _HEAD.unpack_from(entry)
    end = _HEAD.size + length
    if len(entry) < end:
        raise ValueError(f"{len(entry)} bytes are too few for a channel's name of {length} bytes")
    return SentPacket(seq, sim_time_ns, entry[_HEAD.size : end].decode(), entry[end:])


def packets_of(run: Path, node: str) -> Iterator[tuple[int, SentPacket]]:
    """What ``node`` gave to the radio in the run in ``run``, with the ticks; none if it has no such stream.

    Raises:
        StreamError, OSError: as `decoded`.
        ValueError: the id cannot be one.
    """
    return decoded(names.packets(node).path(run), decode_packet)
