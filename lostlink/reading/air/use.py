"""Use of the air: what was offered to a network, and how long packets waited, over time. Computed from the deliveries.

The load offered is that of all packets that were given to the radio, once each whoever they were for, as a share of
the time that the network has (`Capacity.packet_s`): above 1 it cannot carry them. What was lost before the radio
(``transport``, ``too_long``) is no load. Payloads are lengths as the error model counts them, less its overhead.

The air is in use while a frame is on it: durations of distinct transmissions are added up, so that frames of several
senders at once count several times. Of a packet that was tried more than once the record has the last frame; each
attempt counts as long as that. Of packets that share a frame, as on SiK radios, that with fewest attempts counts: the
rest of another was in a frame that is there already. Acknowledgements, preambles of slots and what is no packet are not
in it.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bridge.record.tables.deliveries import delays_s
from lostlink.reading.air.capacity import Capacity
from lostlink.reading.rows import DeliveryRows

NS_PER_S: Final = 1e9
NEEDED: Final = (
    "radio",
    "sim_time_ns",
    "seq",
    "length_bytes",
    "entered_ns",
    "started_ns",
    "ended_ns",
    "arrived_ns",
    "attempts",
)
"""Columns that `DeliveryRows` have to have for this."""
OF_PACKETS: Final = ("tx", "seq", "fate", "length_bytes", "sim_time_ns")
OF_FRAMES: Final = ("tx", "entered_ns", "started_ns", "ended_ns", "attempts")
BUSY_NS: Final = 10_000_000_000
"""A network is busiest in a time of so long: a queue that holds more than this is no radio's."""
TRIED_MAX: Final = 16
"""So many lengths are tried on a medium, at most: a run may have hundreds, as of compressed pictures."""
SHARES: Final = (0.5, 0.95)
Numbers = NDArray[np.float64]
Whole = NDArray[np.int64]


