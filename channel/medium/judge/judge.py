"""Whether a run's packets are what its radio says: the draws given the fading, and the fading given its law.

Packets of a link that follow each other see the same shadowing: they are not so many independent trials of the
averaged probability of delivery. So other questions are asked. Whether each packet was lost with the error rate of its
own drawn power: these draws are independent, whatever the fading. Whether the powers follow their law, at places so far
apart that the random terms there are nearly independent (`places`). And whether they change from place to place and
from packet to packet as they should (`changes`). Each answer says which defect would have been seen.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from channel.checks import FloatArray
from channel.draws import Draws
from channel.link.decision import Signal
from channel.link.radio import Radio
from channel.link.tables.steps import STEPS_PER_DB
from channel.medium.judge.changes import APART_NS, FROM_PACKET_TO_PACKET, OVER_PLACE, Changes
from channel.medium.judge.check import (
    BASE_LOSS,
    LEVEL,
    Check,
    Unjudged,
    Verdict,
    count_check,
    exact_check,
)
from channel.medium.judge.heard import HeardPower, heard_power
from channel.medium.judge.powers_at_places import PowersAtPlaces
from channel.medium.judge.taken import Taken
from channel.medium.links import LinksOfPass
from channel.numbers import special

BIN_WIDTH_M = 20.0
MAX_BINS = 8192
LEAST_VARIANCE = 5.0
"""Of a count of losses, below which it says nothing, and a bin's is not taken for normal."""
MAX_LINKS = 128
"""So many have their powers judged."""
LOOKS = 1000
"""About so many are taken for each question in each e-fold of sim time."""
EXACT_DB = 2.0 / STEPS_PER_DB
OFF_SHARE = 0.01
OFF_SHARE_OF_BIN = 0.05
"""The checks of losses are measured by so many more of the packets, in all or in each bin."""
NOWHERE = -1

Ints = NDArray[np.int64]
PacketKey = tuple[int, int, int, int]
"""Instant, ns, transmitter, sequence number, length."""


