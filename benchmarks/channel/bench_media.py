"""How many events a second a medium handles on one core, and how much faster than real time a network settles.

    python -m benchmarks.channel.bench_media [--nodes 50] [--duration 10] [--rounds 3]

Saturated 802.11a stations with unicasts to one (Bianchi's case); nodes on a ring that broadcast 100 bytes at 10 Hz
over `csma`, all hearing all, by a radio's powers and errors; and the same with moving nodes and all that is drawn, as a
run has it, over `csma` and on a medium that takes no time (`ideal`). Then some of them over `csma` with the routing
`mesh`, at 1 Hz. The last line is JSON.
"""

from __future__ import annotations

import argparse
import json
import statistics
from collections.abc import Sequence
from math import cos, pi, sin
from time import process_time

import numpy as np

from channel.access.media.csma import Csma
from channel.access.media.medium import AccessMedium
from channel.access.packets import PLAIN, AirPacket
from channel.access.queue import QueueLimits
from channel.access.timing import wifi_a, wifi_g
from channel.access.world import PlainWorld
from channel.link.radio import Radio
from channel.medium.judge.judge import Judge
from channel.medium.medium import Medium
from channel.medium.reception import Packets, Receptions
from channel.network.entry import EntryInstants, EntrySettings
from channel.network.network import Network
from channel.network.radio_world import RadioWorld
from channel.presets import load_radio
from channel.routing.settings import MeshRouting

NS_PER_S = 1_000_000_000
TICK_NS = NS_PER_S // 20
RING_M = 100.0
EVERY_TICKS, MESH_EVERY_TICKS = 2, 20
"""Between two packets of a node; in a mesh each is transmitted by all, up to three times."""


def saturated(nodes: int, duration_s: float) -> AccessMedium:
    """Stations that always have something to send."""
    medium = Csma(PlainWorld(range(nodes)), wifi_a(24.0, 24.0), limits=QueueLimits(0))
    for node in range(1, nodes):
        for number in range(int(2000 * duration_s / nodes) + 50):
            medium.offer(AirPacket(node, number, 0, 1500, 0))
    return medium


def broadcasts(nodes: int, duration_s: float) -> AccessMedium:
    """Nodes that send all others their places, ten times a second."""
    turn = 2.0 * pi / nodes
    places = {node: (RING_M * cos(turn * node), RING_M * sin(turn * node), -40.0) for node in range(nodes)}
    medium = Csma(RadioWorld(Radio(load_radio("wifi-2.4")), places), wifi_g())
    for node in range(nodes):
        for number in range(int(10 * duration_s)):
            at_ns = number * NS_PER_S // 10 + node * NS_PER_S // 10 // nodes
            medium.offer(AirPacket(node, number, None, 100, at_ns))
    return medium


def measured(medium: AccessMedium, duration_s: float) -> tuple[float, float]:
    """Events a second of CPU time, and sim time over CPU time."""
    begin_s = process_time()
    medium.run(int(duration_s * NS_PER_S))
    took_s = process_time() - begin_s
    return medium.agenda.handled / took_s, duration_s / took_s


class Fleet:
    """Nodes of a run on a network, that move and broadcast ten times a second, in a mesh once.

    Args:
        nodes: how many.
        is_ideal: whether packets take no time; else there is `csma`.
        is_mesh: whether nodes hand packets on, as the routing `mesh` does; not with ``is_ideal``.
    """

    def __init__(self, nodes: int, *, is_ideal: bool = False, is_mesh: bool = False) -> None:
        self._is_ideal = is_ideal
        self._every_ticks = MESH_EVERY_TICKS if is_mesh else EVERY_TICKS
        names = [str(node) for node in range(nodes)]
        radio = Radio(load_radio("wifi-2.4"))
        self._names, self._tick, self._number = names, 0, 0
        judge = Judge(nodes)
        self._medium = Medium(
            radio, seed=1, nodes=names, ahead_ns=2 * TICK_NS, judge=judge if is_ideal else None
        )
        entry = EntryInstants(names, EntrySettings(None, 0.001, 0.001), TICK_NS, self._medium.draws)
        places = {name: place for place, name in enumerate(names)}
        router = MeshRouting().open(places, self._medium.draws) if is_mesh else None
        self._network = Network(self._medium, lambda world: Csma(world, wifi_g()), entry, judge, router)
        turn = 2.0 * pi / nodes
        self._places = np.array(
            [(RING_M * cos(turn * n), RING_M * sin(turn * n), -40.0) for n in range(nodes)]
        )

    def measured(self, duration_s: float) -> tuple[float, float]:
        """Receptions a second of CPU time, and sim time over CPU time."""
        receptions, begin_s = 0, process_time()
        for _ in range(int(duration_s * NS_PER_S / TICK_NS)):
            self._places += (0.25, 0.1, 0.0)
            now_ns = self._tick * TICK_NS
            self._medium.observe(self._names, now_ns, self._places)
            if self._tick % self._every_ticks == 0:
                seq = np.full(len(self._names), self._number)
                packets = self._medium.packets(tx=self._names, seq=seq, sim_time_ns=now_ns, length_bytes=100)
                self._send(packets)
                self._number += 1
            self._tick += 1
            receptions += self._settle(self._tick * TICK_NS).size
        took_s = process_time() - begin_s
        return receptions / took_s, duration_s / took_s

    def _send(self, packets: Packets) -> None:
        if self._is_ideal:
            self._medium.send(packets)
        else:
            self._network.send(packets, [PLAIN] * packets.size)

    def _settle(self, until_ns: int) -> Receptions:
        return self._medium.settle() if self._is_ideal else self._network.live(until_ns).receptions


def main(arguments: Sequence[str] | None = None) -> None:
    """Print both."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--nodes", type=int, default=50)
    parser.add_argument("--mesh-nodes", type=int, default=20)
    parser.add_argument("--duration", type=float, default=10.0, help="sim time, s")
    parser.add_argument("--rounds", type=int, default=3)
    options = parser.parse_args(arguments)
    found = {}
    for name, make in (("saturated", saturated), ("broadcasts", broadcasts)):
        rounds = [
            measured(make(options.nodes, options.duration), options.duration) for _ in range(options.rounds)
        ]
        events, factor = (statistics.median(column) for column in zip(*rounds, strict=True))
        found[name] = {"events_per_s": round(events), "real_time_factor": round(factor, 1)}
        print(
            f"{options.nodes} nodes, {name}: {events:,.0f} events a second, {factor:.1f} times real time",
            flush=True,
        )
    for name, fleet in (
        ("fleet", Fleet(options.nodes)),
        ("ideal", Fleet(options.nodes, is_ideal=True)),
        ("mesh", Fleet(options.mesh_nodes, is_mesh=True)),
    ):
        fleet.measured(1.0)
        rounds = [fleet.measured(options.duration / 4.0) for _ in range(options.rounds)]
        receptions, factor = (statistics.median(column) for column in zip(*rounds, strict=True))
        found[name] = {"receptions_per_s": round(receptions), "real_time_factor": round(factor, 2)}
        nodes = options.mesh_nodes if name == "mesh" else options.nodes
        print(
            f"{nodes} nodes of a run, {name}: {receptions:,.0f} receptions a second, {factor:.2f} times real time"
        )
    print(json.dumps({"bench": "media", "nodes": options.nodes, "mesh_nodes": options.mesh_nodes} | found))


if __name__ == "__main__":
    main()
