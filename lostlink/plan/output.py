"""What `lostlink check` says of a plan."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterator
from typing import Any

import yaml

from lostlink.plan.load import OfferedLoad
from lostlink.plan.plan import NodePlan, RunPlan
from lostlink.plan.radios.reach import FARTHEST_M, Reach
from lostlink.reading.named import named

KINDS = {"ground": "on the ground", "emitter": "an emitter"}
NODES_SHOWN_MAX = 20


def lines_of(plan: RunPlan) -> Iterator[str]:
    """All of a plan, line by line."""
    yield f"{plan.scenario}: {plan.description}".rstrip(": ")
    yield (
        f"  at most {plan.duration_s:g} s of sim time, {plan.tick_rate_hz} ticks per second, speed {plan.speed}, "
        f"seed {plan.seed}, autopilot {plan.autopilot}, wind {_in_a_line(plan.wind)}"
    )
    yield from _section(f"Nodes ({len(plan.nodes)})", [_node(node) for node in plan.nodes])
    groups = [f"{name}: {', '.join(members)}" for name, members in plan.groups.items()]
    yield from _section(f"Groups of addressees ({len(groups)})", groups)
    yield from _section("Radio outages", [each.line() for each in plan.outages])
    yield from _section("Partitions", [each.line() for each in plan.partitions])
    processes = [f"{name}: {named(nodes)}" if nodes else name for name, nodes in plan.processes.items()]
    yield from _section(f"Processes ({plan.joined})", processes)
    yield from _section(f"Ports ({len(plan.ports)})", list(plan.ports))
    outputs = [f"MAVLink of UA {node} to {', '.join(places)}" for node, places in plan.udp_outputs.items()]
    yield from _section("UDP outputs", outputs)
    yield from _section("Radio", list(_radio(plan)))
    networks = list(_networks(plan))
    yield from _section(f"Networks ({len(plan.networks)})", networks)
    yield from _section("Who hears whom", [line for each in plan.links for line in each.lines()])
    yield from _section("Offered load", list(_load(plan)))
    yield from _section("Expectations", list(plan.expectations))
    yield from _section("Not modelled", list(plan.not_modelled))
    yield from _section("Warnings", list(plan.warnings))


def _in_a_line(wind: str | dict[str, Any]) -> str:
    """A wind as a scenario names it: one that is spelt out as YAML."""
    if isinstance(wind, str):
        return wind
    return yaml.safe_dump(wind, default_flow_style=True, sort_keys=False, width=math.inf).strip()


def _section(title: str, lines: list[str]) -> Iterator[str]:
    if lines:
        yield from ("", title)
        shown = lines if len(lines) <= NODES_SHOWN_MAX else lines[: NODES_SHOWN_MAX - 1]
        yield from (f"  {line}" for line in shown)
        if len(shown) < len(lines):
            yield f"  and {len(lines) - len(shown)} more (--json has all)"


def _node(node: NodePlan) -> str:
    north_m, east_m, up_m = node.place_m
    what = f"UA, {node.airframe} ({node.vehicle})" if node.airframe else KINDS[node.kind]
    height = "" if node.airframe else f", {up_m:g} m up"
    radio = f", radio {node.radio}" if node.radio else ""
    agent = f"agent {node.agent}" if node.agent else "sends no packets"
    return f"{node.id}: {what} at {north_m:g} m N, {east_m:g} m E{height}, {agent}{radio}"


def _radio(plan: RunPlan) -> Iterator[str]:
    radio = plan.radio
    routing = "" if radio.routing == "none" else f", routing {radio.routing}"
    rate = f"{radio.bit_rate_bps:g} bit/s on air"
    yield f"{radio.name}: {radio.frequency_hz / 1e6:g} MHz, {rate}, medium {radio.medium}{routing}"
    yield ", ".join(f"{key} {name}" for key, name in radio.laws.items())
    if radio.reach.limit_m is None:
        yield "its reach depends on places, or its model refuses short distances: lostlink link shows one link"
        return
    for share, far in _shares(radio.reach, radio.reach.limit_m):
        yield f"{share} of data packages arrive up to {far}"
    if set(radio.reach.distance_m.values()) != {FARTHEST_M}:
        yield f"with both ends {radio.reach.height_m:g} m above the ground; lostlink link has other heights"
    for slot_rate, reach in radio.slot_reach.items():
        yield f"in slots of {slot_rate} bit/s {_far(reach, radio.reach.limit_m)}"
    if (preamble := radio.reach.preamble) is not None:
        level = f"lock on to no signal below {preamble.level_dbm:.4g} dBm (medium.preamble_dbm)"
        where = "anywhere" if preamble.distance_m is None else f"beyond {preamble.distance_m:g} m"
        far = _distance(preamble.erasure_m, radio.reach.limit_m)
        yield f"receivers {level}, which the mean power is {where}; by the error rate half would arrive up to {far}"


def _networks(plan: RunPlan) -> Iterator[str]:
    """The networks if there are several, and the modems at their radios."""
    for network in plan.networks:
        if len(plan.networks) > 1:
            what = f"{network.radio}, {network.frequency_hz / 1e6:g} MHz, medium {network.medium}"
            disturbed = f"; disturbed by {', '.join(network.disturbed_by)}" if network.disturbed_by else ""
            yield f"{network.name}: {what}, nodes {', '.join(network.nodes)}{disturbed}"
        if (reach := network.reach) is not None and reach.limit_m is not None:
            what = f"packets of {reach.payload_bytes} bytes"
            if set(reach.distance_m.values()) != {FARTHEST_M}:
                what += f" with both ends {reach.height_m:g} m above the ground"
            yield f"{network.name}, {what}: {_far(reach, reach.limit_m)}"
        for node, modem in network.modems.items():
            yield f"{network.name}, modem of node {node}: {modem}"


def _far(reach: Reach, limit_m: float) -> str:
    return ", ".join(f"{share} up to {far}" for share, far in _shares(reach, limit_m))


def _shares(reach: Reach, limit_m: float) -> Iterator[tuple[str, str]]:
    """Which share arrives how far; the first that arrives anywhere tells of those below."""
    for share, distance_m in reach.distance_m.items():
        yield f"{float(share):.0%}", _distance(distance_m, limit_m)
        if distance_m == limit_m == FARTHEST_M:
            return


def _distance(distance_m: float | None, limit_m: float) -> str:
    if distance_m is None:
        return "no distance"
    if distance_m < 0.99 * limit_m:
        return f"{distance_m:g} m"
    return (
        "any distance"
        if limit_m == FARTHEST_M
        else f"{limit_m:.3g} m at least: the model says nothing beyond"
    )


def _load(plan: RunPlan) -> Iterator[str]:
    load, guess = plan.load, "about " if plan.load.is_guess else ""
    yield f"all nodes: {guess}{load.packets_per_s:g} packets/s, {_over_capacity(load)}"
    if load.is_guess:
        yield "data packages only: what own agents and programs beside the run send besides is not known"
    kinds: dict[tuple[float | None, int | None, bool], list[str]] = defaultdict(list)
    for node in load.nodes:
        kinds[node.packets_per_s, node.payload_bytes, node.is_guess].append(node.node)
    for (rate_hz, payload, is_guess), nodes in kinds.items():
        who = f"node {nodes[0]}" if len(nodes) == 1 else f"{len(nodes)} nodes ({nodes[0]}, ...)"
        if rate_hz is None:
            yield f"{who}: not known: a program beside the run sends"
        else:
            own = ", unless its own agent sends otherwise" if is_guess else ""
            yield f"{who}: {rate_hz:g} packets/s of {payload} bytes{own}"


def _over_capacity(load: OfferedLoad) -> str:
    """The load as a share of what the medium carries."""
    if not load.takes_time:
        bits = f"{load.on_air_bits_per_s:.4g} bit/s on air"
        return f"{bits}, {load.airtime_share:.1%} of the radio's bit rate (medium ideal: nothing takes time)"
    bits = f"{load.payload_bits_per_s:.4g} bit/s of payload"
    if load.capacity_bps is None:
        return f"{bits}; the medium {load.medium} carries none of it"
    its, most = ("such", "") if load.is_shared else ("its", f"the busiest {load.shared_by} ")
    carried = f"{load.capacity_bps:.4g} bit/s that the medium {load.medium} carries of {its} packets"
    return f"{bits}, {most}{load.airtime_share:.1%} of the {carried}"
