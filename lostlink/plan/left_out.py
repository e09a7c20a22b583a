"""What a run of a scenario does not model: what its numbers say nothing of."""

from __future__ import annotations

from collections.abc import Iterator

from bridge.scenario.agents import FreeAgent
from bridge.scenario.model import Scenario
from bridge.scenario.nodes import MAIN, AutopilotName
from bridge.scenario.resolve.radio import radios_of
from bridge.scenario.resolve.sensing import emitters_of
from channel.access.settings.base import Ideal
from channel.link.carrier import laws_off_carrier
from channel.link.radio import Radio
from channel.propagation.air_to_ground import RmaAv, UmaAv
from channel.variant import name_of
from fdm.air.wind import WindConfig
from fdm.model.sensor_noise import SensorNoise

ALWAYS = ("frequency selectivity, Doppler shift within a packet, several antennas",)
"""Of every radio."""
IDEAL = (
    "airtime: a packet takes no time on the air and is delivered at the next tick, whatever its length",
    "collisions: packets of the fleet do not disturb each other, however many there are at once",
    "medium access: no carrier sense, waiting, queues, acknowledgements or retries; a node sends and receives at once",
)
"""Of radios whose medium is ideal."""
BY_MEDIUM = {
    "airtime": "carrier sense: a node transmits whatever it hears; nothing is acknowledged or tried again",
    "tdma": "access beyond the slots: nothing is acknowledged or tried again; clocks agree",
    "csma": "access points, association, rate adaptation, aggregation, power save: stations have one rate",
    "delay": "contention: nodes do not disturb each other; delays and outages are a distribution, whoever sends",
    "elrs": "contention: pairs do not disturb each other; the search for a transmitter's mode",
    "sik": "other users of the hopping channels than the run's networks; multipoint firmware",
}
BY_ROUTING = {
    "flood": "routing by what nodes hear: nobody holds a packet back that others have handed on already",
    "static": "routing: nobody notices that a next node is gone; what is for all is not handed on",
    "mesh": "of batman-adv: aggregation of messages, translation tables, fragments, several interfaces, multicast",
}


def left_out(scenario: Scenario, radio: Radio, wind: WindConfig) -> list[str]:
    """A line for each thing that is not modelled in this scenario.

    Args:
        scenario: what is to be flown.
        radio: that of all nodes on `main`.
        wind: the wind that is flown in.
    """
    common = [*_of_network(scenario, radio), *_of_others(scenario, radio)]
    own = [
        f"on {name}: {line}"
        for name in scenario.network_names
        if name != MAIN
        for line in _of_network(scenario, next(iter(radios_of(scenario, network=name).values())))
        if line not in common
    ]
    return [*common, *own, *_of_flight(scenario, wind)]


def _of_network(scenario: Scenario, radio: Radio) -> Iterator[str]:
    yield from _of_medium(radio)
    yield from _of_routing(radio)
    yield from ALWAYS
    yield from _of_radio(radio)
    yield from _of_roles(scenario, radio)


def _of_routing(radio: Radio) -> Iterator[str]:
    told = BY_ROUTING.get(name_of(radio.config.routing))
    if told is not None:
        yield told


def _of_medium(radio: Radio) -> Iterator[str]:
    medium = radio.config.medium
    if isinstance(medium, Ideal):
        yield from IDEAL
    elif getattr(medium, "model", "") in BY_MEDIUM:
        yield BY_MEDIUM[medium.model]


def _of_radio(radio: Radio) -> Iterator[str]:
    config = radio.config
    for name, what in (
        ("shadowing", "shadowing: every place at one distance is alike"),
        ("fading", "fading: the received power does not vary from packet to packet"),
        ("atmosphere", "gases and rain"),
    ):
        if getattr(getattr(config, name), "model", "") == "none":
            yield what
    if getattr(config.propagation, "model", "") not in {"terrain", "gain-map"}:
        horizon = "" if config.earth_radius_factor is None else " but the horizon"
        yield f"terrain and buildings: nothing stands between the nodes{horizon}"
    for law in laws_off_carrier(config):
        if law.outside == "clamp":
            yield f"{law.key} at its frequency: {law.told}; it counts the nearest inside ({law.key}.outside: clamp)"
    if getattr(config.length, "model", "") == "fixed":
        yield f"the packets' own lengths: all count as {int(radio.length_bytes(0))} bytes"


def _of_roles(scenario: Scenario, radio: Radio) -> Iterator[str]:
    """What a law for a base and a UA makes of other links, and of heights that it does not have."""
    law = radio.config.propagation
    if not isinstance(law, RmaAv | UmaAv):
        return
    for what, nodes in (("UA", scenario.ua), ("ground nodes", scenario.ground)):
        if len(nodes) > 1:
            yield f"links between {what}: {law.model} has none; the lower end of such a link counts as its base"
    least_m, most_m = law.heights_m
    meant = {"clamp": "count as at the nearest of these", "warn": "get what its formulas give"}
    refused = "end the run, and UA take off from the ground; `outside: clamp` counts the nearest height"
    yield f"UA below {least_m:g} or above {most_m:g} m: by {law.model} they {meant.get(law.outside, refused)}"


def _of_others(scenario: Scenario, radio: Radio) -> Iterator[str]:
    if not radio.config.interference.interferers and not emitters_of(scenario):
        yield "interference by others"


_REAL = "autopilot: ardupilot or px4 flies real ones"


def _flown_by(scenario: Scenario, *kinds: AutopilotName) -> str:
    """Of which UA a line is, where it is not of all; "" if it is."""
    found = [ua.node for ua in scenario.ua if scenario.autopilot_of(ua) in kinds]
    return "" if len(found) == len(scenario.ua) else f"of UA {', '.join(found)}: "


def _of_flight(scenario: Scenario, wind: WindConfig) -> Iterator[str]:
    if wind.model_dump(exclude_defaults=True, exclude={"description"}) == {}:
        yield "wind: the air is still"
    if "standin" in scenario.autopilots:
        yield f"{_flown_by(scenario, 'standin')}real autopilots: a stand-in flies (docs/reference/standin.md); {_REAL}"
    noisy = any(ua.sensor_noise for ua in scenario.ua) or scenario.fdm.sensor_noise != SensorNoise()
    others = scenario.autopilots - {"px4"}
    if others and not noisy:
        yield f"{_flown_by(scenario, *others)}errors of sensors beyond those of the autopilot's simulation"
    if "px4" in scenario.autopilots:
        biases = "" if noisy else "biases, "
        yield f"{_flown_by(scenario, 'px4')}errors of sensors beyond white noise (fdm.px4): {biases}drifts, delays"
    if any(isinstance(node.agent, FreeAgent) for node in scenario.transceivers):
        yield "the time that programs beside the run take: the clock does not wait for them"
