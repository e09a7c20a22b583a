"""What the agents of a scenario give to the radio, as far as it is known before they run."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from operator import itemgetter

from bridge.bus.messages import AircraftState, DataPackage, Header, Waypoint, encode
from bridge.scenario.agents import FreeAgent, OutAndBackAgent, OwnAgent, StillAgent
from bridge.scenario.model import Scenario
from bridge.scenario.nodes import Aircraft, GroundNode
from bridge.scenario.resolve.channel import medium_settings, routing_settings
from channel.draws import Draws
from channel.link.radio import Radio
from channel.routing.router import Hop
from channel.routing.settings import MeshRouting, router_of
from lostlink.reading.air.capacity import Capacity, SharedBy

ON_GROUND = ("STABILIZE", "CUSTOM_MODE_ENABLED|STABILIZE_ENABLED|MANUAL_INPUT_ENABLED")
IN_FLIGHT = (
    "GUIDED",
    "CUSTOM_MODE_ENABLED|GUIDED_ENABLED|STABILIZE_ENABLED|MANUAL_INPUT_ENABLED|SAFETY_ARMED",
)
"""Mode and flags of a copter's state: the texts are as long as most of them are."""
PACKAGE_PRIORITY = 0
"""Of data packages."""
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
        airtime_share: of the time that the medium has; with `ideal`, of the radio's at its bit rate. 0 if it has no
            room for such packets.
        own_share: of the part of that which one node alone can use; 0 where that is all.
        is_guess: whether code that we have not run may send more, less, or something else.
    """

    node: str
    packets_per_s: float | None
    payload_bytes: int | None
    on_air_bits_per_s: float | None
    airtime_share: float
    own_share: float
    is_guess: bool


@dataclass(frozen=True, slots=True)
class OfferedLoad:
    """What all nodes offer together, to the one network that they share.

    Attributes:
        nodes: of each.
        medium: its name.
        takes_time: whether packets take time on it.
        is_shared: whether all nodes share what it carries.
        shared_by: who does: all, or each group or sender has so much.
        has_turns: whether a node waits until others are done.
        packets_per_s, on_air_bits_per_s: sums of what is known.
        payload_bits_per_s: likewise, without what the radio adds.
        capacity_bps: payload that it carries in packets of these lengths; if not all share it, of the busiest group
            or sender. None if no packet is known that fits.
        airtime_share: sum, or if not all share it the greatest; above 1 it cannot carry it.
        is_guess: whether any of it is.
        copies: how often a packet for all is transmitted at most, where nodes hand packets on.
    """

    nodes: tuple[NodeLoad, ...]
    medium: str
    takes_time: bool
    is_shared: bool
    shared_by: SharedBy
    has_turns: bool
    packets_per_s: float
    on_air_bits_per_s: float
    payload_bits_per_s: float
    capacity_bps: float | None
    airtime_share: float
    is_guess: bool
    copies: int


def offered_load(scenario: Scenario, radios: Mapping[str, Radio]) -> OfferedLoad:
    """What the nodes of a scenario offer.

    Args:
        scenario: what is to be flown.
        radios: of each node.
    """
    capacity = Capacity(medium_settings(radios), radios)
    header_bytes = _routing_bytes(scenario, radios)
    nodes = tuple(_load_of(scenario, node, capacity, header_bytes) for node in scenario.transceivers)
    payloads = {node.node: 8.0 * (node.packets_per_s or 0.0) * (node.payload_bytes or 0) for node in nodes}
    shares = {node.node: node.airtime_share for node in nodes}
    shared_by = capacity.shared_by
    sums: list[tuple[float, float, SharedBy]] = [
        (
            sum(shares[node] for node in ids),
            sum(payloads[node] for node in ids if shares[node] > 0.0),
            shared_by,
        )
        for ids in capacity.sharers
    ]
    sums += [(node.own_share, payloads[node.node], "sender") for node in nodes]
    share, carried, shared_by = max(sums, default=(0.0, 0.0, shared_by), key=itemgetter(0, 1))
    return OfferedLoad(
        nodes,
        capacity.medium,
        capacity.takes_time,
        shared_by == "all",
        shared_by,
        capacity.has_turns,
        sum(node.packets_per_s or 0.0 for node in nodes),
        sum(node.on_air_bits_per_s or 0.0 for node in nodes),
        sum(payloads.values()),
        carried / share if share > 0.0 else None,
        share,
        any(node.is_guess for node in nodes),
        routing_settings(radios).copies(len(nodes)),
    )


def without_messages(radios: Mapping[str, Radio], capacity: Capacity) -> Iterator[str]:
    """Nodes of a mesh whose originator messages the medium has no room for: they are lost as they enter."""
    routing = routing_settings(radios)
    if isinstance(routing, MeshRouting):
        for node in radios:
            if not capacity.packet_s(node, routing.ogm_bytes, routing.ogm_priority):
                yield node


def _routing_bytes(scenario: Scenario, radios: Mapping[str, Radio]) -> int:
    """What routing makes a packet for all longer by."""
    places = {node: place for place, node in enumerate(radios)}
    router = router_of(routing_settings(radios), places, Draws(scenario.seed))
    return 0 if router is None else router.header_bytes(Hop(None))


def _load_of(
    scenario: Scenario, node: Aircraft | GroundNode, capacity: Capacity, header_bytes: int
) -> NodeLoad:
    if isinstance(node.agent, FreeAgent):
        return NodeLoad(node.node, None, None, None, 0.0, 0.0, is_guess=True)
    rate_hz = scenario.tick_rate_hz / scenario.transmit.every_ticks
    payload = package_bytes(node)
    counted = int(capacity.radios[node.node].length_bytes(payload))  # a fixed length may be less
    bits_per_s = 8.0 * rate_hz * max(payload, counted)
    share = rate_hz * capacity.packet_s(node.node, payload + header_bytes, PACKAGE_PRIORITY)
    own_share = rate_hz * capacity.own_s(node.node, payload + header_bytes)
    return NodeLoad(
        node.node, rate_hz, payload, bits_per_s, share, own_share, isinstance(node.agent, OwnAgent)
    )


def package_bytes(node: Aircraft | GroundNode) -> int:
    """Length of the data package that a node's agent transmits: in flight, if that is what it is for."""
    waypoints = (Waypoint(),) * (WAYPOINTS if isinstance(node.agent, OutAndBackAgent) else 0)
    mode, base_mode = ("", "")
    if isinstance(node, Aircraft):
        mode, base_mode = ON_GROUND if isinstance(node.agent, StillAgent) else IN_FLIGHT
    state = AircraftState(Header.at(0, node.node), mode=mode, base_mode=base_mode)
    return len(encode(DataPackage(Header.at(0, node.node), 0, state, waypoints, ())))
