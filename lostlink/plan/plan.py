"""The plan of a run: everything that is decided before it starts."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from bridge.fleet.hosts import host_groups, standin_groups
from bridge.fleet.how import calls_standins, how_joined, in_words
from bridge.fleet.preflight.ports import mistakes, ports_of
from bridge.scenario.agents import OwnAgent
from bridge.scenario.model import Scenario
from bridge.scenario.nodes import MAIN, Aircraft, EmitterNode, Transceiver
from bridge.scenario.resolve.channel import medium_settings
from bridge.scenario.resolve.flight import airframe_of, wind_of
from bridge.scenario.resolve.radio import radio_of, radios_of
from channel.access.settings.air_time import AirTimeMedium
from channel.access.settings.csma import CsmaMedium
from channel.access.settings.medium import MediumSettings
from channel.access.settings.tdma import TdmaMedium
from channel.link.radio import Radio
from channel.variant import name_of
from lostlink.plan.below_ground import below_ground
from lostlink.plan.late import too_late
from lostlink.plan.left_out import left_out
from lostlink.plan.load import NodeLoad, OfferedLoad, offered_load, without_messages
from lostlink.plan.radios.flow import overflows
from lostlink.plan.radios.held import held_back
from lostlink.plan.radios.links import RadioLinks, links_of, unlinked
from lostlink.plan.radios.networks import NetworkPlan, networks_of, rates_that_differ
from lostlink.plan.radios.outages import OutagePlan, outages_of
from lostlink.plan.radios.partitions import PartitionPlan, partition_plans
from lostlink.plan.radios.reach import Reach, reach_of
from lostlink.plan.radios.unheard import unheard
from lostlink.plan.start_positions import start_ned_m
from lostlink.plan.untaken import untaken
from lostlink.plan.validity import beyond_validity
from lostlink.reading.air.capacity import Capacity
from lostlink.reading.named import named

AIRTIME_MAX = 1.0


@dataclass(frozen=True, slots=True)
class NodePlan:
    """A node: its id, kind, place (north, east, up, m), airframe and vehicle if it flies, agent, own radio."""

    id: str
    kind: str
    place_m: tuple[float, float, float]
    airframe: str | None
    vehicle: str | None
    agent: str | None
    radio: str | None


@dataclass(frozen=True, slots=True)
class RadioPlan:
    """The radio of all nodes, its medium, and how far it gets a data package.

    Attributes:
        name, medium, routing: names.
        frequency_hz, bit_rate_bps: of the radio.
        reach: at this rate.
        laws: what each of its models is called, by key, but for those that do nothing.
        slot_reach: of slots that have another, by their rate, where it is another reach.
    """

    name: str
    medium: str
    frequency_hz: float
    bit_rate_bps: float
    reach: Reach
    slot_reach: dict[str, Reach]
    routing: str
    laws: dict[str, str]


@dataclass(frozen=True, slots=True)
class RunPlan:
    """A run to be.

    Attributes:
        scenario, description, seed, autopilot, speed, duration_s, tick_rate_hz, wind: as in the scenario.
        nodes: all of them.
        groups: the members of each group of addressees.
        outages: when which of their radios are off.
        partitions: when which of them do not hear each other.
        joined: how its parts are joined, in words.
        processes: by name, the nodes that each has to do with; none named: all of them.
        ports: that the run listens on.
        udp_outputs: by UA, where its MAVLink is sent.
        radio: of all nodes.
        networks: all radio networks, with their modems.
        links: of each network whose radios have links, who hears whom.
        load: what they offer to it.
        expectations: names and bounds.
        warnings: what is likely not meant.
        not_modelled: what the run says nothing of.
    """

    scenario: str
    description: str
    seed: int
    autopilot: str
    speed: float | str
    duration_s: float
    tick_rate_hz: int
    wind: str | dict[str, Any]
    nodes: tuple[NodePlan, ...]
    groups: dict[str, tuple[str, ...]]
    outages: tuple[OutagePlan, ...]
    partitions: tuple[PartitionPlan, ...]
    joined: str
    processes: dict[str, tuple[str, ...]]
    ports: tuple[str, ...]
    udp_outputs: dict[str, tuple[str, ...]]
    radio: RadioPlan
    networks: tuple[NetworkPlan, ...]
    links: tuple[RadioLinks, ...]
    load: OfferedLoad
    expectations: tuple[str, ...]
    warnings: tuple[str, ...]
    not_modelled: tuple[str, ...]


def plan_of(scenario: Scenario) -> RunPlan:
    """The plan of a scenario, whose names are known to be right."""
    on = {network: radios_of(scenario, network=network) for network in scenario.network_names}
    common, radios = radio_of(scenario), on[MAIN]
    load = offered_load(scenario, radios)
    payload = max((node.payload_bytes for node in load.nodes if node.payload_bytes), default=0)
    config, reach = common.config, reach_of(common, payload)
    rates_bps = config.medium.rates_bps if isinstance(config.medium, TdmaMedium) else ()
    of_slots = {f"{rate_bps:g}": reach_of(common.at_bit_rate(rate_bps), payload) for rate_bps in rates_bps}
    links = tuple(links_of(on))
    missing = [line for each in links for line in unlinked(scenario, each)]
    return RunPlan(
        scenario.name,
        scenario.description,
        scenario.seed,
        scenario.autopilots_in_words,
        scenario.speed,
        scenario.duration_s,
        scenario.tick_rate_hz,
        scenario.wind,
        tuple(_node(node, radios) for node in scenario.nodes),
        scenario.groups_on(MAIN),
        outages_of(scenario),
        partition_plans(scenario),
        in_words(scenario),
        _processes(scenario),
        tuple(str(use) for use in ports_of(scenario)),
        {ua.node: places for ua in scenario.ua if (places := scenario.udp_outputs(ua))},
        RadioPlan(
            config.name,
            load.medium,
            config.frequency_hz,
            config.bit_rate_bps,
            reach,
            {rate: found for rate, found in of_slots.items() if found != reach},
            name_of(config.routing),
            config.laws,
        ),
        networks_of(scenario),
        links,
        load,
        tuple(f"{each.title}: {each.wanted}" for each in scenario.expectations),
        (
            *_warnings(load, radios),
            *_bursts(load, medium_settings(radios), scenario.transmit.every_ticks),
            *missing,
            *beyond_validity(scenario, on),
            *below_ground(scenario, on),
            *overflows(scenario),
            *rates_that_differ(scenario),
            *too_late(scenario),
            *held_back(scenario),
            *unheard(scenario),
            *untaken(scenario),
            *_at_one_home(scenario),
            *_at_one_port(scenario),
        ),
        tuple(left_out(scenario, common, wind_of(scenario))),
    )


def _node(node: Transceiver | EmitterNode, radios: dict[str, Radio]) -> NodePlan:
    north_m, east_m, down_m = start_ned_m(node)
    place = north_m, east_m, 0.0 - down_m
    if isinstance(node, EmitterNode):
        return NodePlan(node.node, node.kind, place, None, None, None, None)
    agent = node.agent.class_ if isinstance(node.agent, OwnAgent) else node.agent.type
    radio = None if node.radio is None else radios[node.node].config.name
    if isinstance(node, Aircraft):
        airframe = airframe_of(node)
        return NodePlan(node.node, node.kind, place, airframe.name, airframe.vehicle, agent, radio)
    return NodePlan(node.node, node.kind, place, None, None, agent, radio)


def _processes(scenario: Scenario) -> dict[str, tuple[str, ...]]:
    found: dict[str, tuple[str, ...]] = {"fleet": ()}
    if how_joined(scenario) == "many":
        found = {"router": (), "physics": (), **host_groups(scenario)}
    if not calls_standins(scenario):
        found |= {f"autopilots-{index}": group for index, group in enumerate(standin_groups(scenario))}
    real = [ua.node for ua in scenario.ua if scenario.autopilot_of(ua) in ("ardupilot", "px4")]
    return found | {f"autopilot-{node}": (node,) for node in real}


def _warnings(load: OfferedLoad, radios: dict[str, Radio]) -> list[str]:
    if load.airtime_share > AIRTIME_MAX:
        lines = [_overload(load) + _unless(load.nodes)]
    else:
        lines = list(_overload_by_copies(load))
    capacity = Capacity(medium_settings(radios), radios)
    for node in load.nodes:
        if node.payload_bytes is None:
            continue
        mtu = radios[node.node].config.mtu_bytes
        if node.payload_bytes > mtu:
            lines.append(
                f"node {node.node}: its data package has {node.payload_bytes} bytes, more than mtu_bytes of its radio, "
                f"{mtu}: none would be delivered{_unless([node])}"
            )
        if not capacity.may_send(node.node):
            if not node.is_guess:  # an agent of one's own may be there to listen
                lines.append(
                    f"node {node.node}: it has no slot of the medium {load.medium}, and only listens: nothing that it "
                    "transmits would be delivered"
                )
        elif not node.airtime_share and node.payload_bytes <= mtu:
            lines.append(
                f"node {node.node}: its data package has {node.payload_bytes} bytes, for which the medium "
                f"{load.medium} has no room: none would be delivered{_unless([node])}"
            )
    lines += [
        f"node {node}: the medium {load.medium} has no room for the originator messages of its mesh (ogm_bytes, "
        "ogm_priority): others find no routes to it"
        for node in without_messages(radios, capacity)
    ]
    return lines


def _unless(nodes: Sequence[NodeLoad]) -> str:
    """What a warning depends on: code of the user's own was not run."""
    own = any(node.is_guess and node.packets_per_s is not None for node in nodes)
    return "; agents of your own may send otherwise" if own else ""


