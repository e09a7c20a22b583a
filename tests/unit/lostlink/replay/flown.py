"""Runs as a radio and physics leave them, made in an instant: nodes on rails, and the router's core at each tick."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from bridge.aircraft.body import StatePace
from bridge.bus.keys import Address
from bridge.bus.messages import AgentStatus, AircraftState, CommandGoal, Header, Quaternion, Truth, Vector3
from bridge.bus.radio_command import RADIO, RadioMistake, is_on
from bridge.bus.session import Stamp
from bridge.radio.ledger_file import LEDGER, Books, write_ledger
from bridge.radio.network_air import NetworkAir, Settled
from bridge.radio.ring import Ring
from bridge.radio.virtual_radio import VirtualRadio
from bridge.record import names
from bridge.record.inputs.file import InputWriter, RecordedInput
from bridge.record.inputs.radio_switches import switches_of
from bridge.record.logged import LoggedValue, encode_logged
from bridge.record.pack import pack_streams
from bridge.record.packets import encode_packet
from bridge.record.streams import StreamWriter
from bridge.record.tables.deliveries import DeliveryWriter
from bridge.record.tables.every import finish_tables
from bridge.record.tables.states import AGES, StateWriter
from bridge.record.tables.truth import TruthWriter
from bridge.run.directory import SUMMARY_FILE, RunDirectory
from bridge.scenario.file import parse_scenario
from bridge.scenario.model import Scenario
from bridge.scenario.resolve.channel import channels_of

TICK_NS = 50_000_000
NS_PER_S = 1_000_000_000
FRAME_NS = 1_250_000
Place = tuple[float, float, float]
Said = tuple[str, LoggedValue | AgentStatus]
"""Whose agent logged what."""


@dataclass(frozen=True)
class Sent:
    """A packet that a node gives to the radio at a tick."""

    node: str
    to: str = "all"
    length: int = 40
    sim_time_ns: int | None = None
    encoding: str = ""
    lost: int = 0
    """So many of the sender's packets before it never came."""
    radio: str = "main"


def scenario_of(
    radio: str, nodes: Sequence[str], seed: int = 1, extra: str = "", emitters: Sequence[str] = ()
) -> Scenario:
    """A scenario with nodes that stand still, which nobody flies; ``radio`` is YAML."""
    lines = "\n".join(
        f"  - {{id: {node}, agent: {{type: still}}}}"
        if node.isdecimal()
        else f"  - {{id: {node}, kind: ground, agent: {{type: still}}}}"
        for node in nodes
    )
    for emitter in emitters:
        lines += f"\n  - {{id: {emitter}, kind: emitter, frequency_hz: 433.92e+6, power_dbm: 18}}"
    text = (
        f"schema: 1\nname: made\nseed: {seed}\nduration_s: 600\n"
        f"origin: {{lat_deg: 40.0, lon_deg: -105.0, alt_amsl_m: 1600.0}}\nradio: {radio}\n{extra}nodes:\n{lines}\n"
    )
    return parse_scenario(text, "made.yaml")


def rails(node: int, sim_time_s: float) -> Place:
    """Ways on which links get long and short again, and cross."""
    turn = 0.11 * sim_time_s + 1.3 * node
    radius_m = 60.0 + 260.0 * node
    return (
        radius_m * math.cos(turn),
        radius_m * math.sin(0.7 * turn),
        -30.0 - 7.0 * node - 3.0 * math.sin(turn),
    )


def truth_at(node: str, place: int, sim_time_ns: int, scale: float = 1.0) -> Truth:
    """On the rails, in a bank that changes."""
    sim_time_s = sim_time_ns / NS_PER_S
    north_m, east_m, down_m = rails(place, sim_time_s)
    here = Vector3(scale * north_m, scale * east_m, down_m)
    half = 0.2 * math.sin(0.9 * sim_time_s + place)
    attitude = Quaternion(
        math.sin(half), 0.0, 0.3 * math.sin(half), math.sqrt(1.0 - 1.09 * math.sin(half) ** 2)
    )
    return Truth(Header.at(sim_time_ns, node), position_ned_m=here, attitude=attitude)


def state_at(node: str, sim_time_ns: int) -> AircraftState:
    """What a node's autopilot says; one on the ground has none, and tells no ages."""
    sim_time_s, mode = sim_time_ns / NS_PER_S, "GUIDED" if sim_time_ns < NS_PER_S else "RTL"
    header, height_m = Header.at(sim_time_ns, node), 10.0 + sim_time_s
    if not node.isdecimal():
        return AircraftState(header, altitude_rel_m=height_m, mode="GROUND")
    place, ages_s = Vector3(sim_time_s, 2.0, -height_m), tuple(0.05 * group for group in range(len(AGES)))
    return AircraftState(
        header,
        int(node) + 1,
        altitude_rel_m=height_m,
        position_ned_m=place,
        mode=mode,
        armed=True,
        age_s=ages_s,
    )


def everybody(node_ids: Sequence[str], length: int = 40) -> Callable[[int], list[Sent]]:
    """One packet of each node at each tick."""
    return lambda _: [Sent(node, length=length) for node in node_ids]


