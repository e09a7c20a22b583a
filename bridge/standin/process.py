"""The shell: owns the UDP socket to the physics and the TCP server for the client, and moves bytes.

Its turn is that of ArduPilot's SITL, so that what it sends depends on what it received and not on the clock:
wait for a sensor frame; take what the client has sent until then; step; write to the client; answer the
physics. Wall time decides two things only: when a servo packet that got no answer is sent again, and when a
client that does not read is given up. Until then such a client holds the simulation back.

As ArduPilot's SERIAL0, the server has one client: a second one connects (the kernel completes it) and gets
nothing until the first is gone; then it is served.
"""

from __future__ import annotations

import contextlib
import select
import signal
import socket
import struct
from collections import Counter
from types import FrameType

from bridge.standin.autopilot import Autopilot

RESEND_AFTER_S = 1.1
"""Silence of the physics after which the last servo packet is sent again."""
DEAF_MAX_S = 10.0
"""How long a client that takes nothing holds the simulation back."""
SEND_BUFFER_BYTES = 256 * 1024
"""What the kernel holds for a client that does not read just now: more than some ticks of telemetry."""
DATAGRAM_MAX_BYTES = 65536
READ_MAX_BYTES = 65536
"""Of the client's bytes in one frame; what is more waits for the next."""
BACKLOG = 5


class PortInUseError(OSError):
    """A port that the autopilot needs cannot be bound."""


class Process:
    """One autopilot on real sockets. ``run`` returns after ``stop`` or a signal."""

    def __init__(
        self, autopilot: Autopilot, fdm_address: tuple[str, int], mavlink_address: tuple[str, int]
    ) -> None:
        """Bind the sockets.

        Args:
            autopilot: the core.
            fdm_address: host and UDP port of the physics.
            mavlink_address: host and TCP port to listen on; port 0 takes any free one.

        Raises:
            PortInUseError: the TCP port cannot be bound.
            OSError: the physics' host does not resolve.
        """
        self._autopilot = autopilot
        self._stopped = False
        self.errors: Counter[str] = Counter()
        """Socket errors survived, by kind."""
        self._listener = _listen(mavlink_address)
        self._udp = _connect_udp(fdm_address)
        self._client: socket.socket | None = None
        self._readable = select.poll()
        self._readable.register(self._listener, select.POLLIN)

    @property
    def mavlink_port(self) -> int:
        """The TCP port listened on."""
        return int(self._listener.getsockname()[1])

    def stop(self) -> None:
        """End ``run``; callable from a signal handler or another thread."""
        self._stopped = True
        for waited_on in (self._udp, self._client):  # a shutdown ends a wait at once
            if waited_on is not None:
                with contextlib.suppress(OSError):
                    waited_on.shutdown(socket.SHUT_RDWR)

    def stop_on_signals(self) -> None:
        """End ``run`` on SIGTERM and SIGINT."""

        def handler(_number: int, _frame: FrameType | None) -> None:
            self.stop()

        signal.signal(signal.SIGTERM, handler)
        signal.signal(signal.SIGINT, handler)

    def run(self) -> None:
        """Serve until stopped."""
        autopilot, receive = self._autopilot, self._udp.recv
        self._send_packet(autopilot.fdm.packet)
        while not self._stopped:
            try:
                datagram = receive(DATAGRAM_MAX_BYTES)
            except BlockingIOError:  # silence
                self._send_packet(autopilot.fdm.packet)
                continue
            except OSError:  # nobody listens there (yet)
                self.errors["physics_unreachable"] += 1
                continue
            if autopilot.take_frame(datagram):
                self._read_client()
                packet = autopilot.step()
                if autopilot.mavlink.has_data:
                    self._write_client(autopilot.mavlink.data_to_send())
                self._send_packet(packet)

    def close(self) -> None:
        """Close the sockets."""
        for one in (self._udp, self._listener, self._client):
            if one is not None:
                one.close()

    def _send_packet(self, packet: bytes) -> None:
        try:
            self._udp.send(packet)
        except OSError:
            self.errors["physics_unreachable"] += 1

    def _read_client(self) -> None:
        """Take what the client has sent, or the client that waits and what it has sent."""
        if not self._readable.poll(0):
            return
        client = self._client or self._accept()
        if client is None:
            return
        try:
            data = client.recv(READ_MAX_BYTES, socket.MSG_DONTWAIT)
        except BlockingIOError:
            return
        except OSError:
            data = b""
        if data:
            self._autopilot.mavlink.receive(data)
        else:
            self._release_client("client_gone")

    def _write_client(self, data: bytes) -> None:
        """Write all of it: a client that is slow to read holds the simulation back."""
        if self._client is None:
            return
        try:
            self._client.sendall(data)
        except BlockingIOError:
            self._release_client("client_deaf")
        except OSError:
            self._release_client("client_gone")

    def _accept(self) -> socket.socket | None:
        try:
            client, _ = self._listener.accept()
        except OSError:  # gone before it was accepted
            self.errors["accept"] += 1
            return None
        client.settimeout(None)
        client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        client.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER_BYTES)
        client.setsockopt(socket.SOL_SOCKET, socket.SO_SNDTIMEO, _timeval(DEAF_MAX_S))
        self._client = client
        self._readable.unregister(self._listener)  # one client at a time
        self._readable.register(client, select.POLLIN)
        self._autopilot.mavlink.connect()
        return client

    def _release_client(self, reason: str) -> None:
        if self._client is None:
            return
        self.errors[reason] += 1
        self._readable.unregister(self._client)
        self._client.close()
        self._client = None
        self._autopilot.mavlink.disconnect()
        self._readable.register(self._listener, select.POLLIN)


def _timeval(seconds: float) -> bytes:
    """A ``struct timeval``, for SO_RCVTIMEO and SO_SNDTIMEO: they cost no system call per wait."""
    return struct.pack("@ll", int(seconds), round(seconds % 1.0 * 1e6))


def _listen(address: tuple[str, int]) -> socket.socket:
    listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    try:
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listener.bind(address)
        listener.listen(BACKLOG)
    except OSError as error:
        listener.close()
        raise PortInUseError(
            f"cannot listen on TCP {address[0]}:{address[1]} ({error.strerror or error}); "
            "choose another with --mavlink-port"
        ) from error
    listener.setblocking(False)
    return listener


def _connect_udp(address: tuple[str, int]) -> socket.socket:
    udp = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        udp.connect(address)
    except OSError as error:
        udp.close()
        raise OSError(
            f"cannot reach the physics at UDP {address[0]}:{address[1]} ({error.strerror or error}); "
            "see --fdm-host and --fdm-port"
        ) from error
    udp.setsockopt(socket.SOL_SOCKET, socket.SO_RCVTIMEO, _timeval(RESEND_AFTER_S))
    return udp
