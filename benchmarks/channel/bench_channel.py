"""What the channel costs: per link in a batch, per tick of a fleet and per packet to one receiver, draws included.

CPU time of this process, the best of several rounds in one run. Two yardsticks stand beside it: what ns-3 takes for
log-distance and its NIST error model without draws, and the time that numpy takes to add two arrays of one element,
because it sets the pace of everything that is not a batch. `--fleets` measures ticks of 10, 100 and 1000 nodes for all
presets.
"""

from __future__ import annotations

import argparse
import json
import timeit
from collections.abc import Callable, Sequence
from itertools import count
from time import process_time
from typing import Any

import numpy as np

from channel.checks import ChannelInputError
from channel.draws import BLOCK_PACKETS, Draws
from channel.link.radio import Radio
from channel.medium.ledger import Ledger
from channel.medium.medium import EVERYBODY, Medium, Packets
from channel.medium.simulate import simulate
from channel.presets import load_radio, preset_names

REFERENCE_NS_PER_LINK = 303.0
"""ns-3's log-distance with its NIST error model, one core, without draws."""
TICK_NS = 50_000_000
SPREAD_M = {"gazebo-classic": 10.0, "gz-rfcomms": 40.0}
"""Side of the square in which a fleet flies, where it is not 400 m: so that most links can hear each other."""
FLEETS = (10, 100, 1000)
SMALL = 10
LINKS_PER_TICK = 100_000
"""In large fleets so few nodes send in a tick that it has about this many links."""


def best_us(call: Callable[[], object], number: int, rounds: int) -> float:
    """CPU time per call of the best round, us."""
    return min(timeit.repeat(call, number=number, repeat=rounds, timer=process_time)) / number * 1e6


def batch_ns_per_link(radio: Radio, links: int, packets: int, rounds: int) -> float | None:
    """Log-distance, shadowing draw, PER and erasure draw of links x packets, per packet and link, ns.

    None for radios whose terms time or place changes: they have no batches.
    """
    names = [(str(i), str(i + 1)) for i in range(links)]
    distance = np.linspace(100.0, 500.0, links)[:, np.newaxis]
    draws, first = Draws(1), count(0, packets)
    call = lambda: simulate(radio, draws, names, distance, packets=packets, first_seq=next(first))  # noqa: E731
    try:
        return best_us(call, 1, rounds) * 1e3 / (links * packets)
    except ChannelInputError:
        return None


class Fleet:
    """Nodes that fly about in a square and send a packet to everybody at each tick.

    Args:
        radio: of all nodes.
        nodes: how many.
        senders: how many of them send.
        to: the one addressee; everybody if not given.
    """

    def __init__(self, radio: Radio, nodes: int, senders: int, to: int = EVERYBODY) -> None:
        self.medium = Medium(radio, seed=1, nodes=[str(i) for i in range(nodes)])
        self.links = senders * (nodes - 1 if to == EVERYBODY else 1)
        spread_m = SPREAD_M.get(radio.config.name, 400.0)
        rng = np.random.Generator(np.random.PCG64(1))
        self._start_m = rng.uniform((0.0, 0.0, -60.0), (spread_m, spread_m, -30.0), (nodes, 3))
        self._step_m = rng.uniform(-1.0, 1.0, (nodes, 3)) * (0.5, 0.5, 0.0)
        self._all = np.arange(nodes)
        self._senders, self._to = np.arange(senders), np.full(senders, to)
        self._tick = count()

    def fly(self) -> None:
        """Give the medium the truth of the next tick, and the packets sent at it."""
        tick = next(self._tick)
        self.medium.observe(self._all, tick * TICK_NS, self._start_m + (tick % 100) * self._step_m)
        same = np.ones_like(self._senders)
        self.medium.send(Packets(tick * TICK_NS * same, self._senders, tick * same, 100 * same, self._to))


