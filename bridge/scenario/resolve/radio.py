"""From what a scenario names to the object of the channel: the radio.

Apart from `resolve`, as the channel needs scipy, which is slow to import, and only the router needs the channel.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

from bridge.scenario.model import Scenario
from bridge.scenario.nodes import MAIN
from bridge.scenario.sections import Origin
from channel.access.settings.medium import MediumSettings
from channel.config import RadioConfig
from channel.link.emitters.emitter import Emitter
from channel.link.radio import Radio
from channel.preset_errors import PresetError, at_once
from channel.presets import at_origin, load_radio, radio_from_mapping


def radio_of(scenario: Scenario) -> Radio:
    """The radio that a scenario names or spells out.

    Raises:
        PresetError: there is no such preset, or a key or value is wrong.
    """
    with _told_at("radio"):
        return radio_from(scenario.radio, scenario.origin)


def common_radio(scenario: Scenario, emitters: Sequence[Emitter] = ()) -> Radio | None:
    """The radio of all packets, which hears ``emitters``; None if there are several: they have no curve in common.

    Raises:
        PresetError: as `radio_of`.
    """
    return None if scenario.networks else common_radio_on(scenario, MAIN, emitters)


def common_radio_on(scenario: Scenario, network: str, emitters: Sequence[Emitter] = ()) -> Radio | None:
    """The radio of all nodes on a network, which hears ``emitters``; None if some have one of their own.

    Raises:
        PresetError: as `radio_of`.
    """
    if network != MAIN:
        return radio_from(scenario.networks[network], scenario.origin, emitters)
    has_several = any(node.radio is not None for node in scenario.transceivers)
    return None if has_several else radio_from(scenario.radio, scenario.origin, emitters)


def config_of(setting: str | dict[str, Any]) -> RadioConfig:
    """What a preset's name, a file or a mapping says.

    Raises:
        PresetError: there is no such preset, or a key or value is wrong.
    """
    return load_radio(setting) if isinstance(setting, str) else radio_from_mapping(setting)


def radio_from(setting: str | dict[str, Any], origin: Origin, emitters: Sequence[Emitter] = ()) -> Radio:
    """The radio of a preset's name, a file or a mapping.

    Args:
        setting: as in the scenario.
        origin: where the fleet's frame has its zero, for terrain.
        emitters: of the run.

    Raises:
        PresetError: there is no such preset, or a key or value is wrong.
    """
    config = config_of(setting)
    return Radio(at_origin(config, origin.lat_deg, origin.lon_deg, origin.alt_amsl_m), emitters)


def medium_on(scenario: Scenario, network: str, node: str) -> MediumSettings:
    """The medium of a node's radio on a network.

    Raises:
        PresetError: there is no such preset, or a key or value is wrong.
    """
    setting = scenario.networks.get(network, scenario.radio)
    own = next(each.radio for each in scenario.transceivers if each.node == node)
    config = config_of(own if network == MAIN and own is not None else setting)
    return config.medium


def radios_of(scenario: Scenario, emitters: Sequence[Emitter] = (), network: str = MAIN) -> dict[str, Radio]:
    """The radio of each node on a network; they hear ``emitters``. On `main` a node may have its own.

    Raises:
        PresetError: there is no such preset, or a key or value is wrong.
    """
    if network != MAIN:
        with _told_at(f"networks.{network}"):
            radio = radio_from(scenario.networks[network], scenario.origin, emitters)
        return {node.node: radio for node in scenario.nodes_on(network)}
    with _told_at("radio"):
        common = radio_from(scenario.radio, scenario.origin, emitters)
    own = {}
    for node in scenario.transceivers:
        if node.radio is not None:
            with _told_at(f"nodes.{node.node}.radio"):
                own[node.node] = radio_from(node.radio, scenario.origin, emitters)
    return {node: own.get(node, common) for node in scenario.transceiver_ids}


@contextmanager
def _told_at(place: str) -> Iterator[None]:
    """Tell mistakes in a radio, but for those in a file of its own, with its key in the scenario."""
    try:
        yield
    except PresetError as error:
        raise at_once(
            [
                PresetError(each.problem, key=f"{place}.{each.key}".rstrip("."))
                if each.file is None
                else each
                for each in error.mistakes
            ]
        ) from None
