"""From what a user asks for to what is attached: a node of a running simulation, one of its radios, and addresses."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from ipaddress import IPv4Address, IPv4Network
from pathlib import Path
from typing import Final

from bridge.bus.identity.roster import node_identity
from bridge.bus.keys import MAIN
from bridge.run.access import Access, access_of, directory_of
from bridge.run.directory import RunDirectory
from bridge.scenario.model import Scenario
from bridge.scenario.nodes import Transceiver
from channel.config import RadioConfig
from channel.presets import load_radio, radio_from_mapping
from lostlink.attach.addresses import DEFAULT_SUBNET, addresses_of, names_of, subnet_of

MTU_MIN_BYTES: Final = 68
"""What IPv4 needs at least (RFC 791, section 3.2)."""
MTU_USUAL_BYTES: Final = 1500
"""That of Ethernet, for radios that would take more."""


class NotAttachable(ValueError):
    """What was asked for cannot be; the text says why."""


@dataclass(frozen=True, slots=True)
class AttachRequest:
    """What a user asks for.

    Attributes:
        run: directory of a run, or its name in `runs/`.
        node: id of the node.
        radio: name of its radio.
        subnet: of the addresses.
        mtu_bytes: of the interface; None: the radio's.
    """

    run: Path
    node: str
    radio: str = MAIN
    subnet: str = DEFAULT_SUBNET
    mtu_bytes: int | None = None


@dataclass(frozen=True, slots=True)
class AttachPlan:
    """What is attached to what.

    Attributes:
        directory: of the run.
        access: to it, as the node.
        node: the node.
        radio: name of its radio.
        subnet: of the addresses.
        addresses: of the nodes on that radio's network, by id; the node's own among them.
        names: what these are called, by id.
        mtu_bytes: of the interface.
    """

    directory: RunDirectory
    access: Access
    node: Transceiver
    radio: str
    subnet: IPv4Network
    addresses: dict[str, IPv4Address]
    names: dict[str, str]
    mtu_bytes: int

    @property
    def title(self) -> str:
        """What the node is called where people read."""
        return self.directory.scenario.title(self.node.node)

    @property
    def hosts(self) -> str:
        """Lines for /etc/hosts."""
        return "".join(f"{address} {self.names[each]}\n" for each, address in self.addresses.items())

    def lines(self) -> Iterator[str]:
        """What a user has to know at the start."""
        own = self.addresses[self.node.node]
        yield f"{self.title} is {own} on radio {self.radio} (MTU {self.mtu_bytes} bytes)"
        others = [f"{self.names[each]} {at}" for each, at in self.addresses.items() if each != self.node.node]
        yield f"others: {', '.join(others)}" if others else "nobody else is on this radio"
        speed = self.directory.scenario.speed_factor
        if speed != 1.0:
            yield (
                f"warning: the run flies at {speed:g} times real time, and the program lives in wall time: rates and "
                "delays that it measures are off by as much; fly with --speed 1"
            )


def plan_of(asked: AttachRequest) -> AttachPlan:
    """See that it can be.

    Raises:
        NotAttachable, AddressMistake, SessionError: it cannot.
    """
    directory = directory_of(asked.run)
    try:
        scenario, info = directory.scenario, directory.info
    except (OSError, ValueError) as error:
        raise NotAttachable(f"{directory.path} is no run: {error}") from error
    node = _node_of(scenario, asked.node)
    if info.replay:
        raise NotAttachable(f"{directory.path} repeats {info.replay}: it takes nothing from outside")
    access = access_of(asked.run, node_identity(node.node))
    subnet = subnet_of(asked.subnet)
    everybody = addresses_of(scenario.transceivers, subnet)
    radios = scenario.reach_of(node.node)
    if asked.radio not in radios:
        raise NotAttachable(
            f"{scenario.title(node.node)} has no radio {asked.radio!r}; it has {', '.join(radios)}"
        )
    if asked.radio in node.modems:
        raise NotAttachable(
            f"{scenario.title(node.node)} has a modem on its radio {asked.radio}, which sends and hears its "
            "autopilot's or its stations' bytes alone: attach to another radio"
        )
    near = scenario.nodes_on(asked.radio)
    return AttachPlan(
        directory,
        access,
        node,
        asked.radio,
        subnet,
        {each.node: everybody[each.node] for each in near},
        names_of(near),
        _mtu_bytes(_radio_config(scenario, node, asked.radio), asked),
    )


def _node_of(scenario: Scenario, node_id: str) -> Transceiver:
    for node in scenario.transceivers:
        if node.node == node_id:
            if not node.has_agent:
                raise NotAttachable(
                    f"{scenario.title(node_id)} has a free program for its agent, which numbers the node's packets: "
                    "give it an agent of another type, such as still"
                )
            return node
    raise NotAttachable(f"there is no node {node_id!r}; there are {', '.join(scenario.transceiver_ids)}")


def _radio_config(scenario: Scenario, node: Transceiver, name: str) -> RadioConfig:
    setting = (node.radio or scenario.radio) if name == MAIN else scenario.networks[name]
    return load_radio(setting) if isinstance(setting, str) else radio_from_mapping(setting)


def _mtu_bytes(radio: RadioConfig, asked: AttachRequest) -> int:
    most = radio.mtu_bytes
    if most < MTU_MIN_BYTES:
        raise NotAttachable(
            f"radio {asked.radio} takes {most} bytes at most (mtu_bytes), and IPv4 needs {MTU_MIN_BYTES}"
        )
    if asked.mtu_bytes is None:
        return min(most, MTU_USUAL_BYTES)
    if not MTU_MIN_BYTES <= asked.mtu_bytes <= min(most, 65535):
        raise NotAttachable(
            f"--mtu {asked.mtu_bytes}: from {MTU_MIN_BYTES} to {min(most, 65535)} on radio {asked.radio}"
        )
    return asked.mtu_bytes
