"""What a chain of half-duplex hops carries, by its medium: packets a second at its end, as a share of one hop.

    python -m benchmarks.bench_chain [--duration 20] [--length 1000]

Nodes in a row, each in reach of those beside it; its first sends more than the chain carries, along static routes.
Power falls with the fourth power of the distance: a frame survives another whose sender is two places off (12 dB), and
none beside the receiver.
beside the receiver. `tdma`: a slot for each hop, by turns, and with every third hop at once. `csma`: 802.11g, 6 Mb/s;
energy is sensed one place away (hidden nodes), two, or all along the chain. The last line is JSON.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Sequence

from channel.access.air import Hearing
from channel.access.media.csma import Csma
from channel.access.media.medium import AccessMedium
from channel.access.media.schedule import Schedule, Slot
from channel.access.media.tdma import Tdma
from channel.access.packets import AirFate, AirPacket
from channel.access.queue import QueueLimits
from channel.access.timing import NS_PER_S, BitRate, wifi_g
from channel.access.world import PlainWorld
from channel.draws import Draws
from channel.routing.routed import Routed
from channel.routing.router import Forwarding
from channel.routing.static import Static

HOPS = range(1, 7)
BESIDE_MW = 1e-7
SINR = 10.0
HEARING = Hearing(preamble_mw=0.9 * BESIDE_MW, energy_mw=1e-15, cca_ns=4_000)
TIMING = BitRate(6e6)
Open = Callable[[int, int], AccessMedium]


def row(nodes: int, senses: int) -> PlainWorld:
    """Nodes in a row, whose signals are there up to so many places away."""
    ends = [(a, b) for a in range(nodes) for b in range(nodes) if a != b]
    deaf = [(a, b) for a, b in ends if abs(a - b) > senses]
    power_mw = {(a, b): BESIDE_MW / abs(a - b) ** 4 for a, b in ends}
    return PlainWorld(range(nodes), deaf=deaf, power_mw=power_mw, sinr_min=SINR)


def csma(senses: int) -> Open:
    """802.11g."""
    return lambda hops, _length: Csma(row(hops + 1, senses), wifi_g(), hearing=HEARING)


def tdma(turns: int) -> Open:
    """Slots of one frame, of every so manieth hop at once."""

    def opened(hops: int, length_bytes: int) -> AccessMedium:
        frame_ns = TIMING.duration_ns(length_bytes)
        count = min(turns, hops)
        slots = [Slot(tuple(range(turn, hops, count)), turn * frame_ns, frame_ns) for turn in range(count)]
        schedule = Schedule(tuple(slots), count * frame_ns)
        return Tdma(row(hops + 1, hops), TIMING, schedule, QueueLimits(), HEARING)

    return opened


MEDIA: dict[str, Open] = {
    "tdma, one hop at a time": tdma(1000),
    "tdma, every third at once": tdma(3),
    "csma, senses one place": csma(1),
    "csma, senses two places": csma(2),
    "csma, senses all": csma(1000),
}


def carried(medium: AccessMedium, hops: int, length_bytes: int, duration_s: float) -> float:
    """Packets a second that come to the end of a chain, in the second half of a time."""
    nodes = range(hops + 1)
    routes = {node: {to: node + (1 if to > node else -1) for to in nodes if to != node} for node in nodes}
    network = Routed(medium, Static([str(node) for node in nodes], Draws(1), Forwarding(), routes, 0))
    period_ns, end_ns = TIMING.duration_ns(length_bytes), round(duration_s * NS_PER_S)
    for number in range(end_ns // period_ns):
        network.offer(AirPacket(0, number, hops, length_bytes, number * period_ns))
    came = [each for each in network.live(end_ns) if isinstance(each, AirFate) and each.loss is None]
    return sum(2 * each.at_ns > end_ns for each in came) / (duration_s / 2)


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the shares."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--duration", type=float, default=20.0, help="sim time of each, s")
    parser.add_argument("--length", type=int, default=1000, help="of each packet, bytes")
    options = parser.parse_args(arguments)
    print(f"{'hops':28s}" + "".join(f"{hops:>8d}" for hops in HOPS))
    shares = {}
    for name, opened in MEDIA.items():
        rates = [
            carried(opened(hops, options.length), hops, options.length, options.duration) for hops in HOPS
        ]
        shares[name] = [round(rate / rates[0], 3) for rate in rates]
        print(f"{name:28s}" + "".join(f"{share:8.3f}" for share in shares[name]))
    print(json.dumps({"shares": shares}))


if __name__ == "__main__":
    main()
