"""What a process of a run reports to its supervisor without Zenoh: samples through a pipe, each with its key.

A sample is a little-endian uint16 length of the key, a uint32 length of the payload, the key and the payload.
"""

from __future__ import annotations

import os
import struct
import threading
from collections.abc import Iterator

from bridge.bus.messages import Message, encode

_HEAD = struct.Struct("<HI")


class PipeWriter:
    """Writes samples; any thread may.

    Args:
        fd: the pipe's end for writing; this object's from now on.
    """

    def __init__(self, fd: int) -> None:
        self._fd = fd
        self._lock = threading.Lock()
        self._broken = False

    def put(self, key: str, message: Message) -> None:
        """Write one; nothing happens if nobody listens any more."""
        name, payload = key.encode(), encode(message)
        view = memoryview(_HEAD.pack(len(name), len(payload)) + name + payload)
        with self._lock:
            while view and not self._broken:
                try:
                    view = view[os.write(self._fd, view) :]
                except BrokenPipeError:
                    self._broken = True

    def close(self) -> None:
        """Close the pipe's end."""
        with self._lock:
            self._broken = True
            os.close(self._fd)


class PipeReader:
    """Takes bytes of a pipe, gives samples. No I/O."""

    def __init__(self) -> None:
        self._kept = b""

    def receive(self, data: bytes) -> Iterator[tuple[str, bytes]]:
        """The samples that are complete with ``data``: key and payload."""
        self._kept += data
        while len(self._kept) >= _HEAD.size:
            name, payload = _HEAD.unpack_from(self._kept)
            end = _HEAD.size + name + payload
            if len(self._kept) < end:
                return
            sample, self._kept = self._kept[_HEAD.size : end], self._kept[end:]
            yield sample[:name].decode(), sample[name:]
