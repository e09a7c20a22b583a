"""IPv4 addresses of nodes: UA I has address I + 1 of the subnet, ground nodes have its last ones, counted down.

In 10.42.0.0/24, the default, UA 0 is 10.42.0.1 (as its MAVLink system id is 1), and the first ground node 10.42.0.254.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from ipaddress import IPv4Address, IPv4Network
from typing import Final

from bridge.scenario.nodes import Aircraft, Transceiver

DEFAULT_SUBNET: Final = "10.42.0.0/24"
LOCALHOST: Final = "localhost"
OF_NO_INTERFACE: Final = tuple(map(IPv4Network, ("0.0.0.0/8", "127.0.0.0/8", "224.0.0.0/3")))
"""This network, loopback, multicast and what is reserved (RFC 6890, table 1 to 16; RFC 1112)."""
LIMITED_BROADCAST: Final = IPv4Address("255.255.255.255")


class AddressMistake(ValueError):
    """A subnet, or a name, that cannot be used."""


def subnet_of(text: str) -> IPv4Network:
    """A subnet as a user writes it.

    Raises:
        AddressMistake: it is none, or none in which nodes can be.
    """
    try:
        subnet = IPv4Network(text)
    except ValueError as error:
        raise AddressMistake(f"{text!r} is no subnet, such as {DEFAULT_SUBNET}: {error}") from error
    if any(subnet.overlaps(each) for each in OF_NO_INTERFACE):
        raise AddressMistake(f"{subnet} is none that interfaces have; such as {DEFAULT_SUBNET}")
    return subnet


def addresses_of(nodes: Iterable[Transceiver], subnet: IPv4Network) -> dict[str, IPv4Address]:
    """The address of each node, by id.

    Args:
        nodes: of the run, in the scenario's order.
        subnet: that they are in.

    Raises:
        AddressMistake: there is no room for all of them.
    """
    first, last = int(subnet.network_address) + 1, int(subnet.broadcast_address) - 1
    found: dict[str, int] = {}
    ground = 0
    for node in nodes:
        if isinstance(node, Aircraft):
            found[node.node] = first + node.id
        else:
            found[node.node] = last - ground
            ground += 1
    for node_id, number in found.items():
        if not first <= number <= last or list(found.values()).count(number) > 1:
            raise AddressMistake(f"{subnet} has no address for node {node_id}: choose a larger subnet")
    return {node_id: IPv4Address(number) for node_id, number in found.items()}


def names_of(nodes: Iterable[Transceiver]) -> dict[str, str]:
    """What nodes are called in the namespace, by id: ``ua-1``, ground nodes by their ids.

    Args:
        nodes: on one radio network.

    Raises:
        AddressMistake: a ground node's id is the name of another host.
    """
    found = {node.node: f"ua-{node.id}" if isinstance(node, Aircraft) else node.node for node in nodes}
    hosts = Counter(name.lower() for name in (*found.values(), LOCALHOST))  # /etc/hosts knows no case
    for node_id, name in found.items():
        if hosts[name.lower()] > 1:
            raise AddressMistake(
                f"node {node_id} has the name {name!r}, and so has another host: give it another id"
            )
    return found
