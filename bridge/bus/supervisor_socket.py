"""What a process of a run reports to its supervisor without Zenoh: samples through a socket, each with its key.

One byte of the supervisor's tells it to go.

A sample is a little-endian uint16 length of the key, a uint32 length of the payload, the key and the payload.
"""

from __future__ import annotations

import asyncio
import os
import struct
import threading
from collections.abc import Iterator
from typing import Final

from bridge.bus.messages import Message, encode

GO: Final = b"\n"
_HEAD = struct.Struct("<HI")


class SupervisorSocket:
    """Writes samples; any thread may.

    Args:
        fd: the process's end.
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
                except ConnectionError:
                    self._broken = True

    async def told_to_go(self) -> bool:
        """Wait until the supervisor says go, or is gone; whether it has said so."""
        loop, told = asyncio.get_running_loop(), asyncio.Event()
        loop.add_reader(self._fd, told.set)
        try:
            await told.wait()
        finally:
            loop.remove_reader(self._fd)
        try:
            return os.read(self._fd, len(GO)) == GO
        except ConnectionError:
            return False


class SampleReader:
    """Takes the bytes of a process, gives samples. No I/O."""

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
