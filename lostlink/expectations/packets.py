"""What the deliveries of a run show: shares, ages, losses."""

from __future__ import annotations

from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bridge.record.tables.deliveries import TRANSPORT
from bridge.scenario.expectations import AgeExpectation, DeliveryExpectation
from bridge.scenario.model import Scenario
from lostlink.reading.ages import sawtooth
from lostlink.reading.positions import distances_m, places_at, places_of
from lostlink.reading.rows import DeliveryRows, link_rows

DECIMALS_S = 9
Mask = NDArray[np.bool_]


class PacketFinder:
    """Looks into `deliveries` of a run, which are read when they are first asked for.

    Args:
        run: its directory.
        scenario: what was flown.
    """

    def __init__(self, run: Path, scenario: Scenario) -> None:
        self._run, self._nodes, self._stations = run, scenario.transceiver_ids, scenario.stations

    @cached_property
    def _rows(self) -> DeliveryRows:
        return link_rows(self._run, self._nodes, ("radio", "sim_time_ns", "received_ns", "distance_m"))

    @cached_property
    def _distance_m(self) -> NDArray[np.float64]:
        """Of the ends of each row, as `distances_m` gives it."""
        columns = self._rows.columns
        return distances_m(columns["distance_m"], columns["fate"] == TRANSPORT, self._ends)

    def _ends(self, rows: NDArray[np.intp]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Where both ends of some rows were when these were transmitted."""
        columns, (ticks_ns, tracks) = self._rows.columns, places_of(self._run, self._stations)
        at_ns, ends = columns["sim_time_ns"][rows], np.empty((2, len(rows), 3))
        for places, nodes in zip(ends, (columns["tx"][rows], columns["rx"][rows]), strict=True):
            for number in np.unique(nodes).tolist():
                mine = nodes == number
                places[mine] = places_at(ticks_ns, tracks[self._nodes[number]], at_ns[mine])
        return ends[0], ends[1]

    def shares(self, wanted: DeliveryExpectation) -> list[float]:
        """Delivered per sent: of all packets that are meant together, or of each link; nothing if none was sent."""
        if not wanted.each_link:
            return self._share(wanted, wanted.from_, wanted.to)
        senders = self._nodes if wanted.from_ is None else (wanted.from_,)
        receivers = self._nodes if wanted.to is None else (wanted.to,)
        return [
            share for tx in senders for rx in receivers if tx != rx for share in self._share(wanted, tx, rx)
        ]

    def _share(self, wanted: DeliveryExpectation, tx: str | None, rx: str | None) -> list[float]:
        chosen = self._of(tx, rx, wanted.radio) & self._between(wanted.between_s)
        if wanted.distance_m is not None:
            low, high = wanted.distance_m
            chosen &= (self._distance_m >= low) & (self._distance_m <= high)
        packets = self._rows.columns["packets"]
        sent = packets[chosen].sum()
        delivered = packets[chosen & self._rows.is_delivered].sum()
        return [float(delivered / sent)] if sent else []

    def age_s(self, wanted: AgeExpectation, end_s: float) -> float | None:
        """The greatest age of information (`lostlink.reading.ages`); of what was never heard from the run's begin.

        Args:
            wanted: of what.
            end_s: sim time at which the run ended.
        """
        begin_s, until_s = wanted.between_s or (0.0, end_s)
        until_s = min(until_s, end_s)
        if until_s < begin_s or not end_s:  # a run that ended before its first tick has no instant
            return None
        senders = [wanted.from_] if wanted.from_ else [node for node in self._nodes if node != wanted.node]
        heard = [self._of(tx, wanted.node, wanted.radio) & self._rows.is_delivered for tx in senders]
        return max((self._greatest_age_s(rows, begin_s, until_s) for rows in heard), default=None)

    def _greatest_age_s(self, heard: Mask, begin_s: float, until_s: float) -> float:
        generated_ns, came_ns = (self._rows.columns[name][heard] for name in ("sim_time_ns", "received_ns"))
        begin_ns, until_ns = round(begin_s * 1e9), round(until_s * 1e9)
        at_begin_ns = begin_ns - generated_ns[came_ns <= begin_ns].max(initial=0)  # all that an instant has
        peak_s = sawtooth(generated_ns, came_ns, begin_ns, until_ns, since_ns=0).age.peak_s
        return round(float(np.fmax(peak_s, at_begin_ns / 1e9)), DECIMALS_S)

    def lost_by_host(self) -> int:
        """Packets that never got to the radio, once per receiver."""
        columns = self._rows.columns
        return int(columns["packets"][columns["fate"] == TRANSPORT].sum())

    def _of(self, tx: str | None, rx: str | None, radio: str | None) -> Mask:
        """Rows of a sender, receiver and radio network; None: any."""
        columns = self._rows.columns
        chosen = np.ones(len(columns["tx"]), dtype=np.bool_)
        for end, node in (("tx", tx), ("rx", rx)):
            if node is not None:
                chosen &= columns[end] == self._nodes.index(node)
        return chosen if radio is None else chosen & (columns["radio"] == radio)

    def _between(self, interval_s: tuple[float, float] | None) -> Mask:
        times_s = self._rows.columns["sim_time_ns"] / 1e9  # the floats of the scenario: no product is
        if interval_s is None:
            return np.ones(len(times_s), dtype=np.bool_)
        return (times_s >= interval_s[0]) & (times_s <= interval_s[1])