def edges_of(end_ns: int, period_ns: int) -> Whole:
    """Edges of periods that are a run: of ``period_ns``, and the last also has what is left, or all of a short run."""
    begins = np.arange(max(1, end_ns // period_ns), dtype=np.int64) * period_ns
    return np.append(begins, max(end_ns, 1))


def places_in(edges_ns: Whole, at_ns: Whole) -> NDArray[np.intp]:
    """The period of each instant; the first and the last have what is outside."""
    return np.clip(np.searchsorted(edges_ns, at_ns, side="right") - 1, 0, len(edges_ns) - 2)


def durations_s(edges_ns: Whole) -> Numbers:
    """Of the periods."""
    return np.asarray(np.diff(edges_ns) / NS_PER_S, dtype=np.float64)


def busiest_per_s(at_ns: Whole, values: Numbers, group: Whole, groups: int, end_ns: int) -> Numbers:
    """The greatest sum that each group has within `BUSY_NS` anywhere in a run, over that time, 1/s; shape (groups,).

    Args:
        at_ns: of each value.
        values: at least 0.
        group: of each value; -1: of none.
        groups: how many there are.
        end_ns: the end of the run; of a shorter one all counts.
    """
    period_ns, found = min(BUSY_NS, max(end_ns, 1)), np.zeros(groups)
    order = np.lexsort((at_ns, group))
    begins = np.searchsorted(group[order], np.arange(groups + 1))
    for number, (begin, end) in enumerate(itertools.pairwise(begins.tolist())):
        mine = order[begin:end]
        sums = np.concatenate([[0.0], np.cumsum(values[mine])])
        after = np.searchsorted(at_ns[mine], at_ns[mine] + period_ns)
        found[number] = (sums[after] - sums[:-1]).max(initial=0.0)
    return np.asarray(found / (period_ns / NS_PER_S), dtype=np.float64)


@dataclass(frozen=True, slots=True)
class Offered:
    """Packets that were given to the radio, once each.

    Attributes:
        at_ns: when, by the sender's stamp.
        tx: place of the sender.
        payload_bytes: of each.
        need_s: the time that each needs of every sharer that it counts for, shape (2, packets).
        sharer: whose time that is, by number, likewise: of those who share the network's (`Capacity.sharers`), and of
            the sender's own part of that, where it has one; -1: nobody's.
        sharers: how many such numbers there are; senders' own parts are the last, one for each node.
        nodes: how many there are.
    """

    at_ns: Whole
    tx: Whole
    payload_bytes: Whole
    need_s: Numbers
    sharer: Whole
    sharers: int
    nodes: int

    def bits_per_s(self, edges_ns: Whole) -> Numbers:
        """Payload of all packets in each period."""
        place = places_in(edges_ns, self.at_ns)
        return np.bincount(place, 8.0 * self.payload_bytes, len(edges_ns) - 1) / durations_s(edges_ns)

    def shares(self, edges_ns: Whole) -> Numbers:
        """Of the network's time in each period; if not all share it, that of the busiest group or sender."""
        need_s = self._sums(self.need_s, edges_ns).max(axis=1, initial=0.0)
        return np.asarray(need_s / durations_s(edges_ns), dtype=np.float64)

    def busiest_share(self, end_ns: int) -> float:
        """Of the network's time in the busiest `BUSY_NS` of a run; if not all share it, that of the busiest's."""
        at_ns = np.tile(self.at_ns, len(self.sharer))
        need_s, sharer = self.need_s.ravel(), self.sharer.ravel()
        return float(busiest_per_s(at_ns, need_s, sharer, self.sharers, end_ns).max(initial=0.0))

    def share_of_ticks(self, tick_ns: int) -> float:
        """Of the network's time in those ticks in which several nodes gave it packets; of the busiest group."""
        counted = (self.sharer >= 0) & (self.need_s > 0.0)
        sharer, need_s = self.sharer[counted], self.need_s[counted]
        tick, tx = (
            np.broadcast_to(each, self.sharer.shape)[counted] for each in (self.at_ns // tick_ns, self.tx)
        )
        cell = tick * self.sharers + sharer
        cells, senders = np.unique(np.unique(cell * self.nodes + tx) // self.nodes, return_counts=True)
        crowded = cells[senders > 1]
        met = np.isin(cell, crowded)
        used_s = np.bincount(crowded % self.sharers, minlength=self.sharers) * tick_ns / NS_PER_S
        need_of_each_s = np.bincount(sharer[met], need_s[met], self.sharers)
        return float((need_of_each_s / np.maximum(used_s, tick_ns / NS_PER_S)).max(initial=0.0))

    def busiest(self, whole_ns: Whole) -> tuple[float | None, bool]:
        """Payload that the network carries of the packets of the busiest sharer, and whether that is a sender's own.

        Args:
            whole_ns: edges of the one period that is the run.
        """
        payload_bits = np.where(self.need_s > 0.0, 8.0 * self.payload_bytes, 0.0)  # not of what finds no room
        (need_s,), (bits,) = self._sums(self.need_s, whole_ns), self._sums(payload_bits, whole_ns)
        if not need_s.any():
            return None, False
        busiest = int(np.argmax(need_s))
        return float(bits[busiest] / need_s[busiest]), busiest >= self.sharers - self.nodes

    def _sums(self, values: Numbers, edges_ns: Whole) -> Numbers:
        """Of a value of each packet and sharer in each period, shape (periods, sharers)."""
        counted, periods = self.sharer >= 0, len(edges_ns) - 1
        place = np.broadcast_to(places_in(edges_ns, self.at_ns), self.sharer.shape)
        cells = place[counted] * self.sharers + self.sharer[counted]
        sums = np.bincount(cells, values[counted], periods * self.sharers)
        return np.asarray(sums, dtype=np.float64).reshape(periods, self.sharers)


def packet_rows(rows: DeliveryRows) -> DeliveryRows:
    """A row per packet, fate and length of rows with `NEEDED`, in their order, which `offered_of` takes for all."""
    c = rows.columns
    longest = int(c["length_bytes"].max(initial=0)) + 1
    kinds, kind = np.unique(c["fate"] * longest + c["length_bytes"], return_inverse=True)
    packet = c["tx"].astype(np.int64) * (int(c["seq"].max(initial=0)) + 1) + c["seq"]
    _, first = np.unique(packet * len(kinds) + kind, return_index=True)
    return rows.only(OF_PACKETS).at(np.sort(first))


def offered_of(rows: DeliveryRows, capacity: Capacity) -> Offered:
    """What was offered to a network, of rows with `NEEDED`."""
    given = rows.at(~rows.is_gap)
    tx, seq = given.columns["tx"].astype(np.int64), given.columns["seq"]
    _, first = np.unique(tx * (int(seq.max(initial=0)) + 1) + seq, return_index=True)
    once, nodes = given.at(first), rows.nodes
    payload_bytes = payloads_of(once, capacity)
    tried = _tried(payload_bytes, capacity)
    as_long = np.maximum(payload_bytes, 1) / np.maximum(tried, 1)
    need_s = as_long * _for_each(tx[first], tried, lambda tx, length: capacity.packet_s(nodes[tx], length))
    own_s = as_long * _for_each(tx[first], tried, lambda tx, length: capacity.own_s(nodes[tx], length))
    number = {node: number for number, ids in enumerate(capacity.sharers) for node in ids}
    shared = np.array([number.get(node, -1) for node in nodes], dtype=np.int64)[tx[first]]
    own = np.where(own_s > 0.0, len(capacity.sharers) + tx[first], -1)
    return Offered(
        once.columns["sim_time_ns"],
        tx[first],
        payload_bytes,
        np.stack([need_s, own_s]),
        np.stack([shared, own]),
        len(capacity.sharers) + len(nodes),
        len(nodes),
    )


def _tried(payload_bytes: Whole, capacity: Capacity) -> Whole:
    """Payloads that stand for those of packets, by byte: where each length is tried, the nearest of `TRIED_MAX`."""
    fits = payload_bytes <= capacity.max_length_bytes
    if not capacity.is_tried or len(np.unique(payload_bytes[fits])) <= TRIED_MAX:
        return payload_bytes
    shares = (np.arange(TRIED_MAX) + 0.5) / TRIED_MAX
    tried = np.unique(np.quantile(payload_bytes[fits], shares, method="nearest"))
    nearest = tried[np.searchsorted((tried[1:] + tried[:-1]) / 2, payload_bytes)]
    return np.where(fits, nearest, payload_bytes)


def payloads_of(rows: DeliveryRows, capacity: Capacity) -> Whole:
    """The payload of each row's packet, bytes."""
    nodes, tx = rows.nodes, rows.columns["tx"].astype(np.int64)
    counted = rows.columns["length_bytes"].astype(np.int64)
    found = _for_each(tx, counted, lambda tx, length: capacity.payload_bytes(nodes[tx], length))
    return found.astype(np.int64)


def _for_each(tx: Whole, length_bytes: Whole, figure: Callable[[int, int], float]) -> Numbers:
    """A figure of a sender and a length, for each packet; it is asked for once for each two."""
    longest = int(length_bytes.max(initial=0)) + 1
    kinds, place = np.unique(tx * longest + length_bytes, return_inverse=True)
    figures = [figure(*divmod(kind, longest)) for kind in kinds.tolist()]
    return np.array(figures, dtype=np.float64)[place]


class FrameColumns(NamedTuple):
    """Distinct transmissions, by sender and begin.

    Attributes:
        started_ns, ended_ns: of the last attempt.
        waited_s: from when its packet entered the radio until that.
        attempts: how often the packet was on the air.
    """

    started_ns: Whole
    ended_ns: Whole
    waited_s: Numbers
    attempts: Whole

    def use(self, edges_ns: Whole) -> Numbers:
        """The share of each period in which frames are on the air, added up over senders."""
        busy_ns = np.diff(
            _passed(edges_ns, self.started_ns, self.attempts)
            - _passed(edges_ns, self.ended_ns, self.attempts)
        )
        return np.asarray(busy_ns / NS_PER_S / durations_s(edges_ns), dtype=np.float64)

    def waits(self, edges_ns: Whole) -> Numbers:
        """`SHARES` of waits in each period, s, shape (SHARES, periods)."""
        return quantiles(places_in(edges_ns, self.started_ns), self.waited_s, len(edges_ns) - 1)


def _passed(at_ns: Whole, since_ns: Whole, weights: Whole) -> Numbers:
    """The time that has passed at each instant since all those before it, ns, by weight."""
    order = np.argsort(since_ns, kind="stable")
    since, weight = since_ns[order], weights[order].astype(np.float64)
    before = np.searchsorted(since, at_ns, side="left")
    count = np.concatenate([[0.0], np.cumsum(weight)])[before]
    total = np.concatenate([[0.0], np.cumsum(weight * since)])[before]
    return np.asarray(at_ns * count - total, dtype=np.float64)


def frame_rows(rows: DeliveryRows) -> DeliveryRows:
    """A row for each transmission in rows with `NEEDED`, which `frames_of` takes for all of them."""
    c = rows.columns
    sent = np.flatnonzero((c["started_ns"] >= 0) & (c["ended_ns"] > c["started_ns"]))
    key = c["started_ns"][sent] * len(rows.nodes) + c["tx"][sent]
    fewest = np.argsort(c["attempts"][sent], kind="stable")
    _, first = np.unique(key[fewest], return_index=True)
    return rows.only(OF_FRAMES).at(sent[fewest[first]])


def frames_of(rows: DeliveryRows) -> FrameColumns:
    """The transmissions in rows with `NEEDED`; none if packets take no time."""
    c = frame_rows(rows).columns
    started, ended, entered, attempts = (
        c[name] for name in ("started_ns", "ended_ns", "entered_ns", "attempts")
    )
    return FrameColumns(
        started, ended, (started - entered) / NS_PER_S, np.maximum(attempts, 1).astype(np.int64)
    )


class Delays(NamedTuple):
    """Of packets that were delivered: when each arrived, and how long after its sender's stamp."""

    arrived_ns: Whole
    delay_s: Numbers

    def over_time(self, edges_ns: Whole) -> Numbers:
        """`SHARES` of delays in each period, s, shape (SHARES, periods)."""
        return quantiles(places_in(edges_ns, self.arrived_ns), self.delay_s, len(edges_ns) - 1)


def delays_of(rows: DeliveryRows) -> Delays:
    """The delays in rows with `NEEDED`, one for each receiver. With `ideal` all are 0: latency is another figure."""
    delay_s = delays_s(rows.columns)
    came = np.flatnonzero(~np.isnan(delay_s))
    return Delays(rows.columns["arrived_ns"][came], delay_s[came])


def quantiles(place: NDArray[np.intp], values: Numbers, periods: int) -> Numbers:
    """The least value that a share of each period's values do not exceed, shape (SHARES, periods); nan of none."""
    order = np.lexsort((values, place))
    values = values[order]
    begins = np.searchsorted(place[order], np.arange(periods + 1))
    counts = np.diff(begins)
    found = np.full((len(SHARES), periods), np.nan)
    has_any = counts > 0
    for row, share in enumerate(SHARES):
        at = begins[:-1] + np.maximum(np.ceil(share * counts - 1e-9).astype(np.int64) - 1, 0)
        found[row, has_any] = values[at[has_any]]
    return found


class ReceivedBits(NamedTuple):
    """Payload that came: when, at which node, and how many bits, exact."""

    arrived_ns: Whole
    rx: Whole
    bits: Numbers

    def most_per_s(self, nodes: int, end_ns: int) -> Numbers:
        """What each node received in its busiest `BUSY_NS` of a run, shape (nodes,)."""
        return busiest_per_s(self.arrived_ns, self.bits, self.rx, nodes, end_ns)


def received_of(rows: DeliveryRows, capacity: Capacity) -> ReceivedBits:
    """What was received of rows with `NEEDED`, by the time of arrival; what comes to a node at once is added up."""
    came, nodes = rows.at(rows.is_delivered), len(rows.nodes)
    bits = np.asarray(8.0 * payloads_of(came, capacity), dtype=np.float64)
    keys, place = np.unique(came.columns["arrived_ns"] * nodes + came.columns["rx"], return_inverse=True)
    sums = np.asarray(np.bincount(place, bits, len(keys)), dtype=np.float64)
    return ReceivedBits(keys // nodes, keys % nodes, sums)