class Router:
    """The router of a run without its session: core, tables, streams and ledger."""

    def __init__(self, path: Path, scenario: Scenario) -> None:
        path.mkdir(parents=True)
        self.run = RunDirectory(path)
        self.run.write(scenario, "tcp/127.0.0.1:1")
        nodes = scenario.transceiver_ids
        switches = {name: switches_of(scenario, network=name) for name in scenario.network_names}
        self.channels = channels_of(scenario, switches)
        airs = [
            NetworkAir(each.medium, each.network, name=each.name, nodes=nodes, place=place)
            for place, each in enumerate(self.channels)
        ]
        self.core = VirtualRadio(airs, Ring(nodes, tick_period_ns=TICK_NS))
        self.nodes = nodes
        self.truth = TruthWriter(path, scenario.stations)
        self.rows = DeliveryWriter(path, nodes, self.core.words)
        self.states = {node: StateWriter(path, node) for node in nodes}
        self.pace = StatePace()
        self.streams = {node: StreamWriter(names.packets(node).path(path)) for node in nodes}
        self.logged = {node: StreamWriter(names.logged(node).path(path)) for node in nodes}
        self.inputs: dict[str, InputWriter] = {}
        self.seq = dict.fromkeys(nodes, 0)

    def tick(self, sim_time_ns: int, truths: Sequence[Truth], sent: Sequence[Sent]) -> Settled:
        """Physics tells where all are, the nodes transmit and answer, the radio settles."""
        self.truth.append(sim_time_ns, truths)
        if self.pace.is_due(sim_time_ns):
            for node, states in self.states.items():
                states.append(state_at(node, sim_time_ns))
        self.core.on_truths(truths)
        self.core.on_tick(sim_time_ns)
        for packet in sent:
            self._send(packet, sim_time_ns)
        closed = None
        for node in self.nodes:
            closed = self.core.on_answer(node, sim_time_ns)
        assert closed is not None
        settled = self.core.settle()
        self._write(settled)
        return settled

    def command(self, node: str, sim_time_ns: int, verb: str, goal: CommandGoal) -> None:
        """An operator's command comes to a node, and is recorded; the radio is told if it switches its radio."""
        writer = self.inputs.setdefault(node, InputWriter(names.inputs_path(self.run.path, node)))
        writer.write(RecordedInput.command(sim_time_ns, verb, goal))
        if verb == RADIO:
            with suppress(RadioMistake):
                self.core.on_switch(node, sim_time_ns, on=is_on(goal))

    def _send(self, packet: Sent, sim_time_ns: int) -> None:
        self.seq[packet.node] += packet.lost
        stamp = Stamp(
            self.seq[packet.node], sim_time_ns if packet.sim_time_ns is None else packet.sim_time_ns
        )
        self.seq[packet.node] += 1
        address = Address(packet.node, packet.radio, packet.to, "team")
        assert self.core.on_packet(address, bytes(packet.length), packet.encoding, stamp)

    def _write(self, settled: Settled) -> None:
        self.rows.write(settled.columns, settled.gaps, settled.received_ns)
        transmitted, self.core.transmitted = self.core.transmitted, []
        for p in transmitted:
            self.streams[self.nodes[p.tx]].write(p.sim_time_ns, encode_packet(p))

    def log(self, sim_time_ns: int, said: Sequence[Said]) -> None:
        """Agents log at a tick."""
        for node, item in said:
            self.logged[node].write(sim_time_ns, encode_logged(item))

    def close(self, *, killed: bool = False) -> Path:
        """End the run, or leave what a killed one leaves."""
        if not killed:
            self._write(self.core.finish())
        for table in (self.rows, self.truth, *self.states.values()):
            table.close()
        for inputs in self.inputs.values():
            inputs.close()
        for stream in (*self.streams.values(), *self.logged.values()):
            stream.close()
        if not killed:
            books = [
                Books.of(channel, air.ledger)
                for air, channel in zip(self.core.airs, self.channels, strict=True)
            ]
            write_ledger(self.run.path / LEDGER, books, self.core.refused)
            finish_tables(self.run.path)
            pack_streams(self.run.path)
            (self.run.path / SUMMARY_FILE).write_text(json.dumps({"ending": "duration"}))
        return self.run.path


def flown(
    path: Path,
    scenario: Scenario,
    ticks: int = 60,
    send: Callable[[int], Sequence[Sent]] | None = None,
    *,
    late: Sequence[str] = (),
    scale: float = 1.0,
    killed: bool = False,
    log: Callable[[int], Sequence[Said]] = lambda _: (),
) -> Path:
    """A whole run.

    Args:
        path: of the run directory, not there yet.
        scenario: see `scenario_of`.
        ticks: how many.
        send: what is transmitted at each tick; a packet of each node unless given.
        late: nodes that nobody has seen in the first half.
        scale: how much wider the ways are.
        killed: leave journals.
        log: what agents log at each tick.
    """
    router = Router(path, scenario)
    send = send or everybody(scenario.transceiver_ids)
    for number in range(ticks):
        unseen = () if 2 * number > ticks else late
        router.tick(number * TICK_NS, truths(scenario, number, unseen, scale), send(number))
        router.log(number * TICK_NS, log(number))
    return router.close(killed=killed)


def truths(scenario: Scenario, number: int, without: Sequence[str] = (), scale: float = 1.0) -> list[Truth]:
    """Of a tick: each UA's is a little after it, as an autopilot's frames are."""
    found: list[Truth] = []
    for place, node in enumerate(scenario.stations):
        if node not in without:
            after_ns = place % 3 * FRAME_NS // 2 if node.isdecimal() and number else 0
            found.append(truth_at(node, place, number * TICK_NS + after_ns, scale))
    return found
