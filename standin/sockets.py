"""One autopilot on real sockets: the UDP socket to its physics and the TCP server for its client.

Its turn is that of ArduPilot's SITL, so that what it sends depends on what it received and not on the clock:
when a sensor frame is there, take what the client has sent until then; step; write to the client; answer the
physics. A client that does not read holds the simulation back, until it is given up.

As ArduPilot's SERIAL0, the server has one client: a second one connects (the kernel completes it) and gets
nothing until the first is gone; then it is served.
"""

from __future__ import annotations

import contextlib
import socket
import struct
from collections import Counter
from time import monotonic

from standin.autopilot import Autopilot
from standin.waiter import TELLS_ARRIVALS, Waiter

DEAF_MAX_S = 10.0
"""How long a client that takes nothing holds the simulation back."""
SEND_BUFFER_BYTES = 256 * 1024
"""What the kernel holds for a client that does not read just now: more than some ticks of telemetry."""
DATAGRAM_MAX_BYTES = 65536
READ_MAX_BYTES = 65536
"""Of the client's bytes in one frame; what is more waits for the next."""
BACKLOG = 5
NEVER_S = float("-inf")


class PortTakenError(OSError):
    """A port that the autopilot needs cannot be bound."""


class AutopilotSockets:
    """An autopilot with its sockets, for a loop that says when they can be read.

    Args:
        autopilot: the core.
        fdm_address: host and UDP port of the physics.
        mavlink_address: host and TCP port to listen on; port 0 takes any free one.
        name: what messages call it.

    Raises:
        PortInUseError: the TCP port cannot be bound.
        OSError: the physics' host does not resolve.
    """

    def __init__(
        self,
        autopilot: Autopilot,
        fdm_address: tuple[str, int],
        mavlink_address: tuple[str, int],
        name: str = "",
    ) -> None:
        self.name = name
        self.autopilot = autopilot
        self.errors: Counter[str] = Counter()
        """Socket errors survived, by kind."""
        self.sent_s = 0.0
        """When the latest servo packet was sent, monotonic wall time; NEVER_S if nobody was there to get it."""
        self._client_spoke = True
        self._listener = _listen(mavlink_address)
        try:
            self._udp = _connect_udp(fdm_address)
        except OSError:
            self._listener.close()
            raise
        self._client: socket.socket | None = None

    @property
    def mavlink_port(self) -> int:
        """The TCP port listened on."""
        return int(self._listener.getsockname()[1])

    def join(self, waiter: Waiter[AutopilotSockets]) -> None:
        """Have ``waiter`` wait for the sockets; call ``turn`` when a frame has come."""
        self._waiter = waiter
        waiter.add_physics(self._udp, self)
        waiter.add_client(self._listener, self._hear_client)

    def turn(self) -> bool:
        """Take the datagram that is there; if it is a new frame, make the autopilot's turn.

        Returns:
            Whether the physics listens: False if it is not there (yet).
        """
        try:
            datagram = self._udp.recv(DATAGRAM_MAX_BYTES)
        except BlockingIOError:
            return True
        except OSError:
            self.errors["physics_unreachable"] += 1
            self.sent_s = NEVER_S
            return False
        autopilot = self.autopilot
        if autopilot.take_frame(datagram):
            if self._client_spoke:
                self._read_client()
            autopilot.step()
            if autopilot.mavlink.has_data:
                self._write_client(autopilot.mavlink.data_to_send())
            self.send_packet()
        return True

    def send_packet(self) -> None:
        """Send the latest servo packet."""
        self.sent_s = monotonic()
        try:
            self._udp.send(self.autopilot.fdm.packet)
        except OSError:
            self.errors["physics_unreachable"] += 1

    def shut_down(self) -> None:
        """End whatever waits on a socket, at once; callable from a signal handler or another thread."""
        for waited_on in (self._udp, self._client):
            if waited_on is not None:
                with contextlib.suppress(OSError):
                    waited_on.shutdown(socket.SHUT_RDWR)

    def close(self) -> None:
        """Close the sockets."""
        for one in (self._udp, self._listener, self._client):
            if one is not None:
                one.close()

    def _hear_client(self) -> None:
        """The client, or one that wants to be it, has sent something."""
        self._client_spoke = True

    def _read_client(self) -> None:
        """Take what the client has sent, or the client that waits and what it has sent."""
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
            self.autopilot.mavlink.receive(data)
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
        except BlockingIOError:
            self._client_spoke = not TELLS_ARRIVALS
            return None
        except OSError:  # gone before it was accepted
            self.errors["accept"] += 1
            return None
        client.settimeout(None)
        client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        client.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER_BYTES)
        client.setsockopt(socket.SOL_SOCKET, socket.SO_SNDTIMEO, _timeval(DEAF_MAX_S))
        self._client = client
        self._waiter.add_client(client, self._hear_client)
        self.autopilot.mavlink.connect()
        return client

    def _release_client(self, reason: str) -> None:
        """Let the client go; one that waits is served from the next frame on."""
        if self._client is None:
            return
        self.errors[reason] += 1
        self._waiter.remove_client(self._client)
        self._client.close()
        self._client = None
        self._client_spoke = True
        self.autopilot.mavlink.disconnect()


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
    udp.setblocking(False)
    return udp
