"""Starts a program in a namespace of its own, and ends it with all that it has started."""

from __future__ import annotations

import ctypes
import json
import os
import socket
import subprocess
import sys
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Final, Self

import psutil

from lostlink.attach import namespace
from lostlink.attach.namespace import InterfaceSettings

PR_SET_CHILD_SUBREAPER: Final = 36
GRACE_S: Final = 5.0
"""What was asked to end is killed after so long, wall time."""
REST_GRACE_S: Final = 1.0
"""The same for what a program leaves behind."""
MESSAGE_MAX: Final = 4096
SIGNALLED: Final = 128
"""And the number of the signal: exit code of a program that was ended by it."""


class NoProgram(Exception):
    """The namespace could not be made; the text says why."""


class AttachedProgram:
    """A program in its namespace, from `prepare` to `close`.

    Args:
        process: which waits in its namespace, or has become the program.
        tun: the other side of its interface.
        remark: what did not go well; "" if nothing.
        gate: the socket through which it is told to go on.
    """

    def __init__(self, process: subprocess.Popen[bytes], tun: int, remark: str, gate: socket.socket) -> None:
        self._process, self.tun, self.remark, self._gate = process, tun, remark, gate
        os.set_blocking(tun, False)
        self.pidfd = os.pidfd_open(process.pid)
        """Readable when it has ended."""

    @classmethod
    def prepare(
        cls, interface: str, address: str, netmask: str, mtu_bytes: int, hosts: str, command: Sequence[str]
    ) -> Self:
        """Make the namespace; the program waits in it for `go`.

        What it starts and leaves behind becomes a child of this process.

        Raises:
            NoProgram: the namespace cannot be made.
        """
        ctypes.CDLL(None).prctl(PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0)
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        settings = InterfaceSettings(
            theirs.fileno(), os.getpid(), interface, address, netmask, mtu_bytes, hosts
        )
        words = [sys.executable, "-I", str(Path(namespace.__file__)), json.dumps(settings._asdict())]
        with theirs:
            process = subprocess.Popen([*words, *command], pass_fds=[theirs.fileno()])
        message, tuns, _, _ = socket.recv_fds(ours, MESSAGE_MAX, 1)
        text = message.decode(errors="replace").strip("\0")
        if not tuns:
            ours.close()
            process.wait()
            raise NoProgram(text or "the namespace could not be made")
        return cls(process, tuns[0], text, ours)

    def go(self) -> None:
        """Let the program begin."""
        with suppress(BrokenPipeError, ConnectionResetError):  # it has ended already
            self._gate.send(b"g")

    def signal(self, number: int) -> None:
        """Send the program a signal, if it is still there."""
        if self._process.poll() is None:
            self._process.send_signal(number)

    def end(self) -> None:
        """Ask the program and all that it has started to end."""
        for each in _descendants():
            with suppress(psutil.NoSuchProcess):
                each.terminate()

    def kill(self) -> None:
        """End them."""
        for each in _descendants():
            with suppress(psutil.NoSuchProcess):
                each.kill()

    def close(self) -> int:
        """End what is left of it; returns its exit code as a shell has it (128 and the signal that ended it)."""
        self._gate.close()
        if self._process.poll() is None:
            self.kill()
        status = self._process.wait()
        self.end()
        psutil.wait_procs(_descendants(), timeout=REST_GRACE_S)
        self.kill()
        psutil.wait_procs(_descendants(), timeout=REST_GRACE_S)
        os.close(self.pidfd)
        os.close(self.tun)
        return status if status >= 0 else SIGNALLED - status


def _descendants() -> list[psutil.Process]:
    found = psutil.Process().children(recursive=True)
    return [each for each in found if each.is_running() and each.status() != psutil.STATUS_ZOMBIE]
