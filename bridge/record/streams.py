"""Stream files: what happened at each tick, as entries of a tick and bytes.

A file begins with ``LLSTREAM`` and a uint32 version. Each entry is an int64 tick (sim time in ns), a uint32 length
and so many bytes; all numbers are little-endian. Ticks never go back; several entries may have the same tick.

While a run goes on the files are as written; when it is over `pack_stream` makes each a quarter as large. Whoever reads
names the file as it was written, and gets either.
"""

from __future__ import annotations

import io
import struct
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Final, NamedTuple, Self, TypeVar

from bridge.record.appending import append_units
from bridge.run.whole_file import whole_file

if TYPE_CHECKING:
    from _typeshed import WriteableBuffer

MAGIC: Final = b"LLSTREAM"
VERSION: Final = 2
"""2: a packet has its encoding."""
PAYLOAD_MAX_BYTES: Final = 1 << 24
BUFFER_BYTES: Final = 1 << 16
TICK_MAX_NS: Final = (1 << 63) - 1
_START: Final = MAGIC + struct.pack("<I", VERSION)
_HEAD: Final = struct.Struct("<qI")
START_BYTES: Final = len(_START)
ENTRY_HEAD_BYTES: Final = _HEAD.size
"""Before the payload of each entry."""


PACKED: Final = ".zst"
"""Added to the name of a packed file."""
PACK_LEVEL: Final = 3


T = TypeVar("T")


class StreamError(ValueError):
    """A stream file is damaged; the text has the file and the offset in bytes."""


class Entry(NamedTuple):
    """What happened at one tick."""

    tick_ns: int
    payload: bytes


class StreamWriter:
    """Appends entries to a new file. Not for several threads at once.

    Raises:
        OSError: the file cannot be made or written.
    """

    def __init__(self, path: Path) -> None:
        path.parent.mkdir(parents=True, exist_ok=True)
        self._path = path
        self._raw = io.FileIO(path, "w")
        self._file = io.BufferedWriter(self._raw, BUFFER_BYTES)
        self._append = self._file.write
        self._append(_START)
        self._tick_ns = 0

    def write(self, tick_ns: int, payload: bytes) -> None:
        """Append an entry; it is on disk after `flush` or `close`.

        Raises:
            ValueError: the tick is before that of the last entry, or the payload is longer than 16 MiB.
        """
        if not self._tick_ns <= tick_ns <= TICK_MAX_NS:
            raise ValueError(f"{self._path}: tick {tick_ns} ns comes after {self._tick_ns} ns")
        if len(payload) > PAYLOAD_MAX_BYTES:
            raise ValueError(f"{self._path}: {len(payload)} bytes; up to {PAYLOAD_MAX_BYTES} are allowed")
        self._tick_ns = tick_ns
        entry = _HEAD.pack(tick_ns, len(payload)) + payload
        if len(entry) <= BUFFER_BYTES:  # the buffer takes all of it or, if the disk has no room, nothing
            self._append(entry)
        else:
            self._file.flush()
            append_units(self._raw, entry, len(entry))

    def flush(self) -> None:
        """Hand everything to the operating system, so that it is there if this process is killed."""
        self._file.flush()

    def close(self) -> None:
        """Flush and close; a second call does nothing."""
        self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def packed_path(path: Path) -> Path:
    """The file that has a packed stream."""
    return path.with_name(path.name + PACKED)


def stream_exists(path: Path) -> bool:
    """Whether there is such a stream, packed or not."""
    return path.exists() or packed_path(path).exists()


def pack_stream(path: Path) -> None:
    """Put a file that nobody writes any more in a packed one's place; its content stays the same.

    Raises:
        OSError: it cannot be read, or its place not be written; it stays then.
    """
    import zstandard  # no process of a running simulation needs it

    packing = zstandard.ZstdCompressor(PACK_LEVEL, write_checksum=True)
    with path.open("rb") as source, whole_file(packed_path(path)) as partial, partial.open("wb") as file:
        packing.copy_stream(source, file)
    path.unlink()


def open_stream(path: Path) -> io.BufferedReader:
    """The bytes of a stream file as they were written; if it is packed, it can only seek forward.

    Raises:
        OSError: it cannot be opened.
    """
    if not path.exists() and packed_path(path).exists():
        return io.BufferedReader(_Unpacked(packed_path(path)), BUFFER_BYTES)
    return io.BufferedReader(io.FileIO(path), BUFFER_BYTES)


class _Unpacked(io.RawIOBase):
    """What a packed file holds. Reading it may raise a StreamError."""

    def __init__(self, packed: Path) -> None:
        import zstandard

        self._path, self._damage = packed, zstandard.ZstdError
        self._reader = zstandard.ZstdDecompressor().stream_reader(packed.open("rb"), closefd=True)

    def readable(self) -> bool:
        return True

    def seekable(self) -> bool:
        return True

    def tell(self) -> int:
        return self._reader.tell()

    def seek(self, offset: int, whence: int = io.SEEK_SET) -> int:
        return self._reader.seek(offset, whence)

    def readinto(self, buffer: WriteableBuffer) -> int:
        try:
            return self._reader.readinto(buffer)
        except self._damage as error:
            raise StreamError(f"{self._path}: damaged: {error}") from error

    def close(self) -> None:
        self._reader.close()  # type: ignore[no-untyped-call]
        super().close()


