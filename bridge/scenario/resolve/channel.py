"""From a scenario to the channels of its run: each has the medium of its nodes, and the network that takes time."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final

from bridge.scenario.model import Scenario
from bridge.scenario.nodes import MAIN
from bridge.scenario.resolve.partitions import partitions_of
from bridge.scenario.resolve.radio import radios_of
from bridge.scenario.resolve.sensing import emitters_of
from channel.access.media.medium import AccessMedium
from channel.access.settings.base import Ideal, Surroundings
from channel.access.settings.medium import MediumSettings, carriers_of, rate_mistake
from channel.access.world import World
from channel.draws import Draws
from channel.link.radio import Radio
from channel.medium.judge.judge import Judge
from channel.medium.medium import Medium
from channel.medium.stations.switches import Switches
from channel.network.band import Neighbour, share_band
from channel.network.crossing import NetworkSide
from channel.network.entry import EntryInstants, EntrySettings
from channel.network.link_world import LinkWorld
from channel.network.network import Network
from channel.presets import PresetError
from channel.routing.routed import RoutingCounts
from channel.routing.settings import RoutingSettings, router_of
from channel.variant import name_of

Watch = Callable[[Medium, LinkWorld], World]
"""Puts a world in front of a network's, that looks on."""
NO_WATCHES: Final[Mapping[str, Watch]] = MappingProxyType({})


@dataclass(frozen=True, slots=True)
class RadioChannel:
    """What decides fates on one radio network.

    Attributes:
        name: of the network, and of its nodes' radios.
        medium: where its nodes are, and the physics of their radios.
        network: who transmits when; None if packets take no time.
        judge: takes in what is drawn.
    """

    name: str
    medium: Medium
    network: Network | None
    judge: Judge

    @property
    def shares_draws(self) -> bool:
        """Whether packets share what is drawn."""
        return any(radio.shares_draws for radio in self.medium.radios)

    @property
    def routing(self) -> RoutingCounts | None:
        """What routing cost so far; None: nodes do not hand packets on."""
        return None if self.network is None else self.network.routing

    @property
    def neighbour(self) -> Neighbour | None:
        """What the other networks of its band have to do with; None: nothing is on the air for any time."""
        carriers = carriers_of(self.medium.radios[0].config.medium)
        if self.network is None or carriers is None:
            return None
        return Neighbour(self.network, NetworkSide(self.name, self.medium, carriers))


def medium_settings(radios: Mapping[str, Radio]) -> MediumSettings:
    """The medium that all radios of a network share.

    Raises:
        PresetError: they have several, or several bit rates on one that has a rate for all.
    """
    media = {node: radio.config.medium for node, radio in radios.items()}
    first, settings = next(iter(media.items()))
    for node, other in media.items():
        if other != settings:
            text = (
                f"node {first} has {name_of(settings)}, and node {node} {name_of(other)} or other settings of it: "
                "nodes that share a channel share its medium"
            )
            raise PresetError(text, key="radio.medium")
        if mistake := rate_mistake(
            settings, radios[first].config.bit_rate_bps, radios[node].config.bit_rate_bps
        ):
            raise PresetError(f"node {node}: {mistake}", key="radio.bit_rate_bps")
    return settings


def routing_settings(radios: Mapping[str, Radio]) -> RoutingSettings:
    """How nodes of a network hand packets on.

    Raises:
        PresetError: their radios say several things.
    """
    found = {node: radio.config.routing for node, radio in radios.items()}
    first, settings = next(iter(found.items()))
    for node, other in found.items():
        if other != settings:
            text = f"node {first} has {name_of(settings)}, and node {node} {name_of(other)} or other settings of it"
            raise PresetError(f"{text}: nodes of a network have one way of routing", key="radio.routing")
    return settings


def fates_go_together(scenario: Scenario, network: str | None = None) -> bool:
    """Whether fates of packets hang on each other: then their ratios have no binomial intervals.

    They share what is drawn; where packets take time they share queues, collisions and outages, too.

    Args:
        scenario: of the run.
        network: one of its radio networks; None: all.

    Raises:
        PresetError: there is no such radio.
    """
    emitters = emitters_of(scenario)
    names = scenario.network_names if network is None else (network,)
    radios = [radio for name in names for radio in radios_of(scenario, emitters, name).values()]
    return any(radio.shares_draws or not isinstance(radio.config.medium, Ideal) for radio in radios)


def channels_of(
    scenario: Scenario, switches: Mapping[str, Switches], watches: Mapping[str, Watch] = NO_WATCHES
) -> list[RadioChannel]:
    """The channels of all radio networks of a run; those that are in one band disturb each other.

    Args:
        scenario: of the run.
        switches: of each network's nodes, by its name.
        watches: who looks on at a network, by its name.

    Raises:
        PresetError: as `channel_of`.
    """
    channels = [
        channel_of(scenario, switches[name], name, watches.get(name)) for name in scenario.network_names
    ]
    share_band([neighbour for each in channels if (neighbour := each.neighbour) is not None])
    return channels


def channel_of(
    scenario: Scenario, switches: Switches, name: str = MAIN, watch: Watch | None = None
) -> RadioChannel:
    """The channel of a radio network of a run, as if there were no other.

    Args:
        scenario: of the run.
        switches: of the network's nodes.
        name: of the network.
        watch: who looks on at it.

    Raises:
        PresetError: the radios have several media, or the medium cannot be that of these nodes.
    """
    emitters = emitters_of(scenario)
    radios = radios_of(scenario, emitters, name)
    settings, routing = medium_settings(radios), routing_settings(radios)
    nodes = tuple(radios)
    network = "" if name == MAIN else name
    judge = Judge(len(nodes), Draws(scenario.seed, network).seed)
    takes_time = not isinstance(settings, Ideal)
    medium = Medium(
        radios,
        seed=scenario.seed,
        nodes=nodes,
        judge=None if takes_time else judge,
        emitters=[each.name for each in emitters],
        switches=switches,
        bases=[node.node for node in scenario.ground if node.node in radios],
        ahead_ns=2 * scenario.tick_period_ns if takes_time else 0,
        groups=scenario.groups_on(name),
        network=network,
        partitions=partitions_of(scenario),
    )
    if isinstance(settings, Ideal):
        return RadioChannel(name, medium, None, judge)
    noise_floor_dbm = min(radio.noise_floor_dbm for radio in radios.values())
    configs = {node: radio.config for node, radio in radios.items()}

    def opened(links: LinkWorld) -> AccessMedium:
        world: World = links if watch is None else watch(medium, links)
        surroundings = Surroundings.of(world, medium.index, medium.draws.seed, configs, noise_floor_dbm)
        return settings.open(surroundings)

    entry = _entry_of(scenario, medium)
    try:
        router = router_of(routing, medium.index, medium.draws)
        return RadioChannel(name, medium, Network(medium, opened, entry, judge, router), judge)
    except ValueError as error:
        key = "radio" if name == MAIN else f"networks.{name}"
        raise PresetError(str(error), key=f"{key}.medium") from error


def _entry_of(scenario: Scenario, medium: Medium) -> EntryInstants:
    transmit = scenario.transmit
    return EntryInstants(
        medium.nodes,
        EntrySettings(
            None if transmit.phase_s == "drawn" else transmit.phase_s,
            transmit.processing_s,
            transmit.processing_spread_s,
        ),
        scenario.tick_period_ns,
        medium.draws.common,  # it is the computer that takes this time, whichever radio it feeds
    )
