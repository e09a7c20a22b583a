"""What the radio router costs, alone, and what a received packet costs an agent.

- `fan-out`: CPU time per delivery as a multiple of a bare Zenoh fan-out to the same receivers, which only puts each
  packet on a key per receiver. At each tick every node transmits to all others. Ours takes the packets, settles them,
  books them, writes their rows and hands them on: in one message to the host of the receivers (`hosts`), and besides
  to a subscriber of each one's `rx` (`hosts and rx`). `lone`: the same with one sender per tick.
- `fleet`: so many nodes, each heard by a tenth of the others, all transmitting: CPU time per second of sim time. Below
  1 it keeps up with real time on one core.
- `agent`: CPU time per reception of an agent that looks at none of them, and of one that decodes each.

Receivers are a process of their own; CPU time is that of the measured process with its Zenoh threads. Medians.

    python -m benchmarks.bench_router [--receivers 1 10 50] [--nodes 100] [--rounds 5] [--packets 1000] [--json]
"""

from __future__ import annotations

import argparse
import json
import multiprocessing as mp
import statistics
import tempfile
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import closing
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np

from bridge.agents.agent import Agent
from bridge.agents.client import UaClient
from bridge.agents.running.feed import Arrivals, DeliveredPacket
from bridge.agents.running.runner import AgentRunner
from bridge.bus.keys import Address, Keys
from bridge.bus.messages import AircraftState, DataPackage, Header, Quaternion, Truth, Vector3, decode, encode
from bridge.bus.reception import Reception
from bridge.bus.session import Session, Stamp, free_port, open_client, open_router
from bridge.radio.heard import Hosts
from bridge.radio.radio import PACKAGE_ENCODING, RecordedRadio
from bridge.radio.router.publisher import TickPublisher
from bridge.record.events import Report
from bridge.run.directory import RunDirectory
from bridge.scenario.agents import StillAgent
from bridge.scenario.file import parse_scenario
from bridge.scenario.model import Scenario
from bridge.scenario.nodes import Aircraft
from bridge.scenario.sections import Transmit
from channel.medium.reception import DELIVERED

RUN = "bench"
KEYS = Keys(RUN)
PAYLOAD = encode(DataPackage(Header.at(0, "0"), 2412, AircraftState(mode="GUIDED")))
TICK_NS = 100_000_000
STEP_NS = 5_000_000_000
HOST = "host-0"
HOST_ONLY, BOTH, BARE = "hosts", "hosts and rx", "bare"
FLEET_SIDE_M = 4000.0
WARM_UP = 20


class Router:
    """The router of a run without its process: the radio with its record, and what is published of it."""

    def __init__(self, session: Session, nodes: Sequence[str], radio: str, folder: Path) -> None:
        run = RunDirectory(folder / RUN)
        run.path.mkdir()
        run.write(scenario_of(nodes, radio), "")
        self._session = session
        self._radio = RecordedRadio(run, Report(run.path, "router"))
        self._publisher = TickPublisher(session, run, self._radio)
        self._hosts = Hosts(nodes, {HOST: nodes})
        self.nodes = nodes
        self.close = self._radio.close
        self.deliveries = 0

    def place(self, sim_time_ns: int, places: Sequence[tuple[float, float]]) -> None:
        """Take true states."""
        self._radio.truths(
            [
                Truth(
                    Header.at(sim_time_ns, node),
                    position_ned_m=Vector3(north_m, east_m, -40.0),
                    attitude=Quaternion(),
                )
                for node, (north_m, east_m) in zip(self.nodes, places, strict=True)
            ]
        )

    def tick(self, senders: Sequence[str], seq: int, sim_time_ns: int) -> None:
        """Take a packet of each sender, and do all that the router does at a tick."""
        stamp = Stamp(seq, sim_time_ns)
        for node in senders:
            self._radio.packet(Address(node, "main", "all", "team"), PAYLOAD, PACKAGE_ENCODING, stamp)
        tick = self._radio.settle(sim_time_ns)
        for host, share in self._hosts.shares(tick).items():
            self._session.put(KEYS.heard(host), share, must_arrive=True)
        self._publisher.to_nodes(tick)
        self._publisher.to_observers(tick)
        self._radio.write(tick.settled)
        self.deliveries += int(np.count_nonzero(tick.settled.receptions.fate == DELIVERED))


def scenario_of(nodes: Sequence[str], radio: str) -> Scenario:
    """A scenario with these UA; ``radio`` is YAML."""
    lines = "\n".join(f"  - {{id: {node}, agent: {{type: still}}}}" for node in nodes)
    return parse_scenario(
        "schema: 1\nname: bench\nduration_s: 600\norigin: {lat_deg: 40.0, lon_deg: -105.0, alt_amsl_m: 1600.0}\n"
        f"radio: {radio}\nnodes:\n{lines}\n",
        "bench.yaml",
    )


