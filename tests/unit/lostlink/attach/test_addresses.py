"""Addresses are those of the documentation, and there is room for all or a word."""

from __future__ import annotations

from ipaddress import IPv4Network

import pytest

from bridge.scenario.agents import StillAgent
from bridge.scenario.nodes import Aircraft, GroundNode, Transceiver
from lostlink.attach.addresses import AddressMistake, addresses_of, names_of, subnet_of

STILL = StillAgent(type="still")


def ua(number: int) -> Aircraft:
    return Aircraft(id=number, agent=STILL)


def ground(name: str) -> GroundNode:
    return GroundNode(kind="ground", id=name, agent=STILL)


NODES: list[Transceiver] = [ua(0), ground("gcs"), ua(3), ua(249), ground("probe")]


@pytest.mark.parametrize(
    ("subnet", "expected"),
    [
        ("10.42.0.0/24", ["10.42.0.1", "10.42.0.254", "10.42.0.4", "10.42.0.250", "10.42.0.253"]),
        ("172.16.4.0/22", ["172.16.4.1", "172.16.7.254", "172.16.4.4", "172.16.4.250", "172.16.7.253"]),
    ],
)
def test_ua_count_up_from_the_first_and_ground_nodes_down_from_the_last(
    subnet: str, expected: list[str]
) -> None:
    found = addresses_of(NODES, subnet_of(subnet))
    assert {node: str(address) for node, address in found.items()} == dict(
        zip(("0", "gcs", "3", "249", "probe"), expected, strict=True)
    )


@pytest.mark.parametrize(
    ("nodes", "subnet", "node"),
    [
        ([ua(0), ua(2)], "10.0.0.0/30", "2"),  # .1 and .2, and .3 is for all
        ([ua(1), ground("gcs")], "10.0.0.0/30", "1"),  # both would be .2
        ([ua(0)], "10.0.0.1/32", "0"),
    ],
)
def test_a_subnet_without_room_is_told_with_the_node(
    nodes: list[Transceiver], subnet: str, node: str
) -> None:
    with pytest.raises(AddressMistake, match=f"{subnet} has no address for node {node}: choose a larger"):
        addresses_of(nodes, IPv4Network(subnet))


@pytest.mark.parametrize(
    "text",
    [
        "10.42.0.1/24",
        "nothing",
        "10.42.0.0/33",
        "127.0.0.0/24",
        "224.0.0.0/24",
        "fd00::/64",
        "0.0.0.0/0",
        "0.0.0.0/8",
        "126.0.0.0/7",
        "192.0.0.0/2",
    ],
)
def test_what_is_no_subnet(text: str) -> None:
    with pytest.raises(AddressMistake, match=r"subnet|none that interfaces have"):
        subnet_of(text)


def test_names() -> None:
    assert list(names_of(NODES).values()) == ["ua-0", "gcs", "ua-3", "ua-249", "probe"]


@pytest.mark.parametrize(
    ("wrong", "told"),
    [
        ("ua-3", "node 3 has the name 'ua-3'"),
        ("UA-3", "node 3 has the name 'ua-3'"),
        ("localhost", "node localhost has the name 'localhost'"),
        ("Localhost", "node Localhost has the name 'Localhost'"),
    ],
)
def test_no_two_hosts_have_one_name(wrong: str, told: str) -> None:
    """The first in /etc/hosts, in which no case counts, would get what is for the other."""
    with pytest.raises(AddressMistake, match=rf"{told}, and so has another host"):
        names_of([*NODES, ground(wrong)])
