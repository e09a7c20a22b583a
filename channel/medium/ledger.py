"""The ledger: what was sent, what arrived and what was lost to which cause, per directed link. It balances."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from channel.checks import FloatArray
from channel.link.tables.steps import STEPS_PER_ONE
from channel.medium.addressees import Addressees
from channel.medium.bins import Bins
from channel.medium.reception import DELIVERED, EVERYBODY, FATES, UNDECIDED_FROM, Packets, Receptions
from channel.numbers.intervals import binomial_interval

BIN_WIDTH_M = 20.0
BINS_AT_ONCE = 4096
"""Bins whose intervals are computed in one call."""
MAX_BINS = 1 << 32
"""Of one link."""


class LedgerError(Exception):
    """The books do not balance: a defect of the program, never of its input."""


@dataclass(slots=True)
class LinkAccount:
    """Counts of one directed link. `lost` has a count for each cause that occurred."""

    sent: int = 0
    delivered: int = 0
    lost: Counter[str] = field(default_factory=Counter)

    @property
    def in_flight(self) -> int:
        """Packets sent whose fate is open."""
        return self.sent - self.delivered - self.lost.total()


class BinSummary(NamedTuple):
    """One distance bin of one directed link.

    Attributes:
        tx: transmitting node.
        rx: receiving node.
        distance_min_m: lower edge, inside.
        distance_max_m: upper edge, outside.
        sent: packets settled in the bin.
        delivered: of these.
        measured: delivered / sent.
        predicted: mean of the model's probability of delivery over the true geometries of these packets.
        ci99_low: lower end of the 99 % interval of a binomial ratio around `predicted`.
        ci99_high: upper end.
    """

    tx: str
    rx: str
    distance_min_m: float
    distance_max_m: float
    sent: int
    delivered: int
    measured: float
    predicted: float
    ci99_low: float
    ci99_high: float

    @property
    def within(self) -> bool:
        """Whether the measured ratio lies in the interval."""
        return self.ci99_low <= self.measured <= self.ci99_high


class Ledger:
    """Books of one medium, in whole numbers.

    Args:
        nodes: names of all nodes, in the order of the medium's.
        causes: of losses that are not the channel's, such as the host's.
        addressees: who packets are for; nodes and everybody unless given.

    Attributes:
        causes: names of what can become of a packet: the channel's fates by their numbers, then the other causes.
        sent: packets booked out, by transmitter and intended receiver, shape (nodes, nodes).
        settled: of these, by what became of them, shape (nodes, nodes, causes).
    """

    def __init__(
        self,
        nodes: Iterable[str],
        causes: Iterable[str] = (),
        addressees: Addressees | None = None,
    ) -> None:
        self.nodes = tuple(nodes)
        self.causes = (*(fate.value for fate in FATES), *causes)
        count = len(self.nodes)
        self.sent = np.zeros((count, count), dtype=np.int64)
        self.settled = np.zeros((count, count, len(self.causes)), dtype=np.int64)
        self._others = ~np.eye(count, dtype=bool)
        self._addressees = addressees or Addressees(self.nodes)
        self._bins = Bins(3)

    def send(self, packets: Packets) -> None:
        """Book packets out to their intended receivers."""
        everybody = packets.to == EVERYBODY
        count = len(self.nodes)
        self.sent += np.bincount(packets.tx[everybody], minlength=count)[:, np.newaxis] * self._others
        if not everybody.all():
            some = packets.at(~everybody)
            row, rx = self._addressees.links(some)
            np.add.at(self.sent, (some.tx[row], rx), 1)

    def settle(self, receptions: Receptions) -> None:
        """Book the fates of packets that were booked out before, in the distance bins, too."""
        self.book(receptions)
        self.place(receptions)

    def book(self, receptions: Receptions) -> None:
        """Book the fates of packets that were booked out before, but not in the distance bins."""
        link = receptions.tx * len(self.nodes) + receptions.rx
        np.add.at(self.settled.reshape(-1), link * len(self.causes) + receptions.fate, 1)

    def place(self, receptions: Receptions) -> None:
        """Book what the channel let through and what not in the distance bins alone."""
        link = receptions.tx * len(self.nodes) + receptions.rx
        placed = receptions.fate < UNDECIDED_FROM
        distance_m, arrived = receptions.distance_m, receptions.fate == DELIVERED
        steps = np.rint(receptions.probability_of_delivery * STEPS_PER_ONE).astype(np.int64)
        if not placed.all():
            link, distance_m, arrived, steps = (
                link[placed],
                distance_m[placed],
                arrived[placed],
                steps[placed],
            )
        number = np.minimum(np.floor_divide(distance_m, BIN_WIDTH_M), MAX_BINS - 1).astype(np.int64)
        self._bins.add(link * MAX_BINS + number, np.ones_like(steps), arrived.astype(np.int64), steps)

    def lose(self, tx: str, cause: str, count: int = 1, to: str | None = None) -> None:
        """Book packets out and lost at once: to a cause that is not the channel's, such as the host.

        Args:
            tx: transmitting node.
            cause: one of `causes`.
            count: how many packets.
            to: the one addressee of all; everybody if not given.
        """
        sender, row = self.nodes.index(tx), self.causes.index(cause)
        receivers = self._others[sender].copy() if to is None else np.equal(self.nodes, to)
        self.sent[sender, receivers] += count
        self.settled[sender, receivers, row] += count

    def account(self, tx: str, rx: str) -> LinkAccount:
        """Return the counts of one directed link."""
        ends = self.nodes.index(tx), self.nodes.index(rx)
        counts = self.settled[ends].tolist()
        lost = {
            cause: n
            for i, (cause, n) in enumerate(zip(self.causes, counts, strict=True))
            if n and i != DELIVERED
        }
        return LinkAccount(int(self.sent[ends]), counts[DELIVERED], Counter(lost))

    @property
    def links(self) -> dict[tuple[str, str], LinkAccount]:
        """The counts of each directed link on which something was booked, by the names of its ends."""
        booked = np.argwhere((self.sent > 0) | self.settled.any(axis=-1)).tolist()
        ends = [(self.nodes[tx], self.nodes[rx]) for tx, rx in booked]
        return {link: self.account(*link) for link in ends}

    def check(self, in_flight: int | None = None) -> None:
        """Make sure that sent = delivered + lost + in flight on every link.

        Args:
            in_flight: what the medium says is open over all links, if known.

        Raises:
            LedgerError: it is not so; the error names the link and its counts.
        """
        still_open = self.sent - self.settled.sum(axis=-1)
        for tx, rx in np.argwhere(still_open < 0).tolist():
            link = self.nodes[tx], self.nodes[rx]
            raise LedgerError(
                f"link {link[0]} -> {link[1]}: more fates than packets sent: {self.account(*link)}"
            )
        total = int(still_open.sum())
        if in_flight is not None and total != in_flight:
            raise LedgerError(f"{total} fates open by the books, {in_flight} in the medium")

    def bins(self, progress: Callable[[float], object] = lambda _: None) -> list[BinSummary]:
        """Return the distance bins in order of the ends' names and distance, those with packets in them.

        Args:
            progress: called now and then with the share that is done: a large fleet has a hundred thousand bins.
        """
        keys, counts = self._bins.rows()
        link, number = np.divmod(keys, MAX_BINS)
        order = self._by_name(link)
        link, number, counts = link[order], number[order], counts[:, order]
        summaries: list[BinSummary] = []
        for begin in range(0, keys.size, BINS_AT_ONCE):
            progress(begin / keys.size)
            part = slice(begin, begin + BINS_AT_ONCE)
            summaries += self._summaries(link[part], number[part] * BIN_WIDTH_M, counts[:, part])
        return summaries

    def _by_name(self, link: NDArray[np.int64]) -> NDArray[np.intp]:
        """Return the order of rows, rising by link and distance, in which the links are sorted by names."""
        rank = np.empty(len(self.nodes), dtype=np.intp)
        rank[sorted(range(len(self.nodes)), key=self.nodes.__getitem__)] = np.arange(len(self.nodes))
        tx, rx = np.divmod(link, max(len(self.nodes), 1))
        return np.lexsort((rank[rx], rank[tx]))

    def _summaries(
        self, link: NDArray[np.int64], edge_m: FloatArray, counts: NDArray[np.int64]
    ) -> list[BinSummary]:
        sent, delivered, steps = counts
        predicted = np.clip(steps / STEPS_PER_ONE / sent, 0.0, 1.0)
        low, high = binomial_interval(sent, predicted)
        columns = [edge_m, edge_m + BIN_WIDTH_M, sent, delivered, delivered / sent, predicted, low, high]
        ends = [divmod(each, len(self.nodes)) for each in link.tolist()]
        rows = zip(ends, *(column.tolist() for column in columns), strict=True)
        return [BinSummary(self.nodes[tx], self.nodes[rx], *numbers) for (tx, rx), *numbers in rows]