class Judge:
    """Collects what a verdict needs, at the cost of a few sums per packet.

    Args:
        nodes: how many nodes there are.
        seed: of the run: for draws that the judge makes itself.
    """

    def __init__(self, nodes: int, seed: int = 0) -> None:
        self._sent = np.zeros(MAX_BINS)
        self._expected = np.zeros(MAX_BINS)
        self._variance = np.zeros(MAX_BINS)
        self._third = np.zeros(MAX_BINS)
        self._erased = np.zeros(MAX_BINS)
        self._heard = self._packets = 0
        self._impossible = 0
        self._base_losses = 0
        self._base_packets = 0
        self._base_expected = 0.0
        self._base_variance = 0.0
        self._base_third = 0.0
        self._off_noise = 0
        self._powers = _Powers(nodes, seed)

    def begin(self, links: LinksOfPass) -> None:
        """Take note of all links of a pass: which end of a pair was the first to send, whatever their radios."""
        self._powers.begin(links)

    def take(
        self,
        radio: Radio,
        links: LinksOfPass,
        mean_power_dbm: FloatArray,
        noise_dbm: FloatArray | float,
        signal: Signal,
        erased: NDArray[np.bool_],
    ) -> None:
        """Take in what was drawn on L links.

        The error rate says nothing of packets that are too weak to be locked on to: their powers alone are judged.

        Args:
            radio: whose law is judged, at both ends.
            links: the links; which of them are here may depend on their geometry, but on no draw, other than that a
                node answers what it heard.
            mean_power_dbm: of the link budget.
            noise_dbm: noise floor and interference that the radio has there; broadcasts.
            signal: as drawn, in whole steps.
            erased: whether the draw of the error model lost the packet.
        """
        noise_db = signal.received_power_dbm - signal.snr_db - noise_dbm
        self._hear(noise_db)
        distance_m, per = links.distance_m, signal.per
        if radio.needs_preamble:
            locked = radio.locks_on(signal.received_power_dbm)
            distance_m, per, erased = distance_m[locked], per[locked], erased[locked]
        index = _bins(distance_m)
        spread = per * (1.0 - per)
        _add(self._sent, np.bincount(index))
        _add(self._expected, np.bincount(index, per))
        _add(self._variance, np.bincount(index, spread))
        _add(self._third, np.bincount(index, spread * (1.0 - 2.0 * per)))
        _add(self._erased, np.bincount(index, erased))
        self._count(per, spread, erased)
        self._powers.take(radio, links, mean_power_dbm, signal.received_power_dbm)

    def take_base_losses(self, radio: Radio, lost: NDArray[np.bool_]) -> None:
        """Take in which packets the base loss of a radio lost, shape (L,)."""
        self._take_base_losses(radio.config.base_loss, lost.size, int(np.count_nonzero(lost)))

    def _take_base_losses(self, share: float, packets: int, lost: int) -> None:
        self._base_packets += packets
        self._base_expected += packets * share
        spread = share * (1.0 - share)
        self._base_variance += packets * spread
        self._base_third += packets * spread * (1.0 - 2.0 * share)
        self._base_losses += lost

    def _hear(self, off_db: FloatArray) -> None:
        """Count packets, and those whose noise is off."""
        self._heard += off_db.size
        self._off_noise += int(np.count_nonzero(np.abs(off_db) > EXACT_DB))

    def _count(self, per: FloatArray, spread: FloatArray, erased: NDArray[np.bool_]) -> None:
        """Count packets that receivers locked on to, and those whose fate cannot be."""
        self._packets += per.size
        certain = spread == 0.0
        if certain.any():
            self._impossible += int(np.count_nonzero(erased[certain] != (per[certain] == 1.0)))

    def take_in_order(self, taken: Sequence[Taken], order: Mapping[PacketKey, int]) -> None:
        """Take in the packets that are in an order, one after the other, and no others of what was drawn.

        All sums are those of calls of `take` for each packet alone.

        Args:
            taken: what was drawn, of all links of a packet.
            order: places of packets by their first four columns.
        """
        rows = [_in_order(part, order) for part in taken]
        picked = [(part, *row) for part, row in zip(taken, rows, strict=True) if row[0].size]
        if not picked:
            return
        place = np.concatenate([place for _, _, place in picked])
        part = np.repeat(np.arange(len(picked)), [row.size for _, row, _ in picked])
        order_of_rows = np.lexsort((part, place))
        each = [_columns(*one) for one in picked]
        distance_m, per, erased, off_db, locked = (
            np.concatenate(columns) for columns in zip(*each, strict=True)
        )
        self._hear(off_db)
        heard = order_of_rows[locked[order_of_rows]]
        self._sum((place * len(picked) + part)[heard], *(c[heard] for c in (distance_m, per, erased)))
        self._count(per[locked], (per * (1.0 - per))[locked], erased[locked])
        self._powers.take_in_order([(part, row) for part, row, _ in picked], part, order_of_rows)
        losses = [(loss, number) for number, one in enumerate(picked) for loss in _base_losses(*one)]
        for (_, *loss), number in sorted(losses, key=lambda each: (each[0][0], each[1])):
            self._take_base_losses(picked[number][0].radio.config.base_loss, *loss)

    def _sum(self, group: Ints, distance_m: FloatArray, per: FloatArray, erased: NDArray[np.bool_]) -> None:
        """Add up groups of rows, each by itself first."""
        index = _bins(distance_m)
        _add(self._sent, np.bincount(index))
        _add(self._erased, np.bincount(index, erased))
        sums, which = np.unique(group * MAX_BINS + index, return_inverse=True)
        bins = sums % MAX_BINS
        np.add.at(self._expected, bins, np.bincount(which, per))
        spread = per * (1.0 - per)
        np.add.at(self._variance, bins, np.bincount(which, spread))
        np.add.at(self._third, bins, np.bincount(which, spread * (1.0 - 2.0 * per)))

    def verdict(self) -> Verdict:
        """Return what there is to say by now."""
        answers = [*self._draws(), *self._powers.answers(), *self._base()]
        return Verdict(
            tuple(each for each in answers if isinstance(each, Check)),
            tuple(each for each in answers if isinstance(each, Unjudged)),
        )

    def _base(self) -> Iterator[Check | Unjudged]:
        off = self._base_losses - self._base_expected
        if self._base_packets:
            yield _count_check(BASE_LOSS, self._base_packets, off, (self._base_variance, self._base_third))

    def _draws(self) -> Iterator[Check | Unjudged]:
        if not self._heard:
            return
        if self._packets:
            yield exact_check("certain fates", self._packets, self._impossible)
        yield exact_check("noise", self._heard, self._off_noise)
        if not self._packets:
            yield Unjudged("losses", "no packet was strong enough to be locked on to")
            return
        off = self._erased - self._expected
        moments = float(self._variance.sum()), float(self._third.sum())
        yield _count_check("losses", self._packets, float(off.sum()), moments)
        enough = np.flatnonzero(self._variance >= LEAST_VARIANCE)
        if enough.size > 1:
            yield _bins_check(
                "losses by distance", *(each[enough] for each in (self._sent, off, self._variance))
            )


