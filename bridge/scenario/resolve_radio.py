"""From what a scenario names to the object of the channel: the radio.

Apart from `resolve`, as the channel needs scipy, which is slow to import, and only the router needs the channel.
"""

from __future__ import annotations

from typing import Any

from bridge.scenario.model import Origin, Scenario
from channel.link.radio import Radio
from channel.presets import at_origin, load_radio, radio_from_mapping


def radio_of(scenario: Scenario) -> Radio:
    """The radio that a scenario names or spells out.

    Raises:
        PresetError: there is no such preset, or a key or value is wrong.
    """
    return radio_from(scenario.radio, scenario.origin)


def radio_from(setting: str | dict[str, Any], origin: Origin) -> Radio:
    """The radio of a preset's name, a file or a mapping.

    Args:
        setting: as in the scenario.
        origin: where the fleet's frame has its zero, for terrain.

    Raises:
        PresetError: there is no such preset, or a key or value is wrong.
    """
    config = load_radio(setting) if isinstance(setting, str) else radio_from_mapping(setting)
    return Radio(at_origin(config, origin.lat_deg, origin.lon_deg, origin.alt_amsl_m))


def radios_of(scenario: Scenario) -> dict[str, Radio]:
    """The radio of each station: its own, or the scenario's.

    Raises:
        PresetError: there is no such preset, or a key or value is wrong.
    """
    common = radio_of(scenario)
    own = {
        node.node: radio_from(node.radio, scenario.origin)
        for node in scenario.nodes
        if node.radio is not None
    }
    return {node: own.get(node, common) for node in scenario.stations}
