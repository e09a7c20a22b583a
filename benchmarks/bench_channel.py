"""What the channel costs: per link in a batch, and per packet to one and to many receivers, draws included.

CPU time of this process, the best of several rounds in one run. The yardstick is a second figure of the same run: the
time that numpy takes to add two arrays of one element, because it sets the pace of everything that is not a batch.
"""

from __future__ import annotations

import argparse
import json
import timeit
from collections.abc import Callable, Sequence
from itertools import count
from time import process_time

import numpy as np

from channel.draws import Draws
from channel.link.radio import Radio
from channel.medium.medium import Medium
from channel.medium.simulate import simulate
from channel.presets import load_radio

REFERENCE_NS_PER_LINK = 300.0
"""ns-3's log-distance with its NIST error model, one core, without draws."""
ROUNDS = 9
RECEIVERS = (1, 2, 4, 8, 16, 32, 50, 100)


def best_us(call: Callable[[], object], number: int) -> float:
    """CPU time per call of the best round, us."""
    return min(timeit.repeat(call, number=number, repeat=ROUNDS, timer=process_time)) / number * 1e6


def batch_ns_per_link(radio: Radio, links: int, packets: int) -> float:
    """Log-distance, shadowing draw, PER and erasure draw of links x packets, per packet and link, ns."""
    names = [(str(i), str(i + 1)) for i in range(links)]
    distance = np.linspace(100.0, 500.0, links)[:, np.newaxis]
    draws, first = Draws(1), count(0, packets)
    call = lambda: simulate(radio, draws, names, distance, packets=packets, first_seq=next(first))  # noqa: E731
    return best_us(call, 3) * 1e3 / (links * packets)


def packet_us(radio: Radio, receivers: int) -> float:
    """One packet to all receivers, truth known on both sides of it, us."""
    nodes = [str(i) for i in range(receivers + 1)]
    medium, time_ns = Medium(radio, seed=1, nodes=nodes), count(50_000_000, 1_000_000)
    for at_ns in (0, 10**11):
        for i, node in enumerate(nodes):
            medium.observe(node, at_ns, (300.0 + 2.0 * i, 5.0 * i, -40.0))
    seq = count()
    return best_us(lambda: medium.transmit("0", next(seq), next(time_ns), 40), 1024)


def measure(name: str) -> dict[str, object]:
    """Return all figures of one radio."""
    radio = Radio(load_radio(name))
    one = np.ones(1)
    batch = batch_ns_per_link(radio, 64, 4096)
    return {
        "radio": name,
        "numpy_add_us": best_us(lambda: one + one, 20000),
        "batch_ns_per_link": batch,
        "reference_over_batch": REFERENCE_NS_PER_LINK / batch,
        "packet_us": {n: packet_us(radio, n) for n in RECEIVERS},
    }


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--radio", default="moon2020")
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args(arguments)
    figures = measure(options.radio)
    if options.json:
        print(json.dumps(figures))
        return
    print(f"{figures['radio']}: numpy adds one element in {figures['numpy_add_us']:.2f} us")
    times = f"{figures['reference_over_batch']:.1f} times faster than {REFERENCE_NS_PER_LINK:.0f} ns"
    print(f"batch: {figures['batch_ns_per_link']:.0f} ns per packet and link, {times} (wanted: 3)")
    packets: dict[int, float] = figures["packet_us"]  # type: ignore[assignment]
    for receivers, us in packets.items():
        print(f"one packet to {receivers:3d}: {us:6.1f} us{'  (wanted: 60)' if receivers == 50 else ''}")


if __name__ == "__main__":
    main()
