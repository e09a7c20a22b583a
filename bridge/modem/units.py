"""Where a modem's firmware cuts a stream of bytes: after a MAVLink frame, by its start marker and length alone.

Source: ArduPilot/SiK 50189f29, `Firmware/radio/packet.c`: checksums are not looked at; a frame whose end does not come
goes on as it is; bytes before a start marker go on as they are. No byte is lost here, and none changes its place.
"""

from __future__ import annotations

from typing import Final, NamedTuple
from weakref import WeakKeyDictionary

MAGIC_V1: Final = 0xFE
MAGIC_V2: Final = 0xFD
AROUND_V1_BYTES, AROUND_V2_BYTES, SIGNATURE_BYTES = 8, 12, 13
"""Of a frame beside its payload: header and checksum; with MAVLink 2 perhaps a signature."""
LONGEST_FRAME_BYTES: Final = AROUND_V2_BYTES + 255 + SIGNATURE_BYTES
HEARTBEAT_BYTES: Final = 9
LEAST_TO_JUDGE: Final = 3
"""Start marker, length, and of MAVLink 2 the flags."""
RAW_BYTES: Final = 32
"""Bytes that are no frame go on when so many are there, or when the line pauses."""
PAUSE_BYTES: Final = 2
PATIENCE_NS: Final = 20_000_000
"""At least so long the rest of a frame is waited for: hosts that write a frame in two parts make pauses."""


class Unit(NamedTuple):
    """Bytes that belong together.

    Attributes:
        data: the bytes.
        version: of MAVLink, 1 or 2; 0: it is no frame.
        is_heartbeat: whether it looks like a HEARTBEAT.
    """

    data: bytes
    version: int = 0
    is_heartbeat: bool = False


class UnitCutter:
    """Cuts the bytes that arrive at a modem.

    Args:
        byte_ns: how long a byte takes on the line; 0: none.
    """

    __slots__ = ("_byte_ns", "_held", "_latest_ns")

    def __init__(self, byte_ns: int) -> None:
        self._byte_ns = byte_ns
        self._held = b""
        self._latest_ns = 0

    @property
    def held_bytes(self) -> int:
        """That wait for more."""
        return len(self._held)

    def needs_bytes(self, coming: bytes | bytearray) -> int:
        """No unit is complete before so many more bytes are there.

        Args:
            coming: what comes next, at least a byte of it unless bytes are held already; a start marker may follow it.
        """
        begin = self._held + coming[:RAW_BYTES]
        if begin[0] not in (MAGIC_V1, MAGIC_V2):
            return min([RAW_BYTES, len(begin) + 1, *(place + 1 for place in _magics(begin))]) - len(
                self._held
            )
        if len(begin) < LEAST_TO_JUDGE:
            return LEAST_TO_JUDGE - len(self._held)
        return _frame_bytes(begin) - len(self._held)

    @property
    def gives_up_ns(self) -> int | None:
        """When what is held goes on as it is, unless more comes; None: nothing is held."""
        held = self._held
        if not held:
            return None
        if held[0] in (MAGIC_V1, MAGIC_V2):
            whole = _frame_bytes(held) if len(held) >= LEAST_TO_JUDGE else LEAST_TO_JUDGE
            return self._latest_ns + max(whole * self._byte_ns, PATIENCE_NS)
        return self._latest_ns + PAUSE_BYTES * self._byte_ns

    def feed(self, data: bytes, at_ns: int) -> list[Unit]:
        """Take the bytes that have arrived by an instant; returns what they complete."""
        held, self._latest_ns = self._held + data, at_ns
        units: list[Unit] = []
        while held:
            cut = _cut(held)
            if cut is None:
                break
            units.append(cut)
            held = held[len(cut.data) :]
        self._held = held
        return units

    def give_up(self) -> list[Unit]:
        """What is held goes on as it is."""
        held, self._held = self._held, b""
        return [Unit(held)] if held else []


def _cut(held: bytes) -> Unit | None:
    """The unit that begins here, if it is complete."""
    if held[0] not in (MAGIC_V1, MAGIC_V2):
        ends = _magics(held)
        end = min([*ends, RAW_BYTES])
        return Unit(held[:end]) if ends or len(held) >= RAW_BYTES else None
    if len(held) < LEAST_TO_JUDGE or len(held) < (end := _frame_bytes(held)):
        return None
    data = held[:end]
    is_v2 = data[0] == MAGIC_V2
    names_it = data[7:10] == b"\0\0\0" if is_v2 else data[5] == 0
    is_right_long = data[1] <= HEARTBEAT_BYTES if is_v2 else data[1] == HEARTBEAT_BYTES
    return Unit(data, 2 if is_v2 else 1, names_it and is_right_long)


class WholeFrames:
    """What several hosts send on one line, so that no frame is cut by another's.

    A frame that begins while others may send waits here for its end; of a host that goes before that it is lost.
    """

    __slots__ = ("_begun",)

    def __init__(self) -> None:
        self._begun: WeakKeyDictionary[object, bytes] = WeakKeyDictionary()

    def came(self, data: bytes, host: object, *, is_alone: bool) -> bytes:
        """Take what a host sends; returns what may go on: all of it, if nobody else is there."""
        data = self._begun.pop(host, b"") + data
        count = len(data) if is_alone else _whole_bytes(data)
        if count < len(data):
            self._begun[host] = data[count:]
        return data[:count]


def _whole_bytes(data: bytes) -> int:
    """How many bytes come before a frame whose end is not among them."""
    place = 0
    while place < len(data):
        cut = _cut(data[place : place + LONGEST_FRAME_BYTES])
        if cut is None:
            return place if data[place] in (MAGIC_V1, MAGIC_V2) else len(data)
        place += len(cut.data)
    return place


def unit_bytes(data: bytes) -> int:
    """How long the unit is with which bytes begin; all of them, if its end is not among them."""
    cut = _cut(data) if data else None
    return len(data) if cut is None else len(cut.data)


def _magics(data: bytes) -> list[int]:
    """Where each start marker is met first."""
    return [place for magic in (MAGIC_V1, MAGIC_V2) if (place := data.find(magic)) >= 0]


def _frame_bytes(held: bytes) -> int:
    """How long the frame is that begins here."""
    if held[0] == MAGIC_V1:
        return AROUND_V1_BYTES + held[1]
    return AROUND_V2_BYTES + held[1] + (SIGNATURE_BYTES if held[2] & 1 else 0)
