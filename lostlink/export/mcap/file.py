"""The file itself: topics by name, limits of rate and size, and what was left out for them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from contextlib import ExitStack, suppress
from pathlib import Path
from types import TracebackType
from typing import Any, BinaryIO, Final, Self

from mcap.writer import CompressionType, Writer

from bridge.run.whole_file import whole_file
from bridge.scenario.mcap import McapSettings
from lostlink.export.mcap.definitions import ENCODING, Schemas

PROFILE: Final = "ros2"
CHUNK_BYTES: Final = 1 << 20
_COMPRESSION: Final = {
    "zstd": CompressionType.ZSTD,
    "lz4": CompressionType.LZ4,
    "none": CompressionType.NONE,
}
_QOS: Final = {"offered_qos_profiles": ""}


class McapFile:
    """Writes one file; it is there, whole, when the block is left without an error, and else nothing of it is.

    Args:
        path: of the file.
        settings: what is to be in it.

    Raises:
        OSError: it cannot be written.
    """

    def __init__(self, path: Path, settings: McapSettings) -> None:
        self.settings = settings
        self.schemas = Schemas()
        self.left_out: Counter[str] = Counter()
        """Messages by topic that were longer than allowed."""
        self.counts: Counter[str] = Counter()
        """Messages by topic."""
        with ExitStack() as stack:
            self._file: BinaryIO = stack.enter_context(stack.enter_context(whole_file(path)).open("wb"))
            self._whole = stack.pop_all()
        self._writer: Any = Writer(self._file, CHUNK_BYTES, _COMPRESSION[settings.compression])
        self._writer.start(PROFILE, "lostlink")
        self._schema_ids: dict[str, int] = {}
        self._channels: dict[str, Channel] = {}

    def channel(self, topic: str, type_name: str, kind: str) -> Channel:
        """The topic of that name, which is there from the first time on."""
        found = self._channels.get(topic)
        if found is None:
            if type_name not in self._schema_ids:
                data = self.schemas.schema_of(type_name)
                self._schema_ids[type_name] = self._writer.register_schema(type_name, ENCODING, data)
            number = self._writer.register_channel(topic, "cdr", self._schema_ids[type_name], _QOS)
            found = Channel(self, self._writer, number, topic, kind)
            self._channels[topic] = found
        return found

    def add_metadata(self, name: str, values: Mapping[str, str]) -> None:
        """Keep texts that are no messages."""
        self._writer.add_metadata(name, dict(values))

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None
    ) -> None:
        if kind is None:
            with self._whole:
                self._writer.finish()
        else:
            with suppress(OSError):  # of what is still to be written
                self._whole.__exit__(kind, error, at)


class Channel:
    """One topic."""

    def __init__(self, file: McapFile, writer: Any, number: int, topic: str, kind: str) -> None:
        self._file, self._add, self._number, self._topic = file, writer.add_message, number, topic
        rate_hz = file.settings.rate_hz(kind)
        self._period_ns = round(1e9 / rate_hz) if rate_hz else 0
        self._size = file.settings.size_bytes(kind)
        self._period = -1

    def is_due(self, time_ns: int) -> bool:
        """Whether a message of this instant is written: the first of each period is. Asked once per message."""
        if self._period_ns:
            period = time_ns // self._period_ns
            if period == self._period:
                return False
            self._period = period
        return True

    def write(self, time_ns: int, data: bytes) -> None:
        """Write a message, unless it is too long."""
        if self._size is not None and len(data) > self._size:
            self._file.left_out[self._topic] += 1
            return
        self._add(self._number, time_ns, data, time_ns, self._file.counts[self._topic])
        self._file.counts[self._topic] += 1
