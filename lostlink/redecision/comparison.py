"""What two radios made of the same transmissions: per link, by cause, by distance."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bridge.record.tables.deliveries import FATES, FIGURES, delays_s
from channel.medium.ledger import BIN_WIDTH_M, BinSummary
from channel.medium.reception import DELIVERED
from lostlink.reading.links.counts import means
from lostlink.reading.rows import LINK, DeliveryRows, most_links, named_links

Rows = NDArray[np.intp] | slice
COUNTED = (*LINK, "radio", "sim_time_ns", "arrived_ns", "distance_m")


@dataclass(frozen=True, slots=True)
class LinkChange:
    """One directed link of a radio network; ``lost`` has a count for each cause that occurred.

    Attributes:
        radio: name of the network.
        delay_mean_before_s: from the sender's stamp to arrival, of what was delivered; None of nothing.
        delay_mean_after_s: likewise.
    """

    radio: str
    tx: str
    rx: str
    sent: int
    delivered_before: int
    delivered_after: int
    lost_before: dict[str, int]
    lost_after: dict[str, int]
    delay_mean_before_s: float | None
    delay_mean_after_s: float | None


@dataclass(frozen=True, slots=True)
class BinChange:
    """The packets of a directed link of a radio network over a bin of distance.

    Attributes:
        radio: name of the network.
        sent: so many, lost or not; those that no channel had to decide have no distance.
        delivered_before: of these, as recorded.
        delivered_after: as decided anew.
        predicted_after: the new radio's mean probability of delivery over the true geometries; None where packets take
            time on the air of the network, which loses and delays them besides.
    """

    radio: str
    tx: str
    rx: str
    distance_min_m: float
    distance_max_m: float
    sent: int
    delivered_before: int
    delivered_after: int
    predicted_after: float | None


@dataclass(frozen=True, slots=True)
class DecisionComparison:
    """Two radios side by side.

    Attributes:
        fates: how many there are in both.
        changed: how many of them differ.
        changes: from what to what, ``[{"before": cause, "after": cause, "packets": count}]``.
        differs: whether a fate, an instant of arrival, a power or an error rate differs, bit by bit, of those in both.
        not_compared: fates that only one side has: a killed run's files end at different ticks.
        links: per radio network and directed link.
        bins: per radio network, directed link and distance.
    """

    fates: int
    changed: int
    changes: tuple[dict[str, Any], ...]
    differs: bool
    not_compared: int
    links: tuple[LinkChange, ...]
    bins: tuple[BinChange, ...]

    @property
    def is_same(self) -> bool:
        """Whether nothing differs, and nothing is missing."""
        return not self.differs and not self.not_compared

    def as_plain(self) -> dict[str, Any]:
        """In plain types."""
        return {**asdict(self), "is_same": self.is_same}


def compare_decisions(
    before: DeliveryRows, after: DeliveryRows, bins: Mapping[str, Iterable[BinSummary]]
) -> DecisionComparison:
    """Compare what was with what is decided anew.

    Args:
        before: what was recorded, with ``radio``.
        after: of the same packets, likewise.
        bins: of the ledgers of networks on which packets take no time, by name, for what was predicted.
    """
    one, other = before.each(), after.each()
    orders, missing = _matched(one, other)
    same_figures = all(_same_bits(one.columns[f][orders[0]], other.columns[f][orders[1]]) for f in FIGURES)
    one, other = (side.only(COUNTED).at(order) for side, order in zip((one, other), orders, strict=True))
    fates = [side.columns["fate"] for side in (one, other)]
    pairs = np.zeros((len(FATES), len(FATES)), dtype=np.int64)
    np.add.at(pairs, tuple(fates), one.columns["packets"].astype(np.int64))
    changed = pairs.copy()
    np.fill_diagonal(changed, 0)
    return DecisionComparison(
        int(pairs.sum()),
        int(changed.sum()),
        _changes(changed),
        bool(changed.any())
        or not np.array_equal(one.columns["arrived_ns"], other.columns["arrived_ns"])
        or not same_figures,
        missing,
        _links(one, other),
        _bins(one, other, bins),
    )


def _matched(one: DeliveryRows, other: DeliveryRows) -> tuple[tuple[Rows, Rows], int]:
    """Where the rows of the same packets and receivers are on both sides, and how many packets are on one alone.

    Where all are in one order, as they are if nothing is cut, no row is copied.
    """
    keys = one.keys(), other.keys()
    if np.array_equal(*keys):
        return (slice(None), slice(None)), 0
    in_one, in_other = np.isin(keys[0], keys[1]), np.isin(keys[1], keys[0])
    missing = int(np.sum(one.columns["packets"][~in_one]) + np.sum(other.columns["packets"][~in_other]))
    return (_sorted(keys[0], in_one), _sorted(keys[1], in_other)), missing


def _sorted(keys: NDArray[np.int64], chosen: NDArray[np.bool_]) -> NDArray[np.intp]:
    """Where those chosen are, in the order of their keys."""
    order = np.argsort(keys, kind="stable")
    return order[chosen[order]]


def _changes(changed: NDArray[np.int64]) -> tuple[dict[str, Any], ...]:
    places = np.argwhere(changed).tolist()
    return tuple({"before": FATES[b], "after": FATES[a], "packets": int(changed[b, a])} for b, a in places)


def _same_bits(a: NDArray[np.float64], b: NDArray[np.float64]) -> bool:
    """Whether doubles are the same; NaN is NaN, whatever its bits."""
    one, other = (np.where(np.isnan(side), np.nan, side).view(np.int64) for side in (a, b))
    return bool(np.array_equal(one, other))


def _links(one: DeliveryRows, other: DeliveryRows) -> tuple[LinkChange, ...]:
    count = most_links(one)
    counts = [side.cells(side.link, count) for side in (one, other)]
    delays = [_mean_delays_s(side, count) for side in (one, other)]
    links = np.flatnonzero(counts[0].any(axis=-1))
    found = []
    for link, (radio, tx, rx) in zip(links.tolist(), _names(links, one), strict=True):
        was, is_now = (each[link] for each in counts)
        found.append(
            LinkChange(
                radio,
                tx,
                rx,
                int(was.sum()),
                int(was[DELIVERED]),
                int(is_now[DELIVERED]),
                _lost(was),
                _lost(is_now),
                *(side[link] for side in delays),
            )
        )
    return tuple(found)


def _names(links: NDArray[np.int64], rows: DeliveryRows) -> Iterator[tuple[str, str, str]]:
    """Of links by their numbers: radio network, sender and receiver."""
    return zip(*(values.tolist() for values in named_links(links, rows).values()), strict=True)


def _mean_delays_s(rows: DeliveryRows, count: int) -> list[float | None]:
    """Of each link; None where nothing was delivered."""
    found = means(delays_s(rows.columns), rows.link, count).tolist()
    return [None if math.isnan(mean_s) else mean_s for mean_s in found]


def _lost(counts: NDArray[np.int64]) -> dict[str, int]:
    return {
        cause: int(n) for i, (cause, n) in enumerate(zip(FATES, counts, strict=True)) if n and i != DELIVERED
    }


def _bins(
    one: DeliveryRows, other: DeliveryRows, predicted: Mapping[str, Iterable[BinSummary]]
) -> tuple[BinChange, ...]:
    """Of the same packets on both sides, which either has the distance of."""
    here, there = (side.columns["distance_m"] for side in (one, other))
    distance_m = np.where(np.isnan(there), here, there)
    placed = np.flatnonzero(~np.isnan(distance_m))
    number = np.floor_divide(distance_m[placed], BIN_WIDTH_M).astype(np.int64)
    span = int(number.max(initial=0)) + 1
    bins, which = np.unique(one.link[placed] * span + number, return_inverse=True)
    delivered = [side.is_delivered[placed] for side in (one, other)]
    counts = [
        np.bincount(which, each, len(bins)).astype(np.int64).tolist()
        for each in (np.ones(len(placed)), *delivered)
    ]
    chances = {
        (radio, row.tx, row.rx, row.distance_min_m): row.predicted
        for radio, rows in predicted.items()
        for row in rows
    }
    found = []
    low_m = (bins % span * BIN_WIDTH_M).tolist()
    for (radio, tx, rx), start_m, sent, before, after in zip(
        _names(bins // span, one), low_m, *counts, strict=True
    ):
        key = radio, tx, rx, start_m
        found.append(BinChange(*key, start_m + BIN_WIDTH_M, sent, before, after, chances.get(key)))
    return tuple(found)
