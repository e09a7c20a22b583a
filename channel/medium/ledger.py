"""The ledger: what was sent, what arrived and what was lost to which cause, per directed link. It balances."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from channel.checks import ChannelInputError
from channel.intervals import binomial_interval
from channel.medium.reception import Fate, Reception

BIN_WIDTH_M = 20.0
BINS_AT_ONCE = 4096
"""Bins whose intervals are computed in one call."""


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
    """Books of one medium.

    Args:
        bin_width_m: width of the distance bins.
    """

    def __init__(self, nodes=(), bin_width_m: float = BIN_WIDTH_M) -> None:
        self.nodes = nodes
        if not bin_width_m > 0.0:
            raise ChannelInputError("bin_width_m", bin_width_m, "> 0")
        self.bin_width_m = bin_width_m
        self.links: dict[tuple[str, str], LinkAccount] = {}
        self._bins: dict[tuple[str, str, int], list[float]] = {}

    def sent(self, tx: str, receivers: Iterable[str]) -> None:
        """Book one packet out to each intended receiver."""
        for rx in receivers:
            self._account(tx, rx).sent += 1

    def send(self, packets):
        for tx in packets.tx.tolist():
            self.sent(self.nodes[tx], [n for i, n in enumerate(self.nodes) if i != tx])

    def counts(self, tx, rx):
        a = [self._account(self.nodes[t], self.nodes[r]) for t, r in zip(tx, rx)]
        return np.array([x.sent for x in a], dtype=np.int64), np.array(
            [x.delivered for x in a], dtype=np.int64
        )

    def settle(self, r):
        from channel.medium.reception import FATES

        p = r.packets
        self.settle_rows(
            [
                Reception(
                    int(p.sim_time_ns[i]),
                    self.nodes[p.tx[i]],
                    self.nodes[r.rx[k]],
                    int(p.seq[i]),
                    0,
                    float(r.distance_m[k]),
                    0.0,
                    0.0,
                    0.0,
                    FATES[r.fate[k]],
                    float(r.probability_of_delivery[k]),
                )
                for k, i in enumerate(r.packet.tolist())
            ]
        )

    def settle_rows(self, receptions: Iterable[Reception]) -> None:
        """Book the fates of packets that were booked out before."""
        for reception in receptions:
            account = self._account(reception.tx, reception.rx)
            if reception.fate is Fate.DELIVERED:
                account.delivered += 1
            else:
                account.lost[reception.fate.value] += 1
            self._book_bin(reception)

    def lose(self, tx, to, cause, count):
        for i, rx in enumerate(self.nodes):
            if i == tx or (to >= 0 and i != to):
                continue
            account = self._account(self.nodes[tx], rx)
            account.sent += count
            account.lost[cause] += count

    def check(self, in_flight: int | None = None) -> None:
        """Make sure that sent = delivered + lost + in flight on every link.

        Args:
            in_flight: what the medium says is open over all links, if known.

        Raises:
            LedgerError: it is not so; the error names the link and its counts.
        """
        for (tx, rx), account in self.links.items():
            if account.in_flight < 0:
                raise LedgerError(f"link {tx} -> {rx}: more fates than packets sent: {account}")
        total = sum(account.in_flight for account in self.links.values())
        if in_flight is not None and total != in_flight:
            raise LedgerError(f"{total} fates open by the books, {in_flight} in the medium")

    def bins(self, progress: Callable[[float], object] = lambda _: None) -> list[BinSummary]:
        """Return the distance bins in order of link and distance, those with packets in them.

        Args:
            progress: told which share is done, now and then: a large fleet has a hundred thousand bins.
        """
        rows = sorted(self._bins.items())
        summaries: list[BinSummary] = []
        for begin in range(0, len(rows), BINS_AT_ONCE):
            progress(begin / len(rows))
            summaries += self._summaries(rows[begin : begin + BINS_AT_ONCE])
        return summaries

    def _summaries(self, rows: list[tuple[tuple[str, str, int], list[float]]]) -> list[BinSummary]:
        sent, delivered, expected = np.array([row for _, row in rows]).T
        predicted = np.clip(expected / sent, 0.0, 1.0)
        low, high = binomial_interval(sent, predicted)
        measured = delivered / sent
        return [
            BinSummary(
                tx=tx,
                rx=rx,
                distance_min_m=index * self.bin_width_m,
                distance_max_m=index * self.bin_width_m + self.bin_width_m,
                sent=int(row[0]),
                delivered=int(row[1]),
                measured=float(measured[i]),
                predicted=float(predicted[i]),
                ci99_low=float(low[i]),
                ci99_high=float(high[i]),
            )
            for i, ((tx, rx, index), row) in enumerate(rows)
        ]

    def _account(self, tx: str, rx: str) -> LinkAccount:
        account = self.links.get((tx, rx))
        if account is None:
            account = self.links[tx, rx] = LinkAccount()
        return account

    def _book_bin(self, reception: Reception) -> None:
        if reception.fate is Fate.NO_POSITION:
            return
        key = (reception.tx, reception.rx, int(reception.distance_m // self.bin_width_m))
        row = self._bins.setdefault(key, [0.0, 0.0, 0.0])
        row[0] += 1.0
        row[1] += reception.fate is Fate.DELIVERED
        row[2] += reception.probability_of_delivery
