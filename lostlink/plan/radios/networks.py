"""The radio networks of a run, their modems, and which of them disturb which."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import permutations

from bridge.modem.settings import has_transmitter, modem_of
from bridge.record.inputs.radio_switches import switches_of
from bridge.scenario.model import Scenario
from bridge.scenario.modems import GroundModem, addressee_of
from bridge.scenario.nodes import MAIN
from bridge.scenario.resolve.channel import channel_of
from bridge.scenario.resolve.radio import radios_of
from channel.access.elrs_modes import ELRS_MODES
from channel.access.settings.csma import CsmaMedium
from channel.access.settings.elrs import ElrsMedium
from channel.access.settings.medium import MediumSettings
from channel.access.settings.sik import SikMedium
from channel.network.crossing import Crossing
from channel.phy.error_model import Lossless
from channel.variant import name_of
from lostlink.plan.radios.reach import Reach, reach_of

RATES_APART = 1.01
"""Factor between two rates that are not the same rate rounded."""


@dataclass(frozen=True, slots=True)
class NetworkPlan:
    """A radio network.

    Attributes:
        name, radio, medium, frequency_hz: as in the scenario.
        nodes: ids of its nodes.
        disturbed_by: networks whose frames reach its receivers.
        modems: by node, what is at the serial side of its radio.
        reach: how far packets of the radio's nominal length get; None of `main`, whose plan has that of data packages.
    """

    name: str
    radio: str
    medium: str
    frequency_hz: float
    nodes: tuple[str, ...]
    disturbed_by: tuple[str, ...]
    modems: dict[str, str]
    reach: Reach | None


def networks_of(scenario: Scenario) -> tuple[NetworkPlan, ...]:
    """The networks of a scenario, whose names are known to be right."""
    disturbed = _disturbed(scenario)
    return tuple(_network(scenario, name, disturbed[name]) for name in scenario.network_names)


def _network(scenario: Scenario, name: str, disturbed_by: list[str]) -> NetworkPlan:
    radios = radios_of(scenario, network=name)
    radio = next(iter(radios.values()))
    config = radio.config
    return NetworkPlan(
        name,
        config.name,
        name_of(config.medium),
        config.frequency_hz,
        tuple(radios),
        tuple(disturbed_by),
        dict(_modems(scenario, name, config.medium, tuple(radios))),
        None if name == MAIN else reach_of(radio, config.nominal_payload_bytes),
    )


def _modems(
    scenario: Scenario, network: str, medium: MediumSettings, nodes: tuple[str, ...]
) -> Iterator[tuple[str, str]]:
    modems = scenario.modems_on(network)
    for node, modem in modems.items():
        found = modem_of(medium, modem.baud, is_transmitter=has_transmitter(medium, nodes, node))
        line = f"{found.baud} baud" if found.baud else "no serial line: bytes pass at once"
        at = (
            f"served at {', '.join(modem.serve)}"
            if isinstance(modem, GroundModem)
            else f"SERIAL{modem.serial}"
        )
        yield node, f"{at}, {line}, for {addressee_of(modems, node) or 'all'}"


def _disturbed(scenario: Scenario) -> dict[str, list[str]]:
    """By network, those whose frames reach its receivers."""
    disturbed: dict[str, list[str]] = {name: [] for name in scenario.network_names}
    if disturbed.keys() <= {MAIN}:
        return disturbed
    channels = [channel_of(scenario, switches_of(scenario, network=name), name) for name in disturbed]
    sides = [neighbour.side for each in channels if (neighbour := each.neighbour) is not None]
    for source, target in permutations(sides, 2):
        if Crossing(source, target).carries:
            disturbed[target.name].append(source.name)
    return disturbed


def rates_that_differ(scenario: Scenario) -> Iterator[str]:
    """Tell of media whose frames last as long as at a rate of their own, and have the errors of another."""
    for name in scenario.network_names:
        # with such a medium all its radios have one rate (`rate_mistake`)
        config = next(iter(radios_of(scenario, network=name).values())).config
        if isinstance(config.error, Lossless):  # errors of no rate; tables and thresholds are those of one
            continue
        key, rate_bps = _own_rate(config.medium)
        if rate_bps is not None and not 1.0 / RATES_APART < rate_bps / config.bit_rate_bps < RATES_APART:
            yield (
                f"radio of network {name}: frames last as long as at {rate_bps / 1e6:g} Mb/s (medium.{key}), and "
                f"have the errors of {config.bit_rate_bps / 1e6:g} Mb/s (bit_rate_bps)"
            )
        is_coded, coding = getattr(config.medium, "ecc", None), getattr(config.error, "coding", None)
        if is_coded is not None and coding is not None and is_coded != (coding != "none"):
            yield (
                f"radio of network {name}: frames last as long as with ecc {str(is_coded).lower()} (medium.ecc), and "
                f"have the errors of coding {coding} (error.coding)"
            )


def _own_rate(medium: MediumSettings) -> tuple[str, float | None]:
    """The key of a medium's own bit rate, and that; None if frames last by the radio's, or by slots."""
    if isinstance(medium, CsmaMedium):
        return "rate_mbps", medium.rate_mbps * 1e6
    if isinstance(medium, SikMedium):
        return "air_kbps", medium.air_kbps * 1e3
    if isinstance(medium, ElrsMedium):
        return "mode", ELRS_MODES[medium.mode].bit_rate_bps
    return "bit_rate_bps", getattr(medium, "bit_rate_bps", None)
