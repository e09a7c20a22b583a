"""What the agents of a scenario give to the radio, as far as it is known before they run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from bridge.bus.messages import AircraftState, DataPackage, Header, Waypoint, encode
from bridge.scenario.agents import FreeAgent, OutAndBackAgent, OwnAgent, StillAgent
from bridge.scenario.model import Scenario
from bridge.scenario.nodes import Aircraft, GroundNode
from channel.link.radio import Radio

ON_GROUND = ("STABILIZE", "CUSTOM_MODE_ENABLED|STABILIZE_ENABLED|MANUAL_INPUT_ENABLED")
IN_FLIGHT = (
    "GUIDED",
    "CUSTOM_MODE_ENABLED|GUIDED_ENABLED|STABILIZE_ENABLED|MANUAL_INPUT_ENABLED|SAFETY_ARMED",
)
"""Mode and flags of a copter's state: the texts are as long as most of them are."""
WAYPOINTS = 2
"""That an out-and-back flight transmits."""


@dataclass(frozen=True, slots=True)
class NodeLoad:
    """What one node offers.

    Attributes:
        node: its id.
        packets_per_s: of sim time; None if only the node's program knows.
        payload_bytes: of each packet.
        on_air_bits_per_s: with what the radio adds to a payload; None as above.
        airtime_share: of the radio's time, at its bit rate.
        is_guess: whether code that we have not run may send more, less, or something else.
    """

    node: str
    packets_per_s: float | None
    payload_bytes: int | None
    on_air_bits_per_s: float | None
    airtime_share: float
    is_guess: bool


@dataclass(frozen=True, slots=True)
class OfferedLoad:
    """What all nodes offer together, on the one frequency that they share.

    Attributes:
        nodes: of each.
        packets_per_s, on_air_bits_per_s: sums of what is known.
        airtime_share: sum; above 1 no real channel could carry it.
        is_guess: whether any of it is.
    """

    nodes: tuple[NodeLoad, ...]
    packets_per_s: float
    on_air_bits_per_s: float
    airtime_share: float
    is_guess: bool


def offered_load(scenario: Scenario, radios: Mapping[str, Radio]) -> OfferedLoad:
    """What the nodes of a scenario offer.

    Args:
        scenario: what is to be flown.
        radios: of each node.
    """
    nodes = tuple(_load_of(scenario, node, radios[node.node]) for node in scenario.transceivers)
    return OfferedLoad(
        nodes,
        sum(node.packets_per_s or 0.0 for node in nodes),
        sum(node.on_air_bits_per_s or 0.0 for node in nodes),
        sum(node.airtime_share for node in nodes),
        any(node.is_guess for node in nodes),
    )


def _load_of(scenario: Scenario, node: Aircraft | GroundNode, radio: Radio) -> NodeLoad:
    if isinstance(node.agent, FreeAgent):
        return NodeLoad(node.node, None, None, None, 0.0, is_guess=True)
    rate_hz = scenario.tick_rate_hz / scenario.transmit.every_ticks
    payload = package_bytes(node)
    bits_per_s = 8.0 * rate_hz * max(payload, int(radio.length_bytes(payload)))  # a fixed length may be less
    share = bits_per_s / radio.config.bit_rate_bps
    return NodeLoad(node.node, rate_hz, payload, bits_per_s, share, isinstance(node.agent, OwnAgent))


def package_bytes(node: Aircraft | GroundNode) -> int:
    """Length of the data package that a node's agent transmits: in flight, if that is what it is for."""
    waypoints = (Waypoint(),) * (WAYPOINTS if isinstance(node.agent, OutAndBackAgent) else 0)
    mode, base_mode = ("", "")
    if isinstance(node, Aircraft):
        mode, base_mode = ON_GROUND if isinstance(node.agent, StillAgent) else IN_FLIGHT
    state = AircraftState(Header.at(0, node.node), mode=mode, base_mode=base_mode)
    return len(encode(DataPackage(Header.at(0, node.node), 0, state, waypoints, ())))
