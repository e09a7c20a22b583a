"""The ports at which autopilots find their physics: UDP for ArduPilot's JSON scheme, TCP for PX4."""

from __future__ import annotations

import socket
import struct

from fdm.errors import PortInUseError
from fdm.exchange.aircraft_spec import AircraftSpec

RECEIVE_BUFFER_BYTES = 4 << 20
"""Asked of the system, which may give less: a full buffer loses the autopilot's packets among garbage."""
READ_TIMEOUT_US = 10_000
"""Longest wait in a socket: for so long a lone UA's exchange may overlook commands."""
_TIMEVAL = struct.Struct("@ll")


def bind(spec: AircraftSpec, host: str) -> socket.socket:
    """A socket on the UA's port.

    UDP: its calls wait, for READ_TIMEOUT_US at most, unless a flag forbids it. For PX4: TCP; it listens, never waits.

    Raises:
        PortInUseError: the port cannot be had.
    """
    kind, name = (socket.SOCK_DGRAM, "UDP") if spec.px4 is None else (socket.SOCK_STREAM, "TCP")
    sock = socket.socket(socket.AF_INET, kind)
    try:
        if spec.px4 is None:
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER_BYTES)
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVTIMEO, _TIMEVAL.pack(0, READ_TIMEOUT_US))
            sock.bind((host, spec.port))
        else:
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            sock.setblocking(False)
            sock.bind((host, spec.port))
            sock.listen(1)
    except OSError as error:
        sock.close()
        raise PortInUseError(
            f"{name} port {spec.port} on {host} (flight dynamics of UA {spec.ua_id}) cannot be used: "
            f"{error.strerror}",
            spec.port,
        ) from None
    return sock