def _bins(distance_m: FloatArray) -> NDArray[np.intp]:
    return np.minimum(distance_m * (1.0 / BIN_WIDTH_M), MAX_BINS - 1).astype(np.intp)


def _add(sums: FloatArray, found: Ints | FloatArray) -> None:
    """Add what was found in the first bins; the others, which are most of them, stay untouched."""
    sums[: found.size] += found


def _in_order(taken: Taken, order: Mapping[PacketKey, int]) -> tuple[NDArray[np.intp], Ints]:
    """The links of packets that are in an order, and the places of these."""
    packets = taken.links.packets
    keys = zip(*(column.tolist() for column in packets[:4]), strict=True)
    place = np.array([order.get(key, NOWHERE) for key in keys], dtype=np.int64)[taken.links.packet]
    rows = np.flatnonzero(place != NOWHERE)
    return rows, place[rows]


def _columns(
    taken: Taken, rows: NDArray[np.intp], _place: Ints
) -> tuple[FloatArray, FloatArray, NDArray[np.bool_], FloatArray, NDArray[np.bool_]]:
    """Distance, error rate, whether it was lost, how far the noise is off, dB, and whether it was locked on to."""
    signal = taken.signal
    off_db = signal.received_power_dbm - signal.snr_db - taken.noise_dbm
    locked = np.ones(rows.size, dtype=bool)
    if taken.radio.needs_preamble:
        locked = taken.radio.locks_on(signal.received_power_dbm[rows])
    return taken.links.distance_m[rows], signal.per[rows], taken.erased[rows], off_db[rows], locked


def _base_losses(taken: Taken, rows: NDArray[np.intp], place: Ints) -> Iterator[tuple[int, int, int]]:
    """Place, number of links and of losses of each packet, where there is a base loss."""
    if taken.base_lost is not None:
        sent, lost = np.bincount(place), np.bincount(place, taken.base_lost[rows])
        for at in np.flatnonzero(sent).tolist():
            yield at, int(sent[at]), int(lost[at])


def _count_check(name: str, packets: int, off: float, moments: tuple[float, float]) -> Check | Unjudged:
    """Return a check of how many packets were lost more than expected."""
    if moments[0] < LEAST_VARIANCE:
        return Unjudged(name, "too few packets with a chance of loss")
    return count_check(name, packets, off, moments, f"{OFF_SHARE:.0%} of the packets", OFF_SHARE * packets)


def _bins_check(name: str, sent: FloatArray, off: FloatArray, variance: FloatArray) -> Check:
    """Return a check of the same in each bin: a sum that follows chi-squared, non-central with the defect."""
    bins, found = sent.size, float((np.square(off) / variance).sum())
    farther = float((np.square(OFF_SHARE_OF_BIN * sent) / variance).sum())
    edge = float(special.chdtri(bins, LEVEL))
    power = 1.0 - float(special.chndtr(edge, bins, farther))
    return Check(
        name,
        bins,
        found,
        float(special.chdtrc(bins, found)),
        f"{OFF_SHARE_OF_BIN:.0%} of the packets of each bin",
        power,
    )


