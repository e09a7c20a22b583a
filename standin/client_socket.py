"""A MAVLink port of an autopilot as a TCP server.

As ArduPilot's SERIAL0, it has one client: a second one connects (the kernel completes it) and gets nothing until the
first is gone; then it is served. A client that does not read holds the simulation back, until it is given up.
"""

from __future__ import annotations

import contextlib
import socket
import struct
from collections import Counter
from typing import Any

from standin.protocols.endpoint import MavlinkEndpoint
from standin.waiter import TELLS_ARRIVALS, Waiter

DEAF_MAX_S = 10.0
"""How long a client that takes nothing holds the simulation back."""
SEND_BUFFER_BYTES = 256 * 1024
"""What the kernel holds for a client that does not read just now: more than some ticks of telemetry."""
READ_MAX_BYTES = 65536
"""Of the client's bytes in one frame; what is more waits for the next."""
BACKLOG = 5


class PortTakenError(OSError):
    """A port that the autopilot needs cannot be bound."""


class ClientSocket:
    """One port.

    Args:
        mavlink: what speaks there.
        address: host and TCP port to listen on; port 0 takes any free one.
        errors: where survived errors are counted.

    Raises:
        PortTakenError: the port cannot be bound.
    """

    def __init__(self, mavlink: MavlinkEndpoint, address: tuple[str, int], errors: Counter[str]) -> None:
        self._mavlink, self._errors = mavlink, errors
        self._client_spoke = True
        self._listener = _listen(address)
        self._client: socket.socket | None = None

    @property
    def port(self) -> int:
        """The TCP port listened on."""
        return int(self._listener.getsockname()[1])

    def join(self, waiter: Waiter[Any]) -> None:
        """Have ``waiter`` wait for it."""
        self._waiter = waiter
        waiter.add_client(self._listener, self._hear_client)

    def read(self) -> None:
        """Take what the client has sent, or the client that waits and what it has sent."""
        if not self._client_spoke:
            return
        client = self._client or self._accept()
        if client is None:
            return
        try:
            data = client.recv(READ_MAX_BYTES, socket.MSG_DONTWAIT)
        except BlockingIOError:  # only now nothing is left, and the next arrival wakes
            self._client_spoke = not TELLS_ARRIVALS
            return
        except OSError:
            data = b""
        if data:
            self._mavlink.receive(data)
        else:
            self._release_client("client_gone")

    def write(self) -> None:
        """Send the client all that is for it: one that is slow to read holds the simulation back."""
        if not self._mavlink.has_data:
            return
        data = self._mavlink.data_to_send()
        if self._client is None:
            return
        try:
            self._client.sendall(data)
        except BlockingIOError:
            self._release_client("client_deaf")
        except OSError:
            self._release_client("client_gone")

    def shut_down(self) -> None:
        """End whatever waits on it, at once; callable from a signal handler or another thread."""
        if self._client is not None:
            with contextlib.suppress(OSError):
                self._client.shutdown(socket.SHUT_RDWR)

    def close(self) -> None:
        """Close the sockets."""
        self._listener.close()
        if self._client is not None:
            self._client.close()

    def _hear_client(self) -> None:
        """The client, or one that wants to be it, has sent something."""
        self._client_spoke = True

    def _accept(self) -> socket.socket | None:
        try:
            client, _ = self._listener.accept()
        except BlockingIOError:
            self._client_spoke = not TELLS_ARRIVALS
            return None
        except OSError:  # gone before it was accepted
            self._errors["accept"] += 1
            return None
        client.settimeout(None)
        client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        client.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER_BYTES)
        client.setsockopt(socket.SOL_SOCKET, socket.SO_SNDTIMEO, _timeval(DEAF_MAX_S))
        self._client = client
        self._waiter.add_client(client, self._hear_client)
        self._mavlink.connect()
        return client

    def _release_client(self, reason: str) -> None:
        """Let the client go; one that waits is served from the next frame on."""
        if self._client is None:
            return
        self._errors[reason] += 1
        self._waiter.remove_client(self._client)
        self._client.close()
        self._client = None
        self._client_spoke = True
        self._mavlink.disconnect()


def _timeval(seconds: float) -> bytes:
    """A ``struct timeval``, for SO_SNDTIMEO: it costs no system call per wait."""
    return struct.pack("@ll", int(seconds), round(seconds % 1.0 * 1e6))


def _listen(address: tuple[str, int]) -> socket.socket:
    listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    try:
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listener.bind(address)
        listener.listen(BACKLOG)
    except OSError as error:
        listener.close()
        raise PortTakenError(
            f"cannot listen on TCP {address[0]}:{address[1]} ({error.strerror or error}); "
            "choose another with --mavlink-port or --serial"
        ) from error
    listener.setblocking(False)
    return listener
