"""Nodes that listen before they talk, and hear interferers or emitters that never pause."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping

import numpy as np

from bridge.bus.keys import MAIN
from bridge.scenario.model import Scenario
from bridge.scenario.resolve.radio import radios_of
from bridge.scenario.resolve.sensing import emitters_of
from channel.access.settings.base import Locking
from channel.link.radio import Radio
from channel.numbers.units import db_from_ratio, ratio_from_db
from channel.own.methods import OwnModelError
from channel.validity import OutsideValidityError
from lostlink.plan.start_positions import Places, path_to, places_at_start
from lostlink.reading.named import named


def held_back(scenario: Scenario, networks: Collection[str] | None = None) -> Iterator[str]:
    """Warnings: at the first places of a network's nodes, by the mean power of what is always on.

    Args:
        scenario: of the run.
        networks: those to look at; all unless given.
    """
    places = places_at_start(scenario)
    grounds = {node.node for node in scenario.ground}
    for network in scenario.network_names if networks is None else networks:
        radios = radios_of(scenario, emitters_of(scenario), network)
        medium = next(iter(radios.values())).config.medium
        if not isinstance(medium, Locking) or not medium.listens_first:
            continue
        level_dbm = medium.senses_from_dbm(min(radio.noise_floor_dbm for radio in radios.values()))
        taken_dbm = {
            node: _taken_dbm(radio, node, places, is_base=node in grounds)
            for node, radio in radios.items()
            if radio.sources
        }
        held = {node: power_dbm for node, power_dbm in taken_dbm.items() if power_dbm >= level_dbm}
        if held:
            name = "" if network == MAIN else f"{network}: "
            yield f"{name}{_in_words(held, level_dbm)}"


def _in_words(held: Mapping[str, float], level_dbm: float) -> str:
    nodes = named([f"{node} ({power_dbm:.4g} dBm)" for node, power_dbm in held.items()])
    return (
        f"at the first place of node {nodes} interferers and emitters that never pause are a carrier "
        f"(from {level_dbm:.4g} dBm on: medium.energy_dbm): a node there waits, and transmits nothing"
    )


def _taken_dbm(radio: Radio, node: str, places: Places, *, is_base: bool) -> float:
    """What a node takes in of sources that are always on, less its noise floor; nothing where a law refuses it."""
    path = path_to(radio, node, places, is_base=is_base)
    try:
        noise_dbm = radio.noise_dbm(path, tuple(each.duty >= 1.0 for each in radio.sources))
    except (OutsideValidityError, OwnModelError):
        return -np.inf  # a warning of its own
    power_mw = float(np.max(ratio_from_db(noise_dbm))) - float(ratio_from_db(radio.noise_floor_dbm))
    return float(db_from_ratio(power_mw)) if power_mw > 0.0 else -np.inf