def receive(endpoint: str, keys: Sequence[str], pipe: Connection) -> None:
    """The receivers: a session each, in a process of their own."""
    sessions = [open_client(endpoint) for _ in keys]
    for session, key in zip(sessions, keys, strict=True):
        session.subscribe(key, lambda _: None)
    pipe.send("ready")
    pipe.recv()
    for session in sessions:
        session.close()


def served(keys: Sequence[str], wanted: Sequence[str], body: Callable[[Session], float]) -> float:
    """What ``body`` measures with the router's session, while somebody subscribes to ``keys``."""
    context, endpoint = mp.get_context("spawn"), f"tcp/127.0.0.1:{free_port()}"
    mine, theirs = context.Pipe()
    with open_router(endpoint) as session:
        receiver = context.Process(target=receive, args=(endpoint, keys, theirs), daemon=True)
        receiver.start()
        mine.recv()
        interests = [session.interest(key) for key in wanted]
        deadline = time.monotonic() + 10.0
        while not all(wants() for wants in interests):
            if time.monotonic() > deadline:
                raise RuntimeError("the receivers' subscriptions have not reached the router within 10 s")
            time.sleep(0.01)
        try:
            return body(session)
        finally:
            mine.send("end")
            receiver.join(10)


def fan_out_us(kind: str, receivers: int, ticks: int, *, lone: bool = False) -> float:
    """CPU time per delivery, us."""
    nodes = [str(index) for index in range(receivers + 1)]
    senders = nodes[:1] if lone else nodes
    rx = [KEYS.rx(node, "*", "*") for node in nodes]
    keys = {BARE: rx, HOST_ONLY: [KEYS.heard(HOST)], BOTH: [KEYS.heard(HOST), *rx]}[kind]
    pairs = [KEYS.rx(node, sender, "team") for sender in senders for node in nodes if node != sender]

    def body(session: Session) -> float:
        with (
            tempfile.TemporaryDirectory() as folder,
            closing(Router(session, nodes, "moon2020", Path(folder))) as router,
        ):
            places = [(0.0, 0.0), *((100.0, float(index)) for index in range(receivers))]
            for sim_time_ns in range(0, (WARM_UP + ticks) * TICK_NS + STEP_NS, STEP_NS):
                router.place(sim_time_ns, places)  # nobody moves
            began_s, deliveries = 0.0, 0
            for seq in range(WARM_UP + ticks):
                if seq == WARM_UP:
                    began_s, deliveries = time.process_time(), router.deliveries
                if kind == BARE:
                    stamp = Stamp(seq, seq * TICK_NS).to_bytes()
                    for key in pairs:
                        session.put_bytes(key, PAYLOAD, attachment=stamp, must_arrive=True)
                    router.deliveries += len(pairs)
                else:
                    router.tick(senders, seq, seq * TICK_NS)
            return (time.process_time() - began_s) / (router.deliveries - deliveries) * 1e6

    return served(keys, keys, body)


def fleet_load(count: int, ticks: int) -> tuple[float, float]:
    """CPU time per second of sim time with so many nodes at 10 Hz, and the share of pairs in range."""
    nodes = [str(index) for index in range(count)]
    rng = np.random.default_rng(7)
    places = [tuple(row) for row in (rng.random((count, 2)) * FLEET_SIDE_M).tolist()]
    share = 0.0

    def body(session: Session) -> float:
        nonlocal share
        # a disk of such a radius that a tenth of the pairs lie within it
        gaps_m = [np.hypot(a[0] - b[0], a[1] - b[1]) for a in places for b in places if a is not b]
        radio = f"{{preset: corrected, max_range_m: {np.quantile(gaps_m, 0.1)}}}"
        with (
            tempfile.TemporaryDirectory() as folder,
            closing(Router(session, nodes, radio, Path(folder))) as router,
        ):
            router.place(0, places)
            began_s = 0.0
            for seq in range(WARM_UP + ticks):
                if seq == WARM_UP:
                    began_s = time.process_time()
                router.place((seq + 1) * TICK_NS, places)
                router.tick(nodes, seq, seq * TICK_NS)
            share = router.deliveries / ((WARM_UP + ticks) * count * (count - 1))
            return (time.process_time() - began_s) / (ticks * TICK_NS / 1e9)

    return served([KEYS.heard(HOST)], [KEYS.heard(HOST)], body), share


class Deaf(Agent):
    """Looks at no packet and transmits none."""

    def transmit_package(self, sim_time_ns: int) -> None:
        """Transmit nothing."""


