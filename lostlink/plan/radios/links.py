"""Who hears whom on radios that have links: SiK by NETID, ExpressLRS in pairs."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from bridge.scenario.model import Scenario
from bridge.scenario.nodes import MAIN, GroundNode
from channel.access.settings.elrs import ElrsMedium
from channel.access.settings.sik import SikMedium
from channel.link.radio import Radio

PAIR = 2


@dataclass(frozen=True, slots=True)
class RadioLinks:
    """Of one radio network.

    Attributes:
        network: its name.
        radio: name of its radio.
        nodes: by link, the nodes that hear each other.
        alone: nodes that nobody hears.
    """

    network: str
    radio: str
    nodes: Mapping[str, tuple[str, ...]]
    alone: tuple[str, ...]

    def lines(self) -> Iterator[str]:
        """As `lostlink check` prints it."""
        for name, nodes in self.nodes.items():
            note = " (more than two: they disturb each other)" if len(nodes) > PAIR else ""
            yield f"{self.network} ({self.radio}): {name}: {', '.join(nodes)}{note}"


def links_of(on: Mapping[str, Mapping[str, Radio]]) -> Iterator[RadioLinks]:
    """The links of each network of which the medium has links.

    Args:
        on: by network, the radio of each node on it.
    """
    for network, radios in on.items():
        config = next(iter(radios.values())).config
        if isinstance(config.medium, SikMedium | ElrsMedium):
            nodes = config.medium.links(tuple(radios))
            linked = {node for ids in nodes.values() for node in ids}
            yield RadioLinks(
                network, config.name, nodes, tuple(node for node in radios if node not in linked)
            )


def unlinked(scenario: Scenario, links: RadioLinks) -> Iterator[str]:
    """Warnings: nodes that are likely to send to each other, and have no link."""
    told = "; ".join(f"{name}: {', '.join(nodes)}" for name, nodes in links.nodes.items())
    modems = scenario.modems_on(links.network)
    if not modems:
        if links.network == MAIN and (len(links.nodes) > 1 or links.alone):
            yield (
                f"radio {links.network}: what a node sends to all comes to those that it has a link with ({told}); "
                "for the others it is lost (no_peer)"
            )
        return
    for node in links.alone:
        if links.network == MAIN and node not in modems:
            yield (
                f"node {node}: radio main has no link with it ({told}): what it sends, and what is for it, is lost"
            )
    stations = {node.node for node in scenario.transceivers if isinstance(node, GroundNode)} & modems.keys()
    link_of = {node: ids for ids in links.nodes.values() for node in ids}
    for node in modems:
        others = [other for other in link_of.get(node, ()) if other != node and other in modems]
        if not others or (stations and node not in stations and stations.isdisjoint(others)):
            wanted = "ground station" if stations - {node} else "node with a modem"
            yield (
                f"node {node}: its modem at radio {links.network} has no link with a {wanted} ({told}): give the radio "
                "medium.pairs, with sik also medium.units"
            )
