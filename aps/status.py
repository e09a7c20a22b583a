"""What a running daemon is doing: it answers on a socket of its own, and ``lostlink aps status`` asks.

The sockets lie in a directory that only their user can enter. Whoever connects is sent one line of JSON.
"""

from __future__ import annotations

import asyncio
import contextlib
import errno
import fcntl
import json
import logging
import math
import os
import socket
import stat
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import asdict
from functools import cache
from pathlib import Path
from typing import Any, Final

from aps.vehicle.telemetry import VehicleState

SUFFIX: Final = ".sock"
_log = logging.getLogger(__name__)


def status_directory() -> Path:
    """Where the sockets of this user's daemons are; it is made if need be.

    Raises:
        OSError: it cannot be made, or belongs to somebody else.
    """
    parent = os.environ.get("XDG_RUNTIME_DIR") or tempfile.gettempdir()
    path = Path(parent) / f"lostlink-aps-{os.getuid()}"
    path.mkdir(mode=0o700, exist_ok=True)
    found = path.lstat()
    if not stat.S_ISDIR(found.st_mode) or found.st_uid != os.getuid() or found.st_mode & 0o077:
        raise PermissionError(f"{path} is not a directory of yours alone")
    return path


def remove_stale(directory: Path) -> None:
    """Remove the sockets of daemons that are no more, as of those that were killed.

    Raises:
        OSError: the directory cannot be read.
    """
    with _alone_in(directory):
        for path in directory.glob(f"*{SUFFIX}"):
            if path.is_socket() and _is_stale(path):
                path.unlink(missing_ok=True)


_removed_stale = cache(remove_stale)
"""Once per process: a fleet's daemons need not look at each other's."""


@contextlib.contextmanager
def _alone_in(directory: Path) -> Iterator[None]:
    """Keep others from binding or removing sockets there: a stale one may be somebody's before it is removed."""
    held = os.open(directory, os.O_RDONLY)
    try:
        fcntl.flock(held, fcntl.LOCK_EX)
        yield
    finally:
        os.close(held)


def _is_stale(path: Path) -> bool:
    """Whether no process has a socket. It is asked for datagrams, of which whoever has it does not learn."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as asking:
        try:
            asking.connect(str(path))
        except OSError as error:
            return error.errno == errno.ECONNREFUSED
    return False


class StatusServer:
    """Answers with what a daemon says of itself. One that cannot be opened is logged: the daemon flies without.

    Args:
        name: of the daemon, unique on the machine: its port.
        told: what to answer, as plain data.
    """

    def __init__(self, name: str, told: Callable[[], dict[str, Any]]) -> None:
        self._name, self._told = name, told
        self._server: asyncio.Server | None = None
        self._path: Path | None = None

    async def start(self) -> None:
        """Begin to answer."""
        try:
            self._server = await asyncio.start_unix_server(self._answer, sock=self._bound())
        except OSError as error:
            _log.warning("no status for lostlink aps status: %s", error)

    def _bound(self) -> socket.socket:
        directory = status_directory()
        _removed_stale(directory)
        path = directory / f"{self._name}{SUFFIX}"
        bound = socket.socket(socket.AF_UNIX)
        try:
            with _alone_in(directory):
                path.unlink(missing_ok=True)
                bound.bind(str(path))
        except OSError:
            bound.close()
            raise
        self._path = path
        return bound

    async def _answer(self, _: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        with contextlib.suppress(OSError):
            writer.write(json.dumps(self._told()).encode() + b"\n")
            await writer.drain()
        writer.close()

    def close(self) -> None:
        """Answer no more."""
        if self._server is not None:
            self._server.close()
        if self._path is not None:
            self._path.unlink(missing_ok=True)


def plain_state(state: VehicleState) -> dict[str, Any]:
    """The state as plain data; what is not known is ``None``."""
    values = asdict(state) | {"wind_body_mps": state.wind_body_mps}
    for inner in ("as_of_ns", "heard_ns"):
        del values[inner]
    return {name: _plain(value) for name, value in values.items()}


def _plain(value: Any) -> Any:
    if isinstance(value, tuple):
        return [_plain(item) for item in value]
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value
