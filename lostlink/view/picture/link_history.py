"""What each link did over time: power, SNR, PER and counts, thinned so that memory stays bounded."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bridge.bus.messages import Links
from channel.medium.stations.partitions import Partitions

BIN_WIDTH_M = 20.0
"""As in the ledger (`channel.medium.ledger`)."""
BINS_MAX = 4096
REPORTS_MAX = 1200
VALUES_MAX = 10_000_000
"""Numbers that are kept of all reports of all networks together."""
REPORTS_MIN = 4
"""Whatever they take: 96 MB of 1000 nodes, where VALUES_MAX is 40 MB."""
WINDOW = 10
"""Reports over which shares are taken: two seconds at first."""
SMOOTH = 0.2
"""Weight of a new report in the recent mean of 1 - PER: of a second or so."""
FIGURES = ("distance_m", "received_power_dbm", "snr_db", "per", "sent", "delivered")
Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class LinkSeries:
    """One directed link over sim time, shape (T,) each.

    Attributes:
        time_s: of the reports.
        distance_m: between the two, of the latest packet, as the next three.
        received_power_dbm: with its random terms.
        snr_db: likewise.
        probability: mean of 1 - PER over those of the last WINDOW reports that have one: what the model gave the
            packets; NaN if none has.
        measured: share that arrived of the packets of the last WINDOW reports; NaN if there were none.
    """

    time_s: Floats
    distance_m: Floats
    received_power_dbm: Floats
    snr_db: Floats
    probability: Floats
    measured: Floats


@dataclass(frozen=True, slots=True)
class DistanceBins:
    """Packets by distance, shape (B,) each: the middle of each bin that has any, sent, delivered."""

    distance_m: Floats
    sent: Floats
    delivered: Floats


class LinkHistory:
    """All directed links of one radio network; a link is (tx, rx), by index.

    Args:
        nodes: how many there are.
        values_max: numbers that are kept of all reports together.
        partitions: of the nodes; none unless given.
    """

    def __init__(
        self, nodes: int, values_max: int = VALUES_MAX, partitions: Partitions | None = None
    ) -> None:
        shape = (len(FIGURES), nodes, nodes)
        self._latest = np.full(shape, np.nan, dtype=np.float32)
        self.probability = np.full((nodes, nodes), np.nan)
        """[tx, rx]: recent mean of 1 - PER of each link, of packets that have one; NaN if off, apart or without any."""
        self.newest_s = np.full((nodes, nodes), np.nan)
        """[tx, rx]: sim time of the latest report with new packets of the link; NaN if it carried none.

        Those of the first report may have been sent at any time since the run began, and count as from then.
        """
        self._times_s: list[float] = []
        self._reports: list[NDArray[np.float32]] = []
        self._limit = max(REPORTS_MIN, min(REPORTS_MAX, values_max // max(1, self._latest.size)))
        self._every, self._skipped = 1, 0
        self._distance_m = np.full((nodes, nodes), np.nan, dtype=np.float32)
        """[tx, rx]: of the latest packet that had one."""
        self._silent: tuple[int, ...] = ()
        """Nodes whose radios were off at the latest report."""
        self._partitions = partitions or Partitions([""] * nodes)
        self._taken_ns = 0
        """When the latest report was."""
        self._bins: Floats = np.zeros((2, 1))
        self.reports = 0
        """How many there have been."""

    def take(self, links: Links) -> None:
        """Take a report."""
        tx, rx = np.asarray(links.tx, dtype=np.intp), np.asarray(links.rx, dtype=np.intp)
        before = self._latest[4:, tx, rx]
        for row, name in enumerate(FIGURES):
            self._latest[row, tx, rx] = getattr(links, name)
        self.reports += 1
        has_new = ~(self._latest[4, tx, rx] <= before[0])
        self.newest_s[tx[has_new], rx[has_new]] = links.header.stamp.ns / 1e9 if self.reports > 1 else 0.0
        now_ns, before_ns = links.header.stamp.ns, self._taken_ns
        self._taken_ns = now_ns
        apart = self._partitions.between(tx, rx, now_ns)
        is_off = np.isin(tx, links.radio_off) | np.isin(rx, links.radio_off) | apart
        old, new = self.probability[tx, rx], 1.0 - self._latest[3, tx, rx]
        change = np.where(np.isnan(new), 0.0, SMOOTH * (new - old))
        self.probability[tx, rx] = np.where(is_off, np.nan, np.where(np.isnan(old), new, old + change))
        silent, self._silent = (*self._silent, *links.radio_off), tuple(links.radio_off)
        was_off = np.isin(tx, silent) | np.isin(rx, silent)  # at either end of what is counted
        was_off |= apart | self._partitions.between(tx, rx, before_ns)
        distance_m = np.where(was_off, np.float32(np.nan), self._places(tx, rx))
        self._count(distance_m, np.nan_to_num(before), self._latest[4:, tx, rx])
        self._keep(links.header.stamp.ns / 1e9)

    def _places(self, tx: NDArray[np.intp], rx: NDArray[np.intp]) -> NDArray[np.float32]:
        """At which distances links are: where they were last, if the latest packet never was on the air."""
        latest_m = self._latest[0, tx, rx]
        known = np.isfinite(latest_m)
        self._distance_m[tx[known], rx[known]] = latest_m[known]
        return self._distance_m[tx, rx]

    def _count(
        self, distance_m: NDArray[np.float32], before: NDArray[np.float32], now: NDArray[np.float32]
    ) -> None:
        """Count the packets since the report before where the link is now."""
        if self.reports == 1 and before.size and not np.any(before) and np.any(now[0] > 50):
            return  # the run went on before we looked: where these packets were sent is not known
        known = np.isfinite(distance_m)
        place = np.minimum(distance_m[known] / BIN_WIDTH_M, BINS_MAX - 1).astype(np.intp)
        if place.size and place.max() >= self._bins.shape[1]:
            self._bins = np.pad(self._bins, ((0, 0), (0, int(place.max()) + 1 - self._bins.shape[1])))
        np.add.at(self._bins[0], place, (now - before)[0, known])
        np.add.at(self._bins[1], place, (now - before)[1, known])

    def _keep(self, time_s: float) -> None:
        self._skipped += 1
        if self._skipped < self._every:
            return
        self._skipped = 0
        self._times_s.append(time_s)
        self._reports.append(self._latest.copy())
        if len(self._reports) >= self._limit:
            self._times_s, self._reports = self._times_s[1::2], self._reports[1::2]
            self._every *= 2

    @property
    def carried(self) -> NDArray[np.bool_]:
        """[tx, rx]: whether the link has carried a packet."""
        carried: NDArray[np.bool_] = np.isfinite(self._latest[4])
        return carried

    def latest(self, name: str) -> NDArray[np.float32]:
        """Return the newest of a figure (one of FIGURES) as a matrix [tx, rx]; NaN where there is none."""
        figures: NDArray[np.float32] = self._latest[FIGURES.index(name)]
        return figures

    def series(self, tx: int, rx: int) -> LinkSeries:
        """Return what one link did."""
        rows = np.array([report[:, tx, rx] for report in self._reports], dtype=np.float64)
        if not rows.size:
            rows = np.empty((0, len(FIGURES)))
        distance_m, power_dbm, snr_db, per, sent, delivered = rows.T
        mean = _share(np.nancumsum(1.0 - per), np.cumsum(np.isfinite(per), dtype=np.float64))
        measured = _share(delivered, sent)
        return LinkSeries(np.array(self._times_s), distance_m, power_dbm, snr_db, mean, measured)

    def by_distance(self) -> DistanceBins:
        """Return the packets of all links together by distance."""
        used = np.flatnonzero(self._bins[0])
        middle_m = np.asarray((used + 0.5) * BIN_WIDTH_M, dtype=np.float64)
        return DistanceBins(middle_m, self._bins[0, used], self._bins[1, used])


def _share(part: Floats, whole: Floats) -> Floats:
    """Of two counts, by how much they grew over the last WINDOW reports; NaN where the whole did not."""
    grew = _over_window(whole)
    return np.divide(_over_window(part), grew, out=np.full_like(grew, np.nan), where=grew > 0)


def _over_window(count: Floats) -> Floats:
    """By how much a count grew over the last WINDOW reports; NaN for the first, or if it began within them."""
    return (
        count
        - np.concatenate((count[:1] * np.nan, count[: min(1, count.size)].repeat(WINDOW - 1), count))[
            : count.size
        ]
    )
