"""Endpoints as they are written: ``tcpin:127.0.0.1:5770``, ``pty``, ``serial:/dev/ttyUSB0:57600``."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from aps.links.address import DEFAULT_BAUD, LOOPBACK, parse_host_port
from bridge.endpoints.endpoint import Endpoint
from bridge.endpoints.line import PseudoTerminal, SerialPort
from bridge.endpoints.tcp import TcpConnection, TcpPort
from bridge.endpoints.udp import UdpPort, UdpTarget

KINDS: Final[dict[str, Callable[[str, str, int], Endpoint]]] = {
    "tcp": TcpConnection,
    "tcpin": TcpPort,
    "udp": UdpTarget,
    "udpin": UdpPort,
}
"""Those with HOST:PORT; one that listens may be given port 0, any free one."""
FORMS: Final = "tcp:HOST:PORT, tcpin:HOST:PORT, udp:HOST:PORT, udpin:HOST:PORT, pty, serial:DEVICE[:BAUD]"


def endpoint_of(text: str) -> Endpoint:
    """The endpoint of an address; ``:PORT`` alone is on loopback.

    Raises:
        ValueError: with the text and what is allowed.
    """
    kind, _, place = text.partition(":")
    if text == "pty":
        return PseudoTerminal()
    if kind == "serial" and place:
        device, _, baud = place.rpartition(":") if place.rpartition(":")[2].isdecimal() else (place, "", "")
        return SerialPort(text, device, int(baud or DEFAULT_BAUD))
    if kind not in KINDS or not place:
        raise ValueError(f"{text!r} is none of {FORMS}")
    where = LOOPBACK + place if place.startswith(":") else place
    try:
        host, port = parse_host_port(where, lowest_port=0 if kind in ("tcpin", "udpin") else 1)
    except ValueError as error:
        raise ValueError(f"{text!r} is not {kind}:HOST:PORT: {error}") from error
    return KINDS[kind](f"{kind}:{where}", host, port)
