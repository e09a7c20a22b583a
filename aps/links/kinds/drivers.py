"""What opens links, by the kind of an address: each is a `Driver`."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, Protocol

from aps.links.address import LinkAddress
from aps.links.kinds.serial import SerialConnector
from aps.links.kinds.tcp import TcpConnector, TcpServer
from aps.links.kinds.udp import UdpListener, UdpSender
from aps.links.link import LinkOwner


class Driver(Protocol):
    """Opens links at one address, and opens them again when they are lost."""

    @property
    def address(self) -> LinkAddress:
        """Where."""

    async def start(self) -> None:
        """Take what can be refused at once (a port).

        Raises:
            OSError: it is refused.
        """

    async def run(self) -> None:
        """Work until cancelled."""

    def close(self) -> None:
        """Give everything back."""


_DRIVERS: Final[dict[str, Callable[[LinkAddress, LinkOwner, int], Driver]]] = {
    "tcp": TcpConnector,
    "tcp-server": TcpServer,
    "udp-out": UdpSender,
    "udp-in": UdpListener,
    "serial": SerialConnector,
}


def make_driver(address: LinkAddress, owner: LinkOwner, limit_bytes: int) -> Driver:
    """The driver for an address.

    Args:
        address: where.
        owner: gets the links' events.
        limit_bytes: bound of the queue in front of each link.
    """
    return _DRIVERS[address.kind](address, owner, limit_bytes)
