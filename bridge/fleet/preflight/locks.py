"""Locks by name that all users of a machine see.

The kernel lets each go with its holder, however that ends. On Linux a lock is an abstract Unix socket: it needs no
folder, and is seen where the machine's ports are, also from containers that share its network. Elsewhere it is a file.
"""

from __future__ import annotations

import errno
import fcntl
import os
import socket
import sys
from contextlib import ExitStack, suppress
from pathlib import Path

FOLDER = Path("/tmp")
"""Of lock files: one that all users share, whatever their TMPDIR."""


def hold(name: str, held: ExitStack) -> bool:
    """Lock a name until ``held`` is closed.

    Args:
        name: of a few letters, digits and ``-``.
        held: what is closed at the end.

    Returns:
        Whether it could be locked; False if somebody has it.

    Raises:
        OSError: there are no more file descriptors, say.
    """
    return _hold_socket(name, held) if sys.platform == "linux" else hold_file(name, held)


def _hold_socket(name: str, held: ExitStack) -> bool:
    with ExitStack() as trial:
        lock = trial.enter_context(socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM))
        try:
            lock.bind(f"\0{name}")
        except OSError as error:
            if error.errno != errno.EADDRINUSE:
                raise
            return False
        held.push(trial.pop_all())
    return True


def hold_file(name: str, held: ExitStack) -> bool:
    """As `hold`, with a file in `FOLDER`, which stays; one that another user does not let others read is taken."""
    with ExitStack() as trial:
        try:
            flags = os.O_RDONLY | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW
            fd = os.open(FOLDER / f"{name}.lock", flags, 0o644)
            trial.callback(os.close, fd)
            with suppress(PermissionError):  # another user's, who has done so
                os.fchmod(fd, 0o644)  # whatever our umask is
            fcntl.flock(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except (BlockingIOError, PermissionError):
            return False
        held.push(trial.pop_all())
    return True