def tick_ns_per_link(radio: Radio, nodes: int, ticks: int) -> tuple[float, float]:
    """Settling of a tick of a fleet, all to all, and its books: median over ticks, per link, ns."""
    fleet = Fleet(radio, nodes, max(1, min(nodes, LINKS_PER_TICK // nodes)))
    ledger = Ledger(fleet.medium.nodes)
    settled: list[float] = []
    booked: list[float] = []
    for _ in range(ticks):
        fleet.fly()
        start = process_time()
        receptions = fleet.medium.settle()
        middle = process_time()
        ledger.settle(receptions)
        settled.append(middle - start)
        booked.append(process_time() - middle)
    warm = ticks // 4  # tables are made
    return tuple(float(np.mean(times[warm:])) * 1e9 / fleet.links for times in (settled, booked))  # type: ignore[return-value]


def packet_us(radio: Radio, rounds: int) -> float:
    """`send` and `settle` of one packet to one receiver, truth known on both sides of it, us."""
    medium = Medium(radio, seed=1, nodes=["0", "1"])
    for at_ns in (0, 10**11):
        for i, node in enumerate(medium.nodes):
            medium.observe(node, at_ns, (300.0 + 2.0 * i, 5.0 * i, -40.0))
    seq, to = count(), np.array([1])
    tx, length = np.array([0]), np.array([40])

    def one() -> None:
        number = next(seq)
        medium.send(Packets(np.array([50_000_000 + 1_000_000 * number]), tx, np.array([number]), length, to))
        medium.settle()

    return best_us(one, 512, rounds)


def measure(name: str, rounds: int) -> dict[str, Any]:
    """Return all figures of one radio."""
    radio, one = Radio(load_radio(name)), np.ones(1)
    tick, books = tick_ns_per_link(radio, 50, BLOCK_PACKETS * rounds * 4 // 3)
    return {
        "radio": name,
        "numpy_add_us": best_us(lambda: one + one, 20000, rounds),
        "batch_ns_per_link": batch_ns_per_link(radio, 64, 512 * rounds, rounds),
        "tick_ns_per_link": tick,
        "books_ns_per_link": books,
        "packet_us": packet_us(radio, rounds),
    }


def print_figures(figures: dict[str, Any]) -> None:
    """Print the figures of one radio."""
    print(f"{figures['radio']}: numpy adds one element in {figures['numpy_add_us']:.2f} us")
    for key, what in (("batch_ns_per_link", "batch"), ("tick_ns_per_link", "tick of 50 nodes, 2450 links")):
        if figures[key] is None:
            continue
        times = REFERENCE_NS_PER_LINK / figures[key]
        print(f"{what}: {figures[key]:.0f} ns per link, {times:.1f} times faster than ns-3's 303 ns")
    print(f"books of that tick: {figures['books_ns_per_link']:.0f} ns per link")
    print(f"one packet to one receiver: {figures['packet_us']:.1f} us (wanted: 60)")


def print_fleets(presets: Sequence[str], fleets: Sequence[int], ticks: int) -> None:
    """Print the table of ns per link for presets and sizes of fleets; small fleets fly whole blocks of draws."""
    heads = "".join(f"{n:>8d} nodes" for n in fleets)
    print(f"ns per link, settled (ns-3: {REFERENCE_NS_PER_LINK:.0f})\n{'preset':<18}{heads}")
    for name in presets:
        radio = Radio(load_radio(name))
        row = [
            tick_ns_per_link(radio, n, BLOCK_PACKETS * ticks if n <= SMALL else 8 * ticks)[0] for n in fleets
        ]
        print(f"{name:<18}" + "".join(f"{ns:>14.0f}" for ns in row), flush=True)


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--radio", default="moon2020")
    parser.add_argument("--rounds", type=int, default=9, help="the best of so many counts")
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--fleets", action="store_true", help="ticks of 10, 100 and 1000 nodes, all presets")
    options = parser.parse_args(arguments)
    if options.fleets:
        print_fleets(preset_names(), FLEETS, options.rounds)
        return
    figures = measure(options.radio, options.rounds)
    print(json.dumps(figures)) if options.json else print_figures(figures)


if __name__ == "__main__":
    main()
