"""Writes .tlog files, as MAVProxy, Mission Planner and pymavlink read them.

Each record is the time, 8 bytes, big-endian, in us since 1970, and one whole MAVLink frame, but for
signatures, and messages that bring a key. Unless the writer gathers frames, each goes to the
operating system at once, so a daemon that is killed loses none; files are bounded in size and number.
"""

from __future__ import annotations

import errno
import logging
import os
import struct
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import BinaryIO, Final

from aps.wire.signing import loggable

DEFAULT_MAX_FILE_BYTES: Final = 100_000_000
"""Some eight hours of a busy UA."""
DEFAULT_MAX_FILES: Final = 20
_TIME: Final = struct.Struct(">Q")

_log = logging.getLogger(__name__)


@dataclass(slots=True)
class TlogCounters:
    """What was written."""

    frames: int = 0
    bytes: int = 0
    files: int = 0
    deleted_files: int = 0
    lost_frames: int = 0
    """Not written, since the disk refused."""


class TlogWriter:
    """One vehicle's log.

    Args:
        directory: where the files go; it is made.
        name: beginning of the files' names; the time of the first frame and, if need be, a number follow.
        clock_us: us since 1970 for a frame that is written now.
        max_file_bytes: a new file is begun when this is reached.
        max_files: the oldest of this writer's files is deleted when there are more.
        gather_bytes: frames wait until there is as much of them, or for `flush`; 0 = none waits.

    Raises:
        OSError: the directory cannot be made.
    """

    def __init__(
        self,
        directory: Path,
        name: str,
        clock_us: Callable[[], int],
        max_file_bytes: int = DEFAULT_MAX_FILE_BYTES,
        max_files: int = DEFAULT_MAX_FILES,
        gather_bytes: int = 0,
    ) -> None:
        if max_file_bytes < 1000 or max_files < 1:
            raise ValueError(
                f"a tlog has at least one file of 1000 bytes, not {max_files} of {max_file_bytes}"
            )
        directory.mkdir(parents=True, exist_ok=True)
        self.counters = TlogCounters()
        self.paths: list[Path] = []
        """The files that there are, oldest first."""
        self._directory, self._name, self._clock_us = directory, name, clock_us
        self._max_file_bytes, self._max_files = max_file_bytes, max_files
        self._gather_bytes = gather_bytes
        self._gathered: list[bytes] = []
        self._gathered_bytes = self._gathered_from_us = 0
        self._file: BinaryIO | None = None
        self._file_bytes = 0
        self._told = False

    def write(self, raw: bytes) -> None:
        """Write one frame, as a log may have it (`loggable`). A disk that refuses is told once, and tried again."""
        told = loggable(raw)
        if told is None:
            return
        now_us = self._clock_us()
        record = _TIME.pack(now_us) + told
        if self._file_bytes + self._gathered_bytes + len(record) > self._max_file_bytes:
            self.close()
        if not self._gathered:
            self._gathered_from_us = now_us
        self._gathered.append(record)
        self._gathered_bytes += len(record)
        if self._gathered_bytes >= self._gather_bytes:
            self.flush()

    def flush(self) -> None:
        """Hand what was gathered to the operating system."""
        if not self._gathered:
            return
        records, self._gathered, self._gathered_bytes = self._gathered, [], 0
        data = b"".join(records)
        try:
            self._append(data)
        except OSError as error:
            self.counters.lost_frames += len(records)
            if not self._told:
                _log.warning("cannot write the tlog in %s: %s", self._directory, error)
            self._told = True
            return
        self._told = False
        self.counters.frames += len(records)
        self.counters.bytes += len(data)

    def _append(self, data: bytes) -> None:
        """Write whole records or nothing of them.

        Raises:
            OSError: the disk refuses.
        """
        if self._file is None:
            self._next_file(self._gathered_from_us)
        assert self._file is not None
        if self._file.write(data) < len(data):  # a disk that has just become full takes a part
            self._file.truncate(self._file_bytes)
            self._file.seek(self._file_bytes)
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        self._file_bytes += len(data)

    def _next_file(self, now_us: int) -> None:
        stem = f"{self._name}-{datetime.fromtimestamp(now_us / 1e6, UTC):%Y%m%dT%H%M%SZ}"
        for suffix in ("", *(f"-{number}" for number in range(2, 10_000))):
            path = self._directory / f"{stem}{suffix}.tlog"
            try:
                self._file = path.open("xb", buffering=0)
            except FileExistsError:
                continue
            break
        else:
            raise FileExistsError(f"{stem}: there are too many files of that name")
        self._file_bytes = 0
        self.paths.append(path)
        self.counters.files += 1
        while len(self.paths) > self._max_files:
            self.paths.pop(0).unlink(missing_ok=True)
            self.counters.deleted_files += 1

    def close(self) -> None:
        """Write what was gathered and close the file; a further frame begins another."""
        self.flush()
        if self._file is not None:
            self._file.close()
        self._file, self._file_bytes = None, 0
