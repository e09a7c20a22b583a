"""From a scenario to the channel of its run: the medium in which all nodes are, and the network that takes time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from bridge.scenario.model import Scenario
from bridge.scenario.resolve.sensing import emitters_of
from channel.access.media.medium import AccessMedium
from channel.access.settings import Ideal, MediumSettings, Surroundings, name_of
from channel.access.world import World
from channel.link.radio import Radio
from channel.medium.judge.judge import Judge
from channel.medium.medium import Medium
from channel.medium.stations.switches import Switches
from channel.network.entry import Entry, EntrySettings
from channel.network.network import Network
from channel.presets import PresetError


@dataclass(frozen=True, slots=True)
class Channel:
    """What decides fates.

    Attributes:
        medium: where all nodes are, and the physics of their radios.
        network: who transmits when; None if packets take no time.
    """

    medium: Medium
    network: Network | None


def medium_settings(radios: Mapping[str, Radio]) -> MediumSettings:
    """The medium that all radios of a run share.

    Raises:
        PresetError: they have several.
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
    return settings


def channel_of(scenario: Scenario, radios: Mapping[str, Radio], judge: Judge, switches: Switches) -> Channel:
    """The channel of a run.

    Raises:
        PresetError: the radios have several media, or the medium cannot be that of these nodes.
    """
    settings = medium_settings(radios)
    nodes = scenario.transceiver_ids
    takes_time = not isinstance(settings, Ideal)
    medium = Medium(
        radios,
        seed=scenario.seed,
        nodes=nodes,
        judge=None if takes_time else judge,
        emitters=[each.name for each in emitters_of(scenario)],
        switches=switches,
        bases=[node.node for node in scenario.ground],
        ahead_ns=2 * scenario.tick_period_ns if takes_time else 0,
    )
    if isinstance(settings, Ideal):
        return Channel(medium, None)
    noise_floor_dbm = min(radio.noise_floor_dbm for radio in radios.values())
    config = next(iter(radios.values())).config

    def opened(world: World) -> AccessMedium:
        return settings.open(Surroundings.of(world, medium.index, scenario.seed, config, noise_floor_dbm))

    transmit = scenario.transmit
    entry = Entry(
        nodes,
        EntrySettings(
            None if transmit.phase_s == "drawn" else transmit.phase_s,
            transmit.processing_s,
            transmit.processing_spread_s,
        ),
        scenario.tick_period_ns,
        medium.draws,
    )
    try:
        return Channel(medium, Network(medium, opened, entry, judge))
    except ValueError as error:
        raise PresetError(str(error), key="radio.medium") from error
