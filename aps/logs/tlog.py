"""Writes .tlog files, as MAVProxy, Mission Planner and pymavlink read them.

Each record is the time, 8 bytes, big-endian, in us since 1970, and one whole MAVLink frame, but for
signatures, and messages that bring a key. Every frame goes to the
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

__all__ = ["TlogCounters", "TlogWriter"]

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
        self._file: BinaryIO | None = None
        self._file_bytes = 0
        self._told = False

    def write(self, raw: bytes) -> None:
        """Write one frame, as a log may have it (`loggable`). A disk that refuses is told once, and tried again."""
        told = loggable(raw)
        if told is None:
            return
        raw = told
        now_us = self._clock_us()
        try:
            self._append(_TIME.pack(now_us) + raw, now_us)
        except OSError as error:
            self.counters.lost_frames += 1
            if not self._told:
                _log.warning("cannot write the tlog in %s: %s", self._directory, error)
            self._told = True
            return
        self._told = False
        self.counters.frames += 1
        self.counters.bytes += _TIME.size + len(raw)

    def _append(self, record: bytes, now_us: int) -> None:
        """Write a whole record or nothing of it.

        Raises:
            OSError: the disk refuses.
        """
        if self._file is None or self._file_bytes + len(record) > self._max_file_bytes:
            self._next_file(now_us)
        assert self._file is not None
        if self._file.write(record) < len(record):  # a disk that has just become full takes a part
            self._file.truncate(self._file_bytes)
            self._file.seek(self._file_bytes)
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        self._file_bytes += len(record)

    def _next_file(self, now_us: int) -> None:
        self.close()
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
        """Close the file; a further frame begins another."""
        if self._file is not None:
            self._file.close()
        self._file = None
