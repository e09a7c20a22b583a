"""What the deliveries of a run show: shares, ages, losses."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bridge.record.tables.deliveries import TRANSPORT
from bridge.scenario.expectations import AgeExpectation, DeliveryExpectation, Expectation
from bridge.scenario.model import Scenario
from lostlink.reading.ages import LinkTimes, sawtooth, times_of
from lostlink.reading.positions import Floats, distances_m, places_at, places_of
from lostlink.reading.rows import Chosen, Deliveries, DeliveryRows, RecordedDeliveries

DECIMALS_S = 9
NOTHING_NS = np.empty(0, dtype=np.int64)


class PacketFinder:
    """Looks into `deliveries` of a run, which are read when they are first asked for, for all expectations together.

    Args:
        run: its directory.
        scenario: what was flown.
        expectations: that will be asked for.
    """

    def __init__(self, run: Path, scenario: Scenario, expectations: Sequence[Expectation]) -> None:
        self._run, self._scenario = run, scenario
        self._nodes, self._stations = scenario.transceiver_ids, scenario.stations
        self._deliveries, self._expectations = RecordedDeliveries(run, self._nodes), expectations
        self._counts: dict[DeliveryExpectation, NDArray[np.int64]] = {}
        self._times: dict[str | None, dict[int, LinkTimes]] = {}

    @cached_property
    def _places(self) -> tuple[NDArray[np.int64], dict[str, Floats]]:
        return places_of(self._run, self._stations)

    def _distance_m(self, rows: DeliveryRows) -> Floats:
        """Of the ends of each row, as `distances_m` gives it."""
        c = rows.columns

        def ends(places: NDArray[np.intp]) -> tuple[Floats, Floats]:
            """Where both ends of some rows were when these were transmitted."""
            at_ns, (ticks_ns, tracks) = c["sim_time_ns"][places], self._places
            found = np.empty((2, len(places), 3))
            for end, nodes in zip(found, (c["tx"][places], c["rx"][places]), strict=True):
                for number in np.unique(nodes).tolist():
                    mine = nodes == number
                    end[mine] = places_at(ticks_ns, tracks[self._nodes[number]], at_ns[mine])
            return found[0], found[1]

        return distances_m(c["distance_m"], c["fate"] == TRANSPORT, ends)

    def shares(self, wanted: DeliveryExpectation) -> list[float]:
        """Delivered per sent: of all packets that are meant together, or of each link; nothing if none was sent."""
        if wanted not in self._counts:
            self._count(has_distance=wanted.distance_m is not None)
        sent, delivered = self._counts[wanted]
        if not wanted.each_link:
            sent, delivered = sent.sum(keepdims=True), delivered.sum(keepdims=True)
        return [float(d / s) for s, d in zip(sent, delivered, strict=True) if s]

    def _count(self, *, has_distance: bool) -> None:
        """Count what all expectations mean that have a distance, or have none: packets of each link."""
        links = len(self._nodes) ** 2
        found = {
            each: np.zeros((2, links), dtype=np.int64)
            for each in self._expectations
            if isinstance(each, DeliveryExpectation) and (each.distance_m is not None) is has_distance
        }
        radio = ["radio"] if any(each.radio is not None for each in found) else []
        for rows in self._deliveries.parts("sim_time_ns", "distance_m", *radio):
            packets, is_delivered = rows.columns["packets"].astype(np.int64), rows.is_delivered
            distance_m = self._distance_m(rows) if has_distance else rows.columns["distance_m"]
            for each, counts in found.items():
                chosen = self._meant(each, rows, distance_m)
                for count, rows_counted in zip(counts, (chosen, chosen & is_delivered), strict=True):
                    np.add.at(count, rows.link[rows_counted], packets[rows_counted])
        self._counts |= found

    def _meant(
        self, wanted: DeliveryExpectation, rows: DeliveryRows, distance_m: Floats
    ) -> NDArray[np.bool_]:
        """Which rows are meant."""
        chosen = np.ones(len(rows), dtype=np.bool_)
        for end, node in (("tx", wanted.from_), ("rx", wanted.to)):
            if node is not None:
                chosen &= rows.columns[end] == self._nodes.index(node)
        if wanted.radio is not None:
            chosen &= rows.columns["radio"] == wanted.radio
        times_s = rows.columns["sim_time_ns"] / 1e9  # the floats of the scenario: no product is
        for values, bounds in ((times_s, wanted.between_s), (distance_m, wanted.distance_m)):
            if bounds is not None:
                chosen &= (values >= bounds[0]) & (values <= bounds[1])
        return chosen

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
        senders = [wanted.from_] if wanted.from_ else self._others(wanted)
        links = [self._nodes.index(tx) * len(self._nodes) + self._nodes.index(wanted.node) for tx in senders]
        times = self._times_by(wanted.radio)
        return max((_greatest_age_s(times.get(link), begin_s, until_s) for link in links), default=None)

    def _others(self, wanted: AgeExpectation) -> list[str]:
        """Who may be heard: all other nodes that have the radio."""
        on_it = self._scenario.transceivers if wanted.radio is None else self._scenario.nodes_on(wanted.radio)
        return [each.node for each in on_it if each.node != wanted.node]

    def _times_by(self, radio: str | None) -> dict[int, LinkTimes]:
        """By link, of all that are meant and had a packet on a radio network, or on any."""
        if radio not in self._times:
            wanted = [each for each in self._expectations if isinstance(each, AgeExpectation)]
            receivers = [self._nodes.index(node) for node in sorted({each.node for each in wanted})]
            self._times[radio] = {
                each.link: each for each in times_of(_heard(self._deliveries, receivers, radio))
            }
        return self._times[radio]

    def lost_by_host(self) -> int:
        """Packets that never got to the radio, once per receiver."""
        return sum(
            int(rows.columns["packets"][rows.columns["fate"] == TRANSPORT].sum())
            for rows in self._deliveries.parts()
        )


def _heard(deliveries: Deliveries, receivers: Sequence[int], radio: str | None) -> Chosen:
    """Those to some nodes, by their places, on a radio network, or on any."""
    if radio is None:
        return Chosen(deliveries, lambda rows: np.isin(rows.columns["rx"], receivers))
    return Chosen(
        deliveries,
        lambda rows: np.isin(rows.columns["rx"], receivers) & (rows.columns["radio"] == radio),
        ("radio",),
    )


def _greatest_age_s(heard: LinkTimes | None, begin_s: float, until_s: float) -> float:
    generated_ns, came_ns = (heard.generated_ns, heard.received_ns) if heard else (NOTHING_NS, NOTHING_NS)
    begin_ns, until_ns = round(begin_s * 1e9), round(until_s * 1e9)
    at_begin_ns = begin_ns - generated_ns[came_ns <= begin_ns].max(initial=0)  # all that an instant has
    peak_s = sawtooth(generated_ns, came_ns, begin_ns, until_ns, since_ns=0).age.peak_s
    return round(float(np.fmax(peak_s, at_begin_ns / 1e9)), DECIMALS_S)
