"""What the nodes of a recorded run transmitted, as columns; payloads are read when somebody asks for them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bridge.bus.keys import ALL
from bridge.record import names
from bridge.record.packets import decode_packet
from bridge.record.streams import (
    ENTRY_HEAD_BYTES,
    START_BYTES,
    StreamError,
    entries_of,
    open_stream,
)
from channel.access.packets import Handling
from channel.medium.reception import EVERYBODY

NEAR_BYTES = 1 << 20
"""Of a stream as are kept: packets are mostly asked for one after the other."""


class SentPackets:
    """The packets of one node that its radio took, in the order of their numbers.

    Args:
        run: the run directory.
        node: the node's id.
        places: of all nodes' ids, and codes of groups (`channel.medium.addressees.codes_of`).

    Attributes:
        seq: int64, rising.
        sim_time_ns: when each was transmitted, int64.
        length_bytes: of the payloads, int64.
        to: place of the addressee, EVERYBODY, or a group's code.
        radios: name of the radio of each.
        channels: last part of each packet's key.
        encodings: what each payload is said to be; "" if nothing.
        handling: what the radio was to do with each.

    Raises:
        StreamError: the stream is damaged, or has what is no packet.
        OSError: it cannot be read.
    """

    def __init__(self, run: Path, node: str, places: dict[str, int]) -> None:
        self._path = names.packets(node).path(run)
        rows: list[tuple[int, int, int, int, int]] = []
        self.radios: list[str] = []
        self.channels: list[str] = []
        self.encodings: list[str] = []
        self.handling: list[Handling] = []
        addressees: dict[str, int] = {}
        offset = START_BYTES
        for tick_ns, entry in entries_of(self._path):
            offset += ENTRY_HEAD_BYTES
            try:
                packet = decode_packet(entry)
                if packet.address not in addressees:
                    addressees[packet.address] = _addressee(packet.address, places)
            except ValueError as error:
                raise StreamError(f"{self._path}: at {tick_ns} ns: {error}") from error
            offset += len(entry)
            length = len(packet.payload)
            to = addressees[packet.address]
            rows.append((packet.seq, packet.sim_time_ns, length, to, offset - length))
            self.radios.append(packet.radio)
            self.channels.append(packet.channel)
            self.encodings.append(packet.encoding)
            self.handling.append(packet.handling)
        table = np.array(rows, dtype=np.int64).reshape(-1, 5)
        self.seq, self.sim_time_ns, self.length_bytes, self.to, self._offset = np.ascontiguousarray(table.T)
        self._near_from, self._near = 0, b""

    def __len__(self) -> int:
        return len(self.seq)

    def row_of(self, seq: int) -> int | None:
        """Where the packet with a number is; None if the stream has it not (its writer was killed)."""
        row = int(np.searchsorted(self.seq, seq))
        return row if row < len(self.seq) and int(self.seq[row]) == seq else None

    def payload(self, row: int) -> bytes:
        """What a packet carried.

        Raises:
            OSError: the stream cannot be read any more.
        """
        begin, length = int(self._offset[row]), int(self.length_bytes[row])
        if not self._near_from <= begin <= begin + length <= self._near_from + len(self._near):
            with open_stream(self._path) as file:
                file.seek(begin)
                self._near_from, self._near = begin, file.read(max(length, NEAR_BYTES))
        return self._near[begin - self._near_from :][:length]

    def whole(self) -> NDArray[np.int64]:
        """Numbers, times, lengths and addressees of all packets, shape (4, packets)."""
        return np.stack((self.seq, self.sim_time_ns, self.length_bytes, self.to))


def _addressee(address: str, places: dict[str, int]) -> int:
    """The addressee of ``radio/to/channel``."""
    parts = address.split("/")
    if len(parts) != 3:
        raise ValueError(f"{address!r} is not radio/to/channel")
    to = parts[1]
    if to == ALL:
        return EVERYBODY
    if to not in places:
        raise ValueError(f"it is addressed to {to!r}, which is no node or group of this run")
    return places[to]
