"""From what a scenario names to the object of the channel: the radio.

Apart from `resolve`, as the channel needs scipy, which is slow to import, and only the router needs the channel.
"""

from __future__ import annotations

from bridge.scenario.model import Scenario
from channel.link.radio import Radio
from channel.presets import load_radio, radio_from_mapping


def radio_of(scenario: Scenario) -> Radio:
    """The radio that a scenario names or spells out.

    Raises:
        PresetError: there is no such preset, or a key or value is wrong.
    """
    setting = scenario.radio
    return Radio(load_radio(setting) if isinstance(setting, str) else radio_from_mapping(setting))
