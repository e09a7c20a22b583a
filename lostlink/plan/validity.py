"""Where a run would use laws of radios and sensors beyond what they were made for, as far as that is known before."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import combinations

from bridge.scenario.model import Scenario
from bridge.scenario.resolve.radio import radios_of
from bridge.scenario.resolve.sensing import emitters_of, sensors_of
from channel.link.carrier import laws_off_carrier
from channel.link.radio import Radio
from channel.propagation.gain_map import GainMap
from channel.sensing.sensor import Sensor
from channel.validity import OutsideValidityError
from lostlink.plan.start_positions import path_to, places_at_start, start_ned_m

DOES = {"warn": "it goes on with its formula", "fallback": "its fallback has all links"}
"""What a law off its carrier does; with clamp it is among what is not modelled."""


def beyond_validity(scenario: Scenario, on: Mapping[str, Mapping[str, Radio]]) -> Iterator[str]:
    """Warnings: laws that are not made for their carrier, and places at the start that end a run.

    Args:
        scenario: what is to be flown.
        on: by network, the radio of each node on it.
    """
    told: dict[str, None] = {}
    for network, radios in on.items():
        for radio in radios.values():
            for law in laws_off_carrier(radio.config):
                if law.outside in DOES:
                    does = f"{DOES[law.outside]} ({law.key}.outside: {law.outside})"
                    told[f"radio of network {network}: {law.told}; {does}"] = None
        for line in (*_refused_links(scenario, network, radios), *_refused_sources(scenario, network)):
            told[line] = None
    yield from told
    yield from _refused_measurements(scenario)
    yield from _measured_by_fallback(scenario)


def _refused_links(scenario: Scenario, network: str, radios: Mapping[str, Radio]) -> Iterator[str]:
    """The first link of each radio that its law refuses where both ends stand when the run begins."""
    places = {node.node: start_ned_m(node) for node in scenario.transceivers if node.node in radios}
    told: set[int] = set()
    for here, there in combinations(places, 2):
        radio = radios[here]
        # a law for a base and a UA has its own lines (`left_out`)
        if id(radio) in told or not _refuses(radio.config.propagation) or radio.needs_roles:
            continue
        try:
            radio.budget.loss_db(radio.path(position_tx_ned_m=places[here], position_rx_ned_m=places[there]))
        except OutsideValidityError as error:
            told.add(id(radio))
            ends = f"between nodes {here} and {there}, where they are at the start"
            yield f"radio of network {network}: {ends}, {error}: the first packet between them ends the run"


def _refused_sources(scenario: Scenario, network: str) -> Iterator[str]:
    """The first way from an emitter or interferer to a radio that its law refuses when the run begins."""
    places, grounds = places_at_start(scenario), {node.node for node in scenario.ground}
    for node, radio in radios_of(scenario, emitters_of(scenario), network).items():
        if not _refuses(radio.config.propagation) or radio.needs_roles:  # see `_refused_links`
            continue
        path = path_to(radio, node, places, is_base=node in grounds)
        for number, source in enumerate(radio.sources):
            try:
                radio.budget.loss_db(radio.way_of_source(number, path))
            except OutsideValidityError as error:
                ends = f"from {source.name} to node {node}, where they are at the start"
                yield f"radio of network {network}: {ends}, {error}: the first packet to it ends the run"
                return


def _refused_measurements(scenario: Scenario) -> Iterator[str]:
    """The first emitter that the law of each sensor refuses, by its carrier or by the places when the run begins."""
    places, grounds = places_at_start(scenario), {node.node for node in scenario.ground}
    for node, config in sensors_of(scenario).items():
        sensor = Sensor(config, is_base=node in grounds)
        if not _refuses(config.radio.propagation, config.radio.atmosphere):
            continue
        for emitter in filter(lambda each: sensor.hears(each.frequency_hz), emitters_of(scenario)):
            try:
                sensor.expected_power_dbm(
                    places[emitter.name], places[node], power_dbm=0.0, frequency_hz=emitter.frequency_hz
                )
            except OutsideValidityError as error:
                ends = f"towards emitter {emitter.name}, where they are at the start"
                yield f"sensor of node {node}: {ends}, {error}: its first measurement ends the run"
                break


def _measured_by_fallback(scenario: Scenario) -> Iterator[str]:
    """The first emitter off the carrier of each sensor's map, where the map has a law to fall back on."""
    for node, config in sensors_of(scenario).items():
        sensor, law = Sensor(config), config.radio.propagation
        if not isinstance(law, GainMap) or law.outside != "fallback" or law.frequencies_hz is None:
            continue
        low_hz, high_hz = law.frequencies_hz
        for emitter in filter(lambda each: sensor.hears(each.frequency_hz), emitters_of(scenario)):
            if not low_hz <= emitter.frequency_hz <= high_hz:
                yield (
                    f"sensor of node {node}: emitter {emitter.name} is off the carrier of {law.file}: its fallback has "
                    "the way (propagation.outside: fallback)"
                )
                break


def _refuses(*laws: object) -> bool:
    """Whether one of these laws refuses what it was not made for."""
    return any(getattr(law, "outside", "") == "refuse" for law in laws)
