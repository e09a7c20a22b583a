"""Age of information and latency of links, in sim time.

The age of information at a receiver is the time since the newest packet that it has was generated: it grows by a second
per second, and falls when a newer packet comes (Kaul, Yates & Gruteser, "Real-time status: how often should one
update?", INFOCOM 2012). A packet is generated when it is transmitted, by its sender's stamp; it comes at the tick after
the one that settled it, which is when an agent has it. Its latency is the time between the two.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bridge.record.tables.schema import Columns
from lostlink.reading.rows import Deliveries, most_links

NS_PER_S: Final = 1e9
SHARE: Final = 0.95
NEEDED: Final = ("sim_time_ns", "received_ns")
"""Columns of the deliveries that this is computed from."""
Times = NDArray[np.int64]


class Age(NamedTuple):
    """How old the newest packet at a receiver was, over an interval of sim time.

    Attributes:
        mean_s: time average.
        p95_s: it was at most so old for 95 % of the time.
        peak_s: the greatest.
    """

    mean_s: float
    p95_s: float
    peak_s: float


class Sawtooth(NamedTuple):
    """The age of information of one link: from ``begin_ns`` to ``end_ns`` the newest packet is of ``newest_ns``."""

    begin_ns: Times
    end_ns: Times
    newest_ns: Times

    @property
    def age(self) -> Age:
        """Its figures; nan if it lasts no time."""
        low, high = (self.begin_ns - self.newest_ns) / NS_PER_S, (self.end_ns - self.newest_ns) / NS_PER_S
        if not low.size:
            return Age(np.nan, np.nan, np.nan)
        mean_s = float(((high - low) * (high + low)).sum() / 2.0 / (high - low).sum())
        return Age(mean_s, _quantile(low, high, SHARE), float(high.max()))

    def greatest(self, edges_ns: Times) -> NDArray[np.float64]:
        """The greatest age, s, in each of the periods between edges; nan where there is none."""
        found = np.full(len(edges_ns) - 1, -np.inf)
        if not self.end_ns.size:
            return np.full(len(edges_ns) - 1, np.nan)
        at = np.searchsorted(edges_ns, self.end_ns, side="left") - 1
        inside = (at >= 0) & (at < len(found))
        np.maximum.at(found, at[inside], (self.end_ns - self.newest_ns)[inside] / NS_PER_S)
        piece = np.searchsorted(self.begin_ns, edges_ns[1:], side="left") - 1
        reaches = (piece >= 0) & (edges_ns[1:] <= self.end_ns[np.maximum(piece, 0)])
        ends = (edges_ns[1:] - self.newest_ns[np.maximum(piece, 0)]) / NS_PER_S
        found = np.where(reaches, np.fmax(found, ends), found)
        return np.where(np.isfinite(found), found, np.nan)


def sawtooth(
    generated_ns: Times, received_ns: Times, begin_ns: int, end_ns: int, since_ns: int | None = None
) -> Sawtooth:
    """The age of information of one link from ``begin_ns`` to ``end_ns``.

    Args:
        generated_ns: when the packets that arrive were generated, in the order in which they came.
        received_ns: when they came, not falling; what comes after the end counts for nothing.
        begin_ns: from when on.
        end_ns: until when.
        since_ns: from when on age counts until a packet comes; None: from ``begin_ns``.
    """
    came = np.searchsorted(received_ns, end_ns, side="right")
    nothing_ns = begin_ns if since_ns is None else since_ns
    newest = np.concatenate([[nothing_ns], np.maximum.accumulate(generated_ns[:came])])
    begins = np.concatenate([[begin_ns], np.maximum(received_ns[:came], begin_ns)])
    ends = np.append(begins[1:], max(end_ns, begin_ns))
    lasts = ends > begins
    return Sawtooth(
        begins[lasts].astype(np.int64), ends[lasts].astype(np.int64), newest[lasts].astype(np.int64)
    )


def _quantile(low: NDArray[np.float64], high: NDArray[np.float64], share: float) -> float:
    """The age that is not exceeded for a share of the time: each piece passes from low to high evenly."""
    at = np.concatenate([low, high])
    order = np.argsort(at, kind="stable")
    at, pieces = at[order], np.cumsum(np.repeat([1, -1], len(low))[order])
    passed_s = np.concatenate([[0.0], np.cumsum(pieces[:-1] * np.diff(at))])
    return float(np.interp(share * passed_s[-1], passed_s, at))


class LinkTimes(NamedTuple):
    """When packets of one link were generated and came.

    Attributes:
        link: its number, as in `DeliveryRows`.
        first_ns: when its first packet was transmitted, whatever became of it.
        generated_ns: of those that were delivered, in the order in which they came.
        received_ns: when these came.
    """

    link: int
    first_ns: int
    generated_ns: Times
    received_ns: Times

    def sawtooth(self, end_ns: int) -> Sawtooth:
        """Its age of information from its first packet until ``end_ns``."""
        return sawtooth(self.generated_ns, self.received_ns, self.first_ns, end_ns)


def times_of(deliveries: Deliveries) -> list[LinkTimes]:
    """The times of each link that had a packet, by network, then sender, then receiver."""
    links, never_ns = most_links(deliveries), np.iinfo(np.int64).max
    first, came = np.full(links, never_ns), np.zeros(links, dtype=np.int64)
    for rows in deliveries.parts(*NEEDED):
        np.minimum.at(first, rows.link, rows.columns["sim_time_ns"])
        came += np.bincount(rows.link[rows.is_delivered], minlength=links)
    bounds = np.concatenate([[0], np.cumsum(came)])
    generated, received = np.empty((2, bounds[-1]), dtype=np.int64)
    after = bounds[:-1].copy()
    for rows in deliveries.parts(*NEEDED):
        mine = rows.at(rows.is_delivered)
        mine = mine.at(np.argsort(mine.link, kind="stable"))
        at = after[mine.link] + np.arange(len(mine)) - np.searchsorted(mine.link, mine.link)
        generated[at], received[at] = mine.columns["sim_time_ns"], mine.columns["received_ns"]
        after += np.bincount(mine.link, minlength=links)
    return [
        LinkTimes(link, int(first[link]), generated[begin:end], received[begin:end])
        for link, (begin, end) in enumerate(pairwise(bounds.tolist()))
        if first[link] < never_ns
    ]


def link_ages(times: Sequence[LinkTimes], end_ns: int) -> Columns:
    """A row per link: ``received``, ``mean_s``, ``p95_s``, ``peak_s``.

    Args:
        times: of the links.
        end_ns: until when; each link's interval begins with its first packet, whatever became of it.
    """
    received = [int(np.searchsorted(link.received_ns, end_ns, side="right")) for link in times]
    ages = [link.sawtooth(end_ns).age for link in times]
    return {"received": np.array(received, dtype=np.int64)} | _fields(Age, ages)


class Latency(NamedTuple):
    """Times from transmission to reception of packets that were delivered; nan of none."""

    mean_s: float
    p95_s: float
    max_s: float


def link_latencies(times: Sequence[LinkTimes]) -> Columns:
    """A row per link: ``delivered``, ``mean_s``, ``p95_s``, ``max_s``."""
    delivered = [len(link.received_ns) for link in times]
    found = [_latency((link.received_ns - link.generated_ns) / NS_PER_S) for link in times]
    return {"delivered": np.array(delivered, dtype=np.int64)} | _fields(Latency, found)


def _latency(late_s: NDArray[np.float64]) -> Latency:
    if not late_s.size:
        return Latency(np.nan, np.nan, np.nan)
    return Latency(float(late_s.mean()), float(np.quantile(late_s, SHARE)), float(late_s.max()))


def _fields(kind: type[Age] | type[Latency], found: Sequence[Age | Latency]) -> Columns:
    table = np.array(found, dtype=np.float64).reshape(-1, len(kind._fields))
    return {name: table[:, i] for i, name in enumerate(kind._fields)}
