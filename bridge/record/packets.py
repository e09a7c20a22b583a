"""The payload of ``packets/<node>``: one packet that the node transmitted and the radio took.

int64 sequence number, int64 sim time of transmission in ns, uint16 lengths of address, encoding and handling, the
address (``radio/to/channel``, as in the key) and the encoding in UTF-8, the handling (`bridge.bus.handling`; nothing
unless the agent asked for it), and the packet's own bytes; all numbers are little-endian.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import accumulate
from pathlib import Path
from typing import Final

from bridge.bus.handling import PLAIN, Handling, handling_bytes, handling_from_bytes
from bridge.record import names
from bridge.record.streams import decoded

_HEAD: Final = struct.Struct("<qqHHH")
TEXT_MAX_BYTES: Final = 0xFFFF


@dataclass(frozen=True, slots=True)
class SentPacket:
    """What a node gave to the radio.

    Attributes:
        seq: the sender's count.
        sim_time_ns: when.
        address: ``radio/to/channel``, as in the key.
        payload: opaque.
        encoding: what the payload is said to be, as Zenoh names it; "" for bytes of which nothing is said.
        handling: what the radio was to do with it.
    """

    seq: int
    sim_time_ns: int
    address: str
    payload: bytes
    encoding: str = ""
    handling: Handling = PLAIN

    @property
    def radio(self) -> str:
        """First part of the address."""
        return self.address.partition("/")[0]

    @property
    def channel(self) -> str:
        """Last part of the address."""
        return self.address.rpartition("/")[2]


def encode_packet(packet: SentPacket) -> bytes:
    """The packet as the payload of a stream's entry.

    Raises:
        ValueError: a number does not fit 64 bits, or the address or the encoding is too long.
    """
    address, encoding = packet.address.encode(), packet.encoding.encode()
    handling = handling_bytes(packet.handling)
    try:
        head = _HEAD.pack(packet.seq, packet.sim_time_ns, len(address), len(encoding), len(handling))
    except struct.error as error:
        raise ValueError(
            f"seq {packet.seq} and sim_time_ns {packet.sim_time_ns} have to fit int64, and the {len(address)} bytes "
            f"of the address and {len(encoding)} of the encoding must each be at most {TEXT_MAX_BYTES}"
        ) from error
    return head + address + encoding + handling + packet.payload


def decode_packet(entry: bytes) -> SentPacket:
    """The packet in an entry.

    Raises:
        ValueError: the bytes are not one.
    """
    if len(entry) < _HEAD.size:
        raise ValueError(f"{len(entry)} bytes are too few for a packet")
    seq, sim_time_ns, *lengths = _HEAD.unpack_from(entry)
    _, first, second, end = accumulate(lengths, initial=_HEAD.size)
    if len(entry) < end:
        raise ValueError(
            f"{len(entry)} bytes are too few for an address, an encoding and a handling of {sum(lengths)} bytes"
        )
    address, encoding = entry[_HEAD.size : first].decode(), entry[first:second].decode()
    handling = handling_from_bytes(entry[second:end])
    return SentPacket(seq, sim_time_ns, address, entry[end:], encoding, handling)


def packets_of(run: Path, node: str) -> Iterator[tuple[int, SentPacket]]:
    """What ``node`` gave to the radio in the run in ``run``, with the ticks; none if it has no such stream.

    Raises:
        StreamError, OSError: as `decoded`.
        ValueError: the id cannot be one.
    """
    return decoded(names.packets(node).path(run), decode_packet)