class Reader(Deaf):
    """Decodes every packet."""

    def on_packet(self, sender: str, channel: str, payload: bytes, reception: Reception) -> None:  # noqa: ARG002
        """Decode it."""
        decode(payload, DataPackage)


class _Nowhere:
    def transmit(self, *_: object) -> None:
        """Nobody hears."""

    report = command = transmit


def agent_us(kind: type[Agent], senders: int, ticks: int) -> float:
    """CPU time of the process per reception, us: the agent's thread, and who hands it its ticks."""
    idle = threading.Semaphore(0)
    config = Aircraft(id=0, agent=StillAgent(type="still"))
    ua = UaClient("0", _Nowhere())
    runner = AgentRunner(ua, lambda client: kind(client, config, Transmit()), idle.release, print)
    runner.start().result()
    state, arrivals, began_s = AircraftState(), Arrivals(), 0.0
    for tick in range(WARM_UP + ticks):
        if tick == WARM_UP:
            began_s = time.process_time()
        arrivals.state_came(state)
        for sender in range(senders):
            packet = DeliveredPacket(str(1 + sender), "team", PAYLOAD, Stamp(tick, tick * TICK_NS))
            arrivals.packet_came(packet, -80.0 - sender, 15.0)
        runner.tick(tick * TICK_NS, arrivals.take())
        idle.acquire()
    used_s = time.process_time() - began_s
    runner.ask_to_stop()
    runner.join(5.0)
    return used_s / (ticks * senders) * 1e6


def measure(arguments: argparse.Namespace) -> dict[str, Any]:
    """All figures."""
    median = statistics.median
    rows = []
    for receivers in arguments.receivers:
        ticks = max(arguments.packets // (receivers + 1), 5)
        rounds = [
            {kind: fan_out_us(kind, receivers, ticks) for kind in (BARE, HOST_ONLY, BOTH)}
            for _ in range(arguments.rounds)
        ]
        row: dict[str, Any] = {"receivers": receivers}
        row |= {f"{kind} us": median(each[kind] for each in rounds) for kind in (BARE, HOST_ONLY, BOTH)}
        row |= {
            f"{kind} ratio": median(each[kind] / each[BARE] for each in rounds) for kind in (HOST_ONLY, BOTH)
        }
        row["lone us"] = median(
            fan_out_us(HOST_ONLY, receivers, arguments.packets, lone=True) for _ in range(arguments.rounds)
        )
        rows.append(row)
    fleets = [fleet_load(arguments.nodes, max(arguments.packets // 10, 5)) for _ in range(arguments.rounds)]
    ticks = max(arguments.packets // 5, 5)
    return {
        "benchmark": "router",
        "rows": rows,
        "fleet": {
            "nodes": arguments.nodes,
            "cpu_s_per_sim_s": median(load for load, _ in fleets),
            "delivered_share": fleets[0][1],
        },
        "agent": {
            "looks at none us": median(agent_us(Deaf, 49, ticks) for _ in range(arguments.rounds)),
            "decodes each us": median(agent_us(Reader, 49, ticks) for _ in range(arguments.rounds)),
        },
    }


def main(argv: list[str] | None = None) -> dict[str, Any]:
    """Run the benchmark; prints and returns the figures."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.bench_router",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--receivers", type=int, nargs="+", default=[1, 10, 50])
    parser.add_argument("--nodes", type=int, default=100)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--packets", type=int, default=1000)
    parser.add_argument("--json", action="store_true")
    arguments = parser.parse_args(argv)
    result = measure(arguments)
    if arguments.json:
        print(json.dumps(result))
        return result
    for row in result["rows"]:
        print(
            f"router: {row['receivers']} receivers: us CPU per delivery: bare {row[f'{BARE} us']:.1f}, "
            f"{HOST_ONLY} {row[f'{HOST_ONLY} us']:.1f} (ratio {row[f'{HOST_ONLY} ratio']:.2f}), "
            f"{BOTH} {row[f'{BOTH} us']:.1f} ({row[f'{BOTH} ratio']:.2f}); "
            f"lone sender {row['lone us']:.1f}"
        )
    fleet, agent = result["fleet"], result["agent"]
    print(
        f"router: {fleet['nodes']} nodes at 10 Hz, {fleet['delivered_share']:.2f} of the receptions delivered: "
        f"{fleet['cpu_s_per_sim_s']:.2f} s of CPU per second of sim time"
    )
    print(
        f"agent: {agent['looks at none us']:.1f} us per reception if it looks at none, "
        f"{agent['decodes each us']:.1f} us if it decodes each"
    )
    return result


if __name__ == "__main__":
    main()
