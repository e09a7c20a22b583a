"""Starts a program in a namespace of its own, and ends it with all that it has started."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Final, Self

from bridge.host.node import ENTERING_MAX
from lostlink.attach import namespace
from lostlink.attach.namespace import SIGNALLED, InterfaceSettings

GRACE_S: Final = 5.0
"""What was asked to end is killed after so long, wall time."""
MESSAGE_MAX: Final = 4096


class NoProgram(Exception):
    """The namespace could not be made; the text says why."""


class AttachedProgram:
    """A program in its namespace, from `prepare` to `close`.

    Args:
        process: which ends with all that is in the namespace, and has the program's exit code.
        files: the other side of its interface, and the pidfds of the namespace's init and of the program.
        remark: what did not go well; "" if nothing.
        gate: the socket through which it is told to go on.

    Attributes:
        tun: the first of the files.
        pidfd: readable when all have ended.
        unread_packets: that the interface dropped, since they were not read in time; known once it is closed.
    """

    def __init__(
        self, process: subprocess.Popen[bytes], files: Sequence[int], remark: str, gate: socket.socket
    ) -> None:
        self.tun, self._init, self._program = files
        self._process, self.remark, self._gate = process, remark, gate
        self.unread_packets = 0
        os.set_blocking(self.tun, False)
        self.pidfd = os.pidfd_open(process.pid)

    @classmethod
    def prepare(
        cls, interface: str, address: str, netmask: str, mtu_bytes: int, hosts: str, command: Sequence[str]
    ) -> Self:
        """Make the namespace; the program waits in it for `go`.

        Raises:
            NoProgram: the namespace cannot be made.
        """
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        settings = InterfaceSettings(
            theirs.fileno(), interface, address, netmask, mtu_bytes, ENTERING_MAX, hosts
        )
        words = [sys.executable, "-I", str(Path(namespace.__file__)), json.dumps(settings._asdict())]
        with theirs:
            process = subprocess.Popen([*words, *command], pass_fds=[theirs.fileno()])
        message, files, _, _ = socket.recv_fds(ours, MESSAGE_MAX, 3)
        text = message.decode(errors="replace").strip("\0")
        if not files:
            ours.close()
            process.wait()
            raise NoProgram(text or "the namespace could not be made")
        return cls(process, files, text, ours)

    def go(self) -> None:
        """Let the program begin."""
        with suppress(BrokenPipeError, ConnectionResetError):  # it has ended already
            self._gate.send(b"g")

    def signal(self, number: int) -> None:
        """Send the program a signal, if it is still there."""
        _send(self._program, number)

    def end(self) -> None:
        """Ask the program and all that it has started to end."""
        _send(self._init, signal.SIGTERM)

    def kill(self) -> None:
        """End them."""
        _send(self._init, signal.SIGKILL)

    def close(self) -> int:
        """End what is left of it; returns its exit code as a shell has it (128 and the signal that ended it)."""
        self.kill()
        status = self._process.wait()
        with self._gate, suppress(OSError):  # if it was killed it has said nothing
            self.unread_packets = int(self._gate.recv(MESSAGE_MAX) or 0)
        for each in (self.tun, self._init, self._program, self.pidfd):
            os.close(each)
        return status if status >= 0 else SIGNALLED - status


def _send(pidfd: int, number: int) -> None:
    with suppress(ProcessLookupError):  # it has ended
        signal.pidfd_send_signal(pidfd, number)
