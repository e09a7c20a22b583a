"""A medium of delays: LTE, satellites and other networks of which only the way from end to end is known.

Each node has a line of its own into the network: a queue, a rate, and an outage that comes and goes. Nodes do not
disturb each other. Nothing is acknowledged; a sender has a `Reply` of a unicast only if its own queue dropped it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import exp, log
from statistics import NormalDist
from typing import Final

from channel.access.agenda import ACTS, SIGNAL_ENDS
from channel.access.media.medium import AccessMedium
from channel.access.packets import AirFrame, Loss
from channel.access.queue import QueueLimits
from channel.access.timing import NS_PER_S, BitRate
from channel.access.words import WordStream
from channel.access.world import Arrival, Piece, World
from channel.draws import Draws

NORMAL: Final = NormalDist()
NORMAL_95: Final = NORMAL.inv_cdf(0.95)
LEAST_S: Final = 1e-3
LONGEST_S: Final = 1e9
"""Of service or outage in the mean; 0 for no outage."""
LEAST_UNIFORM: Final = 2.0**-54
"""In place of a 0, which has no quantile."""


@dataclass(frozen=True, slots=True)
class WayDelay:
    """One-way delay from the end of a packet's transmission to its arrival: a least value and a lognormal rest.

    With u uniform and z the normal quantile: delay = least + (median - least) exp(s z(u)), where s is such that 95 %
    are at most ``most_ns``. If median and most are equal, the delay is constant.

    Attributes:
        least_ns: no packet is faster.
        median_ns: half are at most so late.
        most_ns: 95 % are at most so late.
    """

    least_ns: int
    median_ns: int
    most_ns: int

    def __post_init__(self) -> None:
        in_order = 0 <= self.least_ns <= self.median_ns <= self.most_ns
        if not in_order or (self.least_ns == self.median_ns < self.most_ns):
            raise ValueError(
                f"a delay of at least {self.least_ns} ns, median {self.median_ns} ns, 95 % {self.most_ns} ns: "
                "0 or more, rising, or median and 95 % equal for a constant one"
            )

    @classmethod
    def constant(cls, delay_ns: int) -> WayDelay:
        """The same for every packet."""
        return cls(delay_ns, delay_ns, delay_ns)

    def at(self, uniform: float) -> int:
        """The delay below which this share of all packets stays, ns."""
        if self.median_ns == self.most_ns:
            return self.median_ns
        rest_ns = self.median_ns - self.least_ns
        spread = log((self.most_ns - self.least_ns) / rest_ns) / NORMAL_95
        return self.least_ns + round(rest_ns * exp(spread * NORMAL.inv_cdf(max(uniform, LEAST_UNIFORM))))


@dataclass(frozen=True, slots=True)
class DelaySettings:
    """Of the lines of all nodes.

    Attributes:
        delay: of each packet at each of its receivers.
        rate_bps: at which a node's packets enter the network, one after the other.
        header_bytes: that each packet gets.
        good_s, bad_s: mean durations of service and of outage of a node, exponential; ``bad_s`` 0: no outage.
        keeps_order: whether a packet arrives no earlier than the one before it from the same sender: where packets
            follow each other within the spread of delays, they are later on average than the distribution says.
    """

    delay: WayDelay
    rate_bps: float = 10e6
    header_bytes: int = 0
    good_s: float = 60.0
    bad_s: float = 0.0
    keeps_order: bool = True

    def __post_init__(self) -> None:
        is_outage = self.bad_s == 0.0 or LEAST_S <= self.bad_s <= LONGEST_S
        if not (LEAST_S <= self.good_s <= LONGEST_S and is_outage):
            raise ValueError(
                f"service of {self.good_s:g} s, outage of {self.bad_s:g} s: from {LEAST_S:g} to {LONGEST_S:g}, the "
                "latter may be 0"
            )


class Outage:
    """When a node's line is down: two states of exponential durations, a process in time, in equilibrium at 0.

    Args:
        words: that durations are drawn from.
        good_s, bad_s: mean durations; ``bad_s`` 0: never down.
    """

    def __init__(self, words: WordStream, good_s: float, bad_s: float) -> None:
        self._words, self._means_s = words, (good_s, bad_s)
        self._is_down = words.next_uniform() < bad_s / (good_s + bad_s)
        self._until_ns = 0
        self._last()

    def is_down(self, at_ns: int) -> bool:
        """At an instant, which is not before that of the last call."""
        if not self._means_s[1]:
            return False
        while self._until_ns <= at_ns:
            self._is_down = not self._is_down
            self._last()
        return self._is_down

    def _last(self) -> None:
        """Draw how long the present state lasts."""
        mean_s = self._means_s[self._is_down]
        self._until_ns += max(1, round(-log(1.0 - self._words.next_uniform()) * mean_s * NS_PER_S))


class Delay(AccessMedium):
    """A network that takes time, and at times no packets.

    A packet waits in its sender's queue, leaves at the sender's rate, and arrives at each receiver after a delay of
    its own. It is lost where the world does not let it through, and for an outage: of the sender when it has left, of
    the receiver when it arrives, whose radio may be off by then. The world's delays of propagation are not added: the
    distribution has the whole way.

    Args:
        world: nodes, powers, losses.
        settings: of the lines.
        seed: of delays and outages.
        limits: of queues.
        max_length_bytes: the longest packet.

    Raises:
        ValueError: a rate that is not above 0.
    """

    def __init__(
        self,
        world: World,
        settings: DelaySettings,
        *,
        seed: int = 1,
        limits: QueueLimits | None = None,
        max_length_bytes: int = 65_535,
    ) -> None:
        super().__init__(world, limits or QueueLimits(), max_length_bytes)
        self.settings = settings
        self._draws = Draws(seed)
        self._line = BitRate(settings.rate_bps, header_bytes=settings.header_bytes)
        self._outages = {
            node: Outage(WordStream(self._draws, self.ids[node], "outage"), settings.good_s, settings.bad_s)
            for node in world.nodes
        }
        self._numbers = dict.fromkeys(world.nodes, 0)
        self._sends: set[int] = set()
        self._delays: dict[tuple[int, int], WordStream] = {}
        self._latest_ns: dict[tuple[int, int], int] = {}

    def _wake(self, node: int) -> None:
        if node in self._sends:
            return
        packet = self._next(node)
        if packet is None:
            return
        self._sends.add(node)
        line, now_ns, number = self._line, self.agenda.now_ns, self._numbers[node]
        self._numbers[node] += 1
        ended_ns = now_ns + line.duration_ns(packet.length_bytes)
        length_bytes = packet.length_bytes + line.header_bytes
        frame = AirFrame(node, number, "data", length_bytes, now_ns, ended_ns, packet)
        arrivals = {one.receiver: one for one in self.world.reach(frame)}
        self.agenda.at(ended_ns, SIGNAL_ENDS, node, self._left, frame, arrivals)

    def _left(self, frame: AirFrame, arrivals: Mapping[int, Arrival]) -> None:
        """A packet is in the network, unless its sender's line is down."""
        node, packet = frame.node, frame.packet
        assert packet is not None
        is_down = self._outages[node].is_down(self.agenda.now_ns)
        for receiver in self.receivers_of(packet):
            if is_down:
                self._book(packet, receiver, frame, 1, Loss.OUTAGE)
            elif receiver not in arrivals or not self._survives(frame, arrivals[receiver]):
                self._book(packet, receiver, frame, 1, Loss.NOISE)
            else:
                come_ns = self._come_ns(frame, receiver)
                self.agenda.at(come_ns, SIGNAL_ENDS, receiver, self._comes, frame, receiver)
        self._sends.discard(node)
        self.agenda.at(self.agenda.now_ns, ACTS, node, self._wake, node)

    def _survives(self, frame: AirFrame, arrival: Arrival) -> bool:
        whole = [Piece(frame.ended_ns - frame.started_ns, 0.0)]
        return self.world.survives(frame, arrival.receiver, arrival.power_mw, whole)[0]

    def _come_ns(self, frame: AirFrame, receiver: int) -> int:
        """When a packet that the network took arrives."""
        link = (frame.node, receiver)
        words = self._delays.get(link)
        if words is None:
            ends = (self.ids[each] for each in link)
            words = self._delays[link] = WordStream(self._draws, *ends, "delay")
        come_ns = self.agenda.now_ns + self.settings.delay.at(words.uniform(frame.number))
        if self.settings.keeps_order:
            come_ns = self._latest_ns[link] = max(come_ns, self._latest_ns.get(link, 0))
        return come_ns

    def _comes(self, frame: AirFrame, receiver: int) -> None:
        packet = frame.packet
        assert packet is not None
        now_ns = self.agenda.now_ns
        is_down, is_off = self._outages[receiver].is_down(now_ns), self.is_off(receiver, now_ns)
        self._book(packet, receiver, frame, 1, Loss.RADIO_OFF if is_off else Loss.OUTAGE if is_down else None)
