"""Where a run would use laws of its radios beyond what they were made for, as far as that is known before it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import combinations

from bridge.scenario.model import Scenario
from bridge.scenario.nodes import MAIN
from bridge.scenario.resolve.radio import radios_of
from channel.link.carrier import laws_off_carrier
from channel.link.radio import Radio
from channel.validity import OutsideValidityError
from lostlink.plan.places import start_ned_m


def beyond_validity(scenario: Scenario, main: Mapping[str, Radio]) -> Iterator[str]:
    """Warnings: laws that are not made for their carrier, and places at the start that end a run.

    Args:
        scenario: what is to be flown.
        main: radios of each node on the network of that name.
    """
    told: dict[str, None] = {}
    for network in scenario.network_names:
        radios = main if network == MAIN else radios_of(scenario, network=network)
        for radio in radios.values():
            for law in laws_off_carrier(radio.config):
                if law.outside == "warn":  # with clamp it is among what is not modelled
                    does = f"it goes on with its formula ({law.key}.outside: warn)"
                    told[f"radio of network {network}: {law.told}; {does}"] = None
        for line in _refused_links(scenario, network, radios):
            told[line] = None
    yield from told


def _refused_links(scenario: Scenario, network: str, radios: Mapping[str, Radio]) -> Iterator[str]:
    """The first link of each radio that its law refuses where both ends stand when the run begins."""
    places = {node.node: start_ned_m(node) for node in scenario.transceivers if node.node in radios}
    told: set[int] = set()
    for here, there in combinations(places, 2):
        radio = radios[here]
        # a law for a base and a UA has its own lines (`left_out`)
        if (
            id(radio) in told
            or getattr(radio.config.propagation, "outside", "") != "refuse"
            or radio.needs_roles
        ):
            continue
        try:
            radio.loss_db(radio.path(position_tx_ned_m=places[here], position_rx_ned_m=places[there]))
        except OutsideValidityError as error:
            told.add(id(radio))
            ends = f"between nodes {here} and {there}, where they are at the start"
            yield f"radio of network {network}: {ends}, {error}: the first packet between them ends the run"