class _Powers:
    """Chooses what is looked at of the powers, for each question that is asked of them."""

    def __init__(self, nodes: int, seed: int) -> None:
        draws = Draws(seed)
        self._number = _judged_links(nodes)
        self._nodes = nodes
        self._questions: tuple[PowersAtPlaces | Changes, ...] = (
            PowersAtPlaces(draws),
            Changes(OVER_PLACE, draws),
            Changes(FROM_PACKET_TO_PACKET, draws),
        )
        self._links = int(self._number.max(initial=-1)) + 1
        self._next_ns = np.zeros((len(self._questions), self._links), dtype=np.int64)
        self._sender = np.full(self._links, NOWHERE, dtype=np.intp)
        """Of each pair, whose packets are looked at; see `_begin`."""
        self._off = self._exact = 0
        self._asked = False

    def begin(self, links: LinksOfPass) -> None:
        if not (self._sender == NOWHERE).any():
            return
        number = self._numbers(links)
        if self._are_new(number):
            self._begin(links.tx, number, np.lexsort((links.tx, links.sim_time_ns)))

    def take(self, radio: Radio, links: LinksOfPass, mean_dbm: FloatArray, power_dbm: FloatArray) -> None:
        if not self._is_asked(radio, mean_dbm, power_dbm):
            return
        for row in np.flatnonzero(self._due(links)).tolist():
            self._look(radio, links, row, mean_dbm, power_dbm)

    def take_in_order(
        self,
        picked: Sequence[tuple[Taken, NDArray[np.intp]]],
        part: NDArray[np.intp],
        order: NDArray[np.intp],
    ) -> None:
        """Take in rows of parts one after the other: `part` says of which part each is, `order` which comes when."""
        numbers = []
        for taken, rows in picked:
            power_dbm = taken.signal.received_power_dbm
            is_asked = self._is_asked(taken.radio, taken.mean_power_dbm[rows], power_dbm[rows])
            numbers.append(self._numbers(taken.links)[rows] if is_asked else np.full(rows.size, NOWHERE))
        number = np.concatenate(numbers)
        if self._are_new(number):
            self._begin(np.concatenate([taken.links.tx[rows] for taken, rows in picked]), number, order)
        due = np.concatenate([self._due(taken.links)[rows] for taken, rows in picked]) & (number != NOWHERE)
        row_of = np.concatenate([rows for _, rows in picked])
        for each in order[due[order]].tolist():
            taken, _ = picked[part[each]]
            power_dbm = taken.signal.received_power_dbm
            self._look(taken.radio, taken.links, int(row_of[each]), taken.mean_power_dbm, power_dbm)

    def _is_asked(self, radio: Radio, mean_dbm: FloatArray, power_dbm: FloatArray) -> bool:
        """Whether there are questions to powers; without random terms they are what the budget says."""
        config = radio.config
        if config.shadowing.is_random or config.fading.is_random or radio.sight is not None:
            self._asked = True
            return True
        self._exact += power_dbm.size
        self._off += int(np.count_nonzero(np.abs(power_dbm - mean_dbm) > EXACT_DB))
        return False

    def _numbers(self, links: LinksOfPass) -> Ints:
        """The numbers of links among those judged, or -1."""
        number: Ints = self._number[links.tx * self._nodes + links.rx]
        return number

    def _are_new(self, number: Ints) -> bool:
        """Whether any pair has had no packet."""
        return bool(((number != NOWHERE) & (self._sender[number] == NOWHERE)).any())

    def _begin(self, tx: NDArray[np.intp], number: Ints, order: NDArray[np.intp]) -> None:
        """Look at a pair in the direction of its first packet, of several at an instant the lowest node's.

        Who only answers does so where it hears: its powers are those of good places.
        """
        begun, first = np.unique(number[order], return_index=True)
        new = (begun != NOWHERE) & (self._sender[begun] == NOWHERE)
        self._sender[begun[new]] = tx[order][first[new]]

    def _due(self, links: LinksOfPass) -> NDArray[np.bool_]:
        """Which links may be looked at."""
        number = self._numbers(links)
        is_judged = (number != NOWHERE) & (self._sender[number] == links.tx)
        due: NDArray[np.bool_] = is_judged & (links.sim_time_ns >= self._next_ns.min(axis=0)[number])
        return due

    def _look(
        self, radio: Radio, links: LinksOfPass, row: int, mean_dbm: FloatArray, power_dbm: FloatArray
    ) -> None:
        """Ask the questions that are due of a link."""
        link = int(self._number[links.tx[row] * self._nodes + links.rx[row]])
        now_ns = int(links.packets.sim_time_ns[links.packet[row]])
        look: HeardPower | None = None
        for question, next_ns in zip(self._questions, self._next_ns, strict=True):
            if now_ns >= next_ns[link]:
                look = look or heard_power(
                    radio, links, link, row, float(mean_dbm[row]), float(power_dbm[row])
                )
                next_ns[link] = now_ns + self._stretched(question.take(look), now_ns)

    def _stretched(self, wait_ns: int, now_ns: int) -> int:
        """Return a wait that grows with the run, but within a pair: looks do not cost more in larger fleets."""
        if wait_ns < APART_NS:
            return wait_ns
        return max(wait_ns, now_ns * self._links // LOOKS)

    def answers(self) -> Iterator[Check | Unjudged]:
        if self._exact:
            yield exact_check("powers without random terms", self._exact, self._off)
        if self._asked:
            for question in self._questions:
                yield from question.checks()


def _judged_links(nodes: int) -> NDArray[np.int64]:
    """Return the number of each link among those judged, or -1: both directions of a pair have one."""
    number = np.full(nodes * nodes, -1, dtype=np.int64)
    pairs = ((tx, tx + step) for step in range(1, nodes) for tx in range(nodes - step))
    for count, (tx, rx) in enumerate(islice(pairs, MAX_LINKS)):
        number[tx * nodes + rx] = number[rx * nodes + tx] = count
    return number