def _at_one_home(scenario: Scenario) -> Iterator[str]:
    """UA that start in each other's place."""
    homes: dict[tuple[float, float], list[str]] = defaultdict(list)
    for ua in scenario.ua:
        homes[ua.home.north_m, ua.home.east_m].append(ua.node)
    for (north_m, east_m), nodes in homes.items():
        if len(nodes) > 1:
            yield (
                f"UA {named(nodes)} have one home, {north_m:g} m N, {east_m:g} m E: they do not "
                "collide, and links between them have the radio's min_distance_m; give each its own, or the group a "
                "pattern (home: {line: {spacing_m: 10}})"
            )


def _at_one_port(scenario: Scenario) -> Iterator[str]:
    """Ports with which a run would not start."""
    lines = mistakes(ports_of(scenario))
    if lines:
        yield f"a run would not start: {named(lines, between='; ')}"


def _overload_by_copies(load: OfferedLoad) -> Iterator[str]:
    """What others hand on may be too much, where all hear each other."""
    share = load.copies * load.airtime_share
    if load.copies > 1 and share > AIRTIME_MAX:
        yield (
            f"each packet for all is transmitted up to {load.copies} times, as nodes hand packets on (routing): that "
            f"may be {share:.3g} times what the medium {load.medium} carries; raise transmit.every_ticks, or address "
            f"packets{_unless(load.nodes)}"
        )


