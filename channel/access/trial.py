"""A medium under load, without a flight: nodes that send at random, and what comes of it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import log
from typing import Any

from channel.access.media.medium import AccessMedium
from channel.access.packets import AirFate, AirPacket, Loss
from channel.access.timing import NS_PER_S
from channel.access.words import WordStream
from channel.draws import Draws


@dataclass(frozen=True, slots=True)
class Load:
    """What nodes send.

    Attributes:
        offered_bps: of all together, bits of packets per second.
        length_bytes: of each packet.
        to: whom for; None: all.
        duration_s: how long they send.
        seed: of the instants: each node's are a Poisson process.
    """

    offered_bps: float
    length_bytes: int
    to: int | None
    duration_s: float
    seed: int = 1

    def __post_init__(self) -> None:
        if not (self.offered_bps > 0.0 and self.length_bytes > 0 and self.duration_s > 0.0):
            raise ValueError(
                f"{self.offered_bps:g} bit/s in packets of {self.length_bytes} bytes for {self.duration_s:g} s: above 0"
            )


@dataclass(frozen=True, slots=True)
class Carried:
    """What came of a load.

    Attributes:
        sent: receptions that there would be if nothing was lost.
        delivered: receptions.
        delivered_bps: bits of packets received per second, per receiver that each packet has; one that nobody is to
            have is none.
        delay_s: (mean, median, 95 %) from entering the radio to arrival; of what arrived.
        lost: receptions lost by cause.
        in_flight: not decided at the end.
    """

    offered_bps: float
    sent: int
    delivered: int
    delivered_bps: float
    delay_s: tuple[float, float, float] | None
    lost: Mapping[Loss, int] = field(default_factory=dict)
    in_flight: int = 0

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        mean, median, most = self.delay_s or (None, None, None)
        return {
            "offered_bps": self.offered_bps,
            "delivered_bps": self.delivered_bps,
            "sent": self.sent,
            "delivered": self.delivered,
            "in_flight": self.in_flight,
            "delay_mean_s": mean,
            "delay_median_s": median,
            "delay_95_s": most,
            "lost": {loss.value: count for loss, count in sorted(self.lost.items())},
        }


def instants(node: int, a_second: float, load: Load) -> list[int]:
    """When a node sends: a Poisson process, ns; hangs on the seed, the node and the rate alone."""
    words = WordStream(Draws(load.seed), str(node), "instants")
    at_s = 0.0
    found: list[int] = []
    while True:
        at_s -= log(1.0 - words.next_uniform()) / a_second
        if at_s >= load.duration_s:
            return found
        found.append(int(at_s * NS_PER_S))


def under_load(medium: AccessMedium, load: Load) -> Carried:
    """Send a load over a medium that nothing was sent over yet."""
    senders = [node for node in medium.world.nodes if node != load.to]
    a_second = load.offered_bps / (8 * load.length_bytes) / len(senders)
    sent = packets = 0
    for node in senders:
        for number, at_ns in enumerate(instants(node, a_second, load)):
            packet = AirPacket(node, number, load.to, load.length_bytes, at_ns)
            medium.offer(packet)
            receivers = len(medium.receivers_of(packet))
            packets += bool(receivers)
            sent += receivers
    outcomes = medium.run(int(load.duration_s * NS_PER_S))
    return _result(load, sent, [one for one in outcomes if isinstance(one, AirFate)], packets)


def _result(load: Load, sent: int, fates: Sequence[AirFate], packets: int) -> Carried:
    came = [fate for fate in fates if fate.loss is None]
    receivers = sent / packets if sent else 1.0
    delays = sorted((fate.at_ns - fate.packet.at_ns) / NS_PER_S for fate in came)
    return Carried(
        load.offered_bps,
        sent,
        len(came),
        len(came) * 8 * load.length_bytes / load.duration_s / receivers,
        (sum(delays) / len(delays), delays[len(delays) // 2], delays[int(0.95 * (len(delays) - 1))])
        if delays
        else None,
        Counter(fate.loss for fate in fates if fate.loss is not None),
        sent - len(fates),
    )
