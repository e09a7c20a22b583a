"""One autopilot on real sockets: the UDP socket to its physics, and a TCP server for the client of each MAVLink port.

Its turn is that of ArduPilot's SITL, so that what it sends depends on what it received and not on the clock:
when a sensor frame is there, take what the clients have sent until then; step; write to the clients; answer the
physics. A client that does not read holds the simulation back, until it is given up.
"""

from __future__ import annotations

import contextlib
import socket
from collections import Counter
from collections.abc import Mapping
from time import monotonic
from types import MappingProxyType

from standin.autopilot import Autopilot
from standin.client_socket import ClientSocket
from standin.waiter import Waiter
from standin.wire.sensors import parse_sensor_frame

DATAGRAM_MAX_BYTES = 65536
NEVER_S = float("-inf")


class AutopilotSockets:
    """An autopilot with its sockets, for a loop that says when they can be read.

    Args:
        autopilot: the core.
        fdm_address: host and UDP port of the physics.
        mavlink_address: host and TCP port to listen on; port 0 takes any free one.
        name: what messages call it.
        serial_ports: TCP ports of the autopilot's further ports, by number.

    Raises:
        PortTakenError: a TCP port cannot be bound.
        OSError: the physics' host does not resolve.
    """

    def __init__(
        self,
        autopilot: Autopilot,
        fdm_address: tuple[str, int],
        mavlink_address: tuple[str, int],
        name: str = "",
        serial_ports: Mapping[int, int] = MappingProxyType({}),
    ) -> None:
        self.name = name
        self.autopilot = autopilot
        self.errors: Counter[str] = Counter()
        """Socket errors survived, by kind."""
        self.sent_s = 0.0
        """When the latest servo packet was sent, monotonic wall time; NEVER_S if nobody was there to get it."""
        self._clients: list[ClientSocket] = []
        try:
            self._clients.append(ClientSocket(autopilot.mavlink, mavlink_address, self.errors))
            for number, port in serial_ports.items():
                address = (mavlink_address[0], port)
                self._clients.append(ClientSocket(autopilot.serials[number], address, self.errors))
            self._udp = _connect_udp(fdm_address)
        except OSError:
            for client in self._clients:
                client.close()
            raise

    @property
    def mavlink_port(self) -> int:
        """The TCP port listened on."""
        return self._clients[0].port

    def join(self, waiter: Waiter[AutopilotSockets]) -> None:
        """Have ``waiter`` wait for the sockets; call ``turn`` when a frame has come."""
        waiter.add_physics(self._udp, self)
        for client in self._clients:
            client.join(waiter)

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
        if autopilot.take_frame(parse_sensor_frame(datagram)):
            for client in self._clients:
                client.read()
            autopilot.step()
            for client in self._clients:
                client.write()
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
        with contextlib.suppress(OSError):
            self._udp.shutdown(socket.SHUT_RDWR)
        for client in self._clients:
            client.shut_down()

    def close(self) -> None:
        """Close the sockets."""
        self._udp.close()
        for client in self._clients:
            client.close()


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