def read_stream(path: Path, *, is_whole: bool = False) -> Iterator[Entry]:
    """The entries of a stream file. A tail that was cut off (its writer was killed) ends it quietly.

    Args:
        path: of the file as it was written.
        is_whole: its writer closed it: a tail that was cut off is damage.

    Raises:
        StreamError: the file is damaged.
        OSError: it cannot be read.
    """
    with open_stream(path) as file:
        if not _has_start(path, file.read(len(_START))):
            if is_whole:
                raise StreamError(f"{path}: offset 0: damaged: it is cut off in its beginning")
            return
        offset, before_ns = len(_START), 0
        while len(head := file.read(_HEAD.size)) == _HEAD.size:
            tick_ns, length = _checked_head(path, offset, head, before_ns)
            payload = file.read(length)
            if len(payload) < length:
                break
            yield Entry(tick_ns, payload)
            offset, before_ns = offset + _HEAD.size + length, tick_ns
        if head and is_whole:
            raise StreamError(f"{path}: offset {offset}: damaged: it is cut off within an entry")


class StreamFollower:
    """Reads a stream file that may still be written: each `read` goes on where the one before ended.

    A file that is packed meanwhile stays open as it was.

    Args:
        path: of the file as it was written; it need not be there yet.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._file: io.BufferedReader | None = None
        self._waiting = b""
        self._offset, self._before_ns = 0, 0

    def read(self, most_bytes: int) -> list[Entry] | None:
        """The whole entries of up to so many further bytes; None if there are no further ones yet.

        Raises:
            StreamError: the file is damaged.
            OSError: it cannot be read.
        """
        if self._file is None:
            if not stream_exists(self._path):
                return None
            self._file = open_stream(self._path)
        more = self._file.read(most_bytes)
        self._waiting += more
        return self._take() if more else None

    def _take(self) -> list[Entry]:
        data, at, entries = self._waiting, 0, []
        if not self._offset:
            if not _has_start(self._path, data[:START_BYTES]):
                return []
            at = START_BYTES
        while len(data) - at >= ENTRY_HEAD_BYTES:
            head = data[at : at + ENTRY_HEAD_BYTES]
            tick_ns, length = _checked_head(self._path, self._offset + at, head, self._before_ns)
            end = at + ENTRY_HEAD_BYTES + length
            if end > len(data):
                break
            entries.append(Entry(tick_ns, data[at + ENTRY_HEAD_BYTES : end]))
            at, self._before_ns = end, tick_ns
        self._waiting, self._offset = data[at:], self._offset + at
        return entries

    def close(self) -> None:
        """Close the file."""
        if self._file is not None:
            self._file.close()


def _checked_head(path: Path, offset: int, head: bytes, before_ns: int) -> tuple[int, int]:
    """Tick and length of an entry, or StreamError."""
    tick_ns, length = _HEAD.unpack(head)
    if tick_ns < before_ns:
        raise StreamError(f"{path}: offset {offset}: tick {tick_ns} ns comes after {before_ns} ns")
    if length > PAYLOAD_MAX_BYTES:
        raise StreamError(
            f"{path}: offset {offset}: an entry of {length} bytes; up to {PAYLOAD_MAX_BYTES} are allowed"
        )
    return tick_ns, length


def entries_of(path: Path) -> Iterator[Entry]:
    """As `read_stream`; no entries if there is no such stream."""
    return read_stream(path) if stream_exists(path) else iter(())


def decoded(path: Path, decode: Callable[[bytes], T]) -> Iterator[tuple[int, T]]:
    """The tick of each entry, and what its payload holds; none if there is no such stream.

    Raises:
        StreamError: the file is damaged, or an entry is not what ``decode`` takes.
        OSError: it cannot be read.
    """
    for tick_ns, payload in entries_of(path):
        try:
            item = decode(payload)
        except ValueError as error:
            raise StreamError(f"{path}: at {tick_ns} ns: {error}") from error
        yield tick_ns, item


def _has_start(path: Path, start: bytes) -> bool:
    """Whether the file begins as it should; False if it was cut off within its beginning."""
    if start == _START:
        return True
    if _START.startswith(start):
        return False
    if start.startswith(MAGIC) and len(start) == len(_START):
        version = int.from_bytes(start[len(MAGIC) :], "little")
        raise StreamError(
            f"{path}: offset {len(MAGIC)}: version {version}; this lostlink reads version {VERSION}"
        )
    raise StreamError(f"{path}: offset 0: not a stream file (it does not begin with {MAGIC.decode()})")
