"""The use of the air of each radio network over sim time: frames, waiting, delays. From the fates of packets.

As `lostlink.reading.air.use` has it of a whole record: durations of distinct transmissions are added up, with the
attempts of the packet in it that had fewest, each as long as the last. Where nodes hand packets on, fates have the
transmission that decided alone, and nothing of other hops and of originator messages: of such networks there are delays
alone.
"""

from __future__ import annotations

from collections.abc import Set
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bridge.bus.messages import Fates

SPAN_NS = 1_000_000_000
"""Of one sum over time, at first; it doubles when there are too many."""
SPANS_MAX = 600
DELIVERED = 0
"""Place of `delivered` among the causes of `Fates`."""
AIR_S, PACKETS, WAITS_S, ARRIVED, DELAYS_S = range(5)
"""Rows of a network's sums."""
Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class AirSeries:
    """One network over sim time, shape (T,) each.

    Attributes:
        time_s: begins of spans.
        use: share of the time in which frames are on the air, added up over senders. NaN where nodes hand packets on.
        waiting: packets that wait to be sent, on average. NaN as above.
        wait_s: mean time from when a packet enters its radio until its last attempt; NaN if none was sent, or as above.
        delay_s: mean time from the sender's stamp until arrival; NaN without an arrival.
    """

    time_s: Floats
    use: Floats
    waiting: Floats
    wait_s: Floats
    delay_s: Floats


class AirHistory:
    """What has been on the air since somebody looks, by network; nothing of those where packets take no time.

    Args:
        nodes: how many there are.
        routed: networks whose nodes hand packets on.
    """

    def __init__(self, nodes: int, routed: Set[str] = frozenset()) -> None:
        self._nodes, self._routed = nodes, routed
        self._sums: dict[str, Floats] = {}
        self._newest_ns: dict[str, NDArray[np.int64]] = {}
        """By network and sender: when the newest frame started. A radio sends one frame after the other."""
        self._span_ns = SPAN_NS
        self._begin_ns = self._end_ns = -1

    @property
    def networks(self) -> list[str]:
        """Those that have had a frame, by name."""
        return sorted(self._sums)

    @property
    def routed(self) -> list[str]:
        """Those of them whose nodes hand packets on, by name."""
        return [name for name in self.networks if name in self._routed]

    def take(self, fates: Fates) -> None:
        """Take what became of the packets of a tick."""
        if len(fates.started_ns) != len(fates.fate) or len(fates.node) != self._nodes:
            return  # of a record from before there were any
        self._end_ns = fates.header.stamp.ns
        if self._begin_ns < 0:
            self._begin_ns = self._end_ns
        while self._end_ns // self._span_ns >= SPANS_MAX:
            self._widen()
        radio = np.asarray(fates.radio)
        was_sent = np.asarray(fates.ended_ns) > np.asarray(fates.started_ns)
        for place, name in enumerate(fates.network):
            rows = np.flatnonzero(was_sent & (radio == place))
            if rows.size:
                self._take(name, fates, rows)

    def _take(self, name: str, fates: Fates, rows: NDArray[np.intp]) -> None:
        sums = self._sums.setdefault(name, np.zeros((5, SPANS_MAX)))
        newest_ns = self._newest_ns.setdefault(name, np.full(self._nodes, -1))
        rows = rows[np.argsort(np.asarray(fates.attempts)[rows], kind="stable")]
        tx, seq, entered_ns, started_ns, ended_ns, attempts = (
            np.asarray(column)[rows].astype(np.int64)
            for column in (
                fates.tx,
                fates.seq,
                fates.entered_ns,
                fates.started_ns,
                fates.ended_ns,
                fates.attempts,
            )
        )
        is_new = started_ns > newest_ns[tx]
        np.maximum.at(newest_ns, tx, started_ns)
        frame, packet = _each_once(started_ns, tx, is_new), _each_once(seq, tx, is_new)
        place = started_ns // self._span_ns
        np.add.at(sums[AIR_S], place[frame], (ended_ns - started_ns)[frame] * attempts[frame] / 1e9)
        np.add.at(sums[PACKETS], place[packet], 1.0)
        np.add.at(sums[WAITS_S], place[packet], (started_ns - entered_ns)[packet] / 1e9)
        came = np.frombuffer(fates.fate, dtype=np.uint8)[rows] == DELIVERED
        np.add.at(sums[ARRIVED], place[came], 1.0)
        np.add.at(sums[DELAYS_S], place[came], np.asarray(fates.delay_s)[rows][came])

    def _widen(self) -> None:
        self._span_ns *= 2
        for sums in self._sums.values():
            halves = sums.reshape(len(sums), -1, 2).sum(axis=2)
            sums[:] = np.pad(halves, ((0, 0), (0, SPANS_MAX - halves.shape[1])))

    def series(self, network: str) -> AirSeries:
        """One network over time, from when somebody looks on; the span that is not over yet is left out."""
        spans = np.arange(max(self._begin_ns, 0) // self._span_ns, self._end_ns // self._span_ns)
        span_s = self._span_ns / 1e9
        sums = self._sums.get(network, np.zeros((5, SPANS_MAX)))[:, spans]
        if network in self._routed:
            sums[[AIR_S, WAITS_S]] = np.nan
        return AirSeries(
            np.asarray(spans * span_s, dtype=np.float64),
            sums[AIR_S] / span_s,
            sums[WAITS_S] / span_s,
            _mean(sums[WAITS_S], sums[PACKETS]),
            _mean(sums[DELAYS_S], sums[ARRIVED]),
        )


def _each_once(
    number: NDArray[np.int64], tx: NDArray[np.int64], chosen: NDArray[np.bool_]
) -> NDArray[np.intp]:
    """The first of the chosen rows of each sender and number."""
    rows = np.flatnonzero(chosen)
    _, first = np.unique(number[rows] * (tx.max(initial=0) + 1) + tx[rows], return_index=True)
    return rows[first]


def _mean(total: Floats, count: Floats) -> Floats:
    return np.divide(total, count, out=np.full_like(total, np.nan), where=count > 0)
