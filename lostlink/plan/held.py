"""Nodes that listen before they talk, and hear interferers or emitters that never pause."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from bridge.bus.keys import MAIN
from bridge.scenario.model import Scenario
from bridge.scenario.nodes import Aircraft, EmitterNode, GroundNode, Transceiver
from bridge.scenario.resolve.radio import radios_of
from bridge.scenario.resolve.sensing import emitters_of
from channel.access.settings.base import Locking
from channel.checks import FloatArray
from channel.link.radio import Radio
from channel.numbers.units import db_from_ratio, ratio_from_db

NAMED_MAX = 3
Places = Mapping[str, FloatArray]


def held_back(scenario: Scenario) -> Iterator[str]:
    """Warnings, by network: at the first places of its nodes, by the mean power of what is always on."""
    places = {node.node: _first_place_ned_m(node) for node in scenario.nodes}
    for network in scenario.network_names:
        radios = radios_of(scenario, emitters_of(scenario), network)
        floor_dbm = min(radio.noise_floor_dbm for radio in radios.values())
        held: dict[str, float] = {}
        for node, radio in radios.items():
            medium = radio.config.medium
            if isinstance(medium, Locking) and medium.listens_first and radio.sources:
                power_dbm, level_dbm = _taken_dbm(radio, node, places), medium.senses_from_dbm(floor_dbm)
                if power_dbm >= level_dbm:
                    held[node] = power_dbm
        if held:
            name = "" if network == MAIN else f"{network}: "
            yield f"{name}{_in_words(held, level_dbm)}"


def _in_words(held: Mapping[str, float], level_dbm: float) -> str:
    named = [f"{node} ({power_dbm:.4g} dBm)" for node, power_dbm in held.items()][:NAMED_MAX]
    more = f" and {len(held) - NAMED_MAX} more" if len(held) > NAMED_MAX else ""
    return (
        f"at the first place of node {', '.join(named)}{more} interferers and emitters that never pause are a carrier "
        f"(from {level_dbm:.4g} dBm on: medium.energy_dbm): a node there waits, and transmits nothing"
    )


def _taken_dbm(radio: Radio, node: str, places: Places) -> float:
    """What a node takes in of sources that are always on, less its noise floor."""
    place = places[node][np.newaxis]
    emitters = {each.name: places[each.name] for each in radio.emitters}
    path = radio.path_of(place, place, np.zeros(1))._replace(emitters_ned_m=emitters)
    noise_dbm = radio.noise_dbm(path, tuple(each.duty >= 1.0 for each in radio.sources))
    power_mw = float(np.max(ratio_from_db(noise_dbm))) - float(ratio_from_db(radio.noise_floor_dbm))
    return float(db_from_ratio(power_mw)) if power_mw > 0.0 else -np.inf


def _first_place_ned_m(node: Transceiver | EmitterNode) -> FloatArray:
    if isinstance(node, Aircraft):
        return np.array([node.home.north_m, node.home.east_m, 0.0])
    return _on_the_ground(node)


def _on_the_ground(node: GroundNode | EmitterNode) -> FloatArray:
    first = node.track[0] if node.track else node.place
    return np.array((0.0, 0.0, -2.0) if first is None else (first.north_m, first.east_m, -first.height_m))
