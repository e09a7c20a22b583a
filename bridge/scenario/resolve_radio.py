"""From what a scenario names to the object of the channel: the radio.

Apart from `resolve`, as the channel needs scipy, which is slow to import, and only the router needs the channel.
"""

from __future__ import annotations

from typing import Any

from bridge.scenario.model import Scenario
from channel.link.radio import Radio
from channel.presets import load_radio, radio_from_mapping


def radio_of(scenario: Scenario) -> Radio:
    """The radio that a scenario names or spells out.

    Raises:
        PresetError: there is no such preset, or a key or value is wrong.
    """
    return radio_from(scenario.radio)


def radio_from(setting: str | dict[str, Any]) -> Radio:
    """The radio of a preset's name, a file or a mapping.

    Raises:
        PresetError: there is no such preset, or a key or value is wrong.
    """
    return Radio(load_radio(setting) if isinstance(setting, str) else radio_from_mapping(setting))


def radios_of(scenario: Scenario) -> dict[str, Radio]:
    """The radio of each station: its own, or the scenario's.

    Raises:
        PresetError: there is no such preset, or a key or value is wrong.
    """
    common = radio_of(scenario)
    return {node.node: common if node.radio is None else radio_from(node.radio) for node in scenario.nodes}