def _bursts(load: OfferedLoad, medium: MediumSettings, every_ticks: int) -> Iterator[str]:
    """Nodes that are silent for ticks transmit at the same one, which may have no room for all of them."""
    share = load.airtime_share * every_ticks
    senders = [each for each in load.nodes if each.airtime_share > 0.0]
    contend = len(senders) > 1 and isinstance(medium, CsmaMedium | AirTimeMedium)
    if contend and load.airtime_share <= AIRTIME_MAX < share:
        yield (
            f"all nodes transmit at the same ticks (transmit.every_ticks: {every_ticks}), and offer {share:.3g} times "
            f"what the medium {load.medium} carries within one, though {load.airtime_share:.2g} over time: their "
            "packets wait for each other and collide as on a full air; lower tick_rate_hz and every_ticks alike, or "
            f"give each node ticks of its own (transmit_package){_unless(load.nodes)}"
        )


def _overload(load: OfferedLoad) -> str:
    """What happens to more than a medium carries, or would happen to more than the radio's bit rate does."""
    if not load.takes_time:
        return (
            f"the nodes offer {load.on_air_bits_per_s:.4g} bit/s, {load.airtime_share:.3g} times what the radio's bit "
            "rate carries: a real channel would lose most of it, and the medium ideal, which has no airtime, does not; "
            "raise transmit.every_ticks, take a faster radio, or give it a medium (radio.medium)"
        )
    who = {"all": "the nodes offer", "group": "the nodes of a group offer", "sender": "a node offers"}[
        load.shared_by
    ]
    if not load.has_turns:
        return (
            f"{who} {load.airtime_share:.3g} times what the medium {load.medium} carries: no node waits for others "
            "there, so that frames are on the air at once, and most are lost (collided, half_duplex); raise "
            "transmit.every_ticks, take a faster radio, or a medium on which nodes wait (csma, tdma)"
        )
    return (
        f"{who} {load.airtime_share:.3g} times what the medium {load.medium} carries: packets wait in queues until "
        "these are full, and what does not fit is lost (queue_full); raise transmit.every_ticks, or take a faster radio"
    )
