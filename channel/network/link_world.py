"""What frames meet: links of a run, with all that is drawn for them, where the nodes are when a frame starts."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import accumulate, pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from channel.access.timing import NS_PER_S
from channel.access.world import AirFrame, Arrival, Piece
from channel.checks import FloatArray
from channel.medium.judge.judge import Judge
from channel.medium.medium import Medium
from channel.medium.reception import (
    BASE_LOSS,
    BURST,
    DELIVERED,
    ERASED,
    EVERYBODY,
    FATES,
    Packets,
    Receptions,
)
from channel.numbers.units import SPEED_OF_LIGHT_MPS, db_from_ratio, ratio_from_db

HEARD_DB = -20.0
"""A signal so far below the noise, or further, is no signal, and no interference either."""
IS_HEARD = np.isin(np.arange(len(FATES)), (DELIVERED, ERASED, BASE_LOSS, BURST))
"""With which fates a link carries power."""


@dataclass(slots=True, eq=False)
class Met:
    """What a frame met at all other nodes.

    Attributes:
        receptions: as if it were a packet, alone on the air.
        row: of each receiver in these.
        noise: what it had for noise at receivers, piece by piece; without pieces it is that of its start.
        figures: of each row, once somebody asked for them.
        lost_to_sources: receivers at which it came through but for sources of interference.
    """

    receptions: Receptions
    row: dict[int, int]
    noise: NoisePieces | None = None
    figures: Sequence[Sequence[float]] = ()
    lost_to_sources: set[int] = field(default_factory=set)


class NoisePieces(NamedTuple):
    """Noise that changes while a frame is on the air.

    Attributes:
        durations_ns: of the pieces.
        noise_mw: with all interference but that of the network's own frames, shape (pieces, receivers).
    """

    durations_ns: Sequence[int]
    noise_mw: FloatArray


class LinkWorld:
    """A world (`channel.access.world.World`) of the nodes of a `Medium`.

    A frame is drawn as a packet is by the medium itself, with the number of the transmission for a sequence number: the
    fate that it would have alone on the air is that, by the same laws. Interference raises the error rate piece by
    piece, against the same draw, and so does a source that is on in some slots and off in others. Only first
    transmissions are judged: how often a frame is tried again depends on what was drawn.

    Args:
        medium: where the nodes are, and their radios.
        judge: takes in what is drawn.
        expects: whether `figures` have the chance of delivery; else that is NaN, and takes no time.
    """

    def __init__(self, medium: Medium, judge: Judge | None = None, *, expects: bool = True) -> None:
        self.nodes = tuple(range(len(medium.nodes)))
        self._judged = medium.drawing(judge=judge, expects=expects)
        self._other = self._judged if judge is None else medium.drawing(expects=expects)
        self._always_on = medium.drawing(switched=False)
        """For the noise of a frame that is on the air: its start decides whether radios are on."""
        self._slots_ns, self._has_sources = self._other.slots_ns, self._other.has_sources
        self._first: list[Receptions] = []
        self._per = lru_cache(maxsize=65_536)(self._per_of)

    def reach(self, frame: AirFrame) -> Sequence[Arrival]:
        """All that its power reaches, unless it is far below the noise there, or the radio is off."""
        r = self._draw(frame)
        frame.met = Met(r, {rx: row for row, rx in enumerate(r.rx.tolist())}, self._noise_of(frame))
        delays_ns = np.rint(r.distance_m * (NS_PER_S / SPEED_OF_LIGHT_MPS))
        heard = IS_HEARD[r.fate] & (r.snr_db >= HEARD_DB)
        rows = np.flatnonzero(heard)
        rows = rows[np.argsort(delays_ns[rows], kind="stable")]
        power_mw = ratio_from_db(r.received_power_dbm[rows])
        columns = r.rx[rows].tolist(), np.asarray(power_mw).tolist(), delays_ns[rows].astype(int).tolist()
        return [Arrival(*each) for each in zip(*columns, strict=True)]

    def survives(
        self, frame: AirFrame, receiver: int, power_mw: float, pieces: Sequence[Piece]
    ) -> tuple[bool, bool]:
        """By one draw for all: who comes through with interference does so without."""
        met = _met(frame)
        row, r = met.row[receiver], met.receptions
        fate = int(r.fate[row])
        disturbed = any(interference_mw for _, interference_mw in pieces)
        if fate not in (DELIVERED, ERASED) or not (disturbed or self._has_sources):
            return fate == DELIVERED, fate == DELIVERED
        drawn = self._drawn(met, receiver)
        start_mw = float(ratio_from_db(float(r.received_power_dbm[row] - r.snr_db[row])))
        own = _noise_at(met.noise, row, frame, start_mw)
        alone = fate == DELIVERED
        if met.noise is not None:
            alone = drawn > self._lost(frame, receiver, power_mw, own)
        if not alone:
            quiet_mw = float(ratio_from_db(self._other.radio(frame.node, receiver).noise_floor_dbm))
            quiet = [Piece(frame.ended_ns - frame.started_ns, quiet_mw)]
            if self._has_sources and drawn > self._lost(frame, receiver, power_mw, quiet):
                met.lost_to_sources.add(receiver)
            return False, False
        return not disturbed or drawn > self._lost(frame, receiver, power_mw, added(own, pieces)), True

    def _lost(self, frame: AirFrame, receiver: int, power_mw: float, noise: Sequence[Piece]) -> float:
        """The error rate of a frame by pieces of constant noise, which are the share of its bits that they last."""
        duration_ns = sum(piece_ns for piece_ns, _ in noise)
        whole = 1.0
        for piece_ns, noise_mw in noise:
            share = frame.length_bytes * piece_ns / duration_ns
            whole *= 1.0 - self._per(frame.node, receiver, power_mw / noise_mw, share)
        return 1.0 - whole

    def _drawn(self, met: Met, receiver: int) -> float:
        one = np.zeros(1, dtype=np.intp)
        [drawn] = self._judged.erasure_draws(met.receptions.packets, one, np.array([receiver]))
        return float(drawn)

    def _noise_of(self, frame: AirFrame) -> NoisePieces | None:
        """What changes in the noise while a frame is on the air; None: nothing does."""
        if not self._slots_ns:
            return None
        changes = {frame.started_ns}
        for slot_ns in self._slots_ns:
            first = (frame.started_ns // slot_ns + 1) * slot_ns
            changes.update(range(first, frame.ended_ns, slot_ns))
        if len(changes) == 1:
            return None
        instants = sorted(changes)
        r = self._always_on.receptions(*_as_packets(frame, instants))
        noise_mw = ratio_from_db(r.received_power_dbm - r.snr_db)
        durations = [end - begin for begin, end in pairwise((*instants, frame.ended_ns))]
        return NoisePieces(durations, np.asarray(noise_mw).reshape(len(instants), -1))

    def figures(self, frame: AirFrame, receiver: int) -> Sequence[float]:
        """Distance, m, power, dBm, SNR, dB, error rate, chance of delivery of a frame at a node, alone on the air."""
        met = _met(frame)
        if not met.figures:
            r = met.receptions
            columns = r.distance_m, r.received_power_dbm, r.snr_db, r.per, r.probability_of_delivery
            met.figures = np.column_stack(columns).tolist()
        return met.figures[met.row[receiver]]

    def fate(self, frame: AirFrame, receiver: int) -> int:
        """What becomes of a frame at a node, alone on the air."""
        met = _met(frame)
        return int(met.receptions.fate[met.row[receiver]])

    def is_lost_to_sources(self, frame: AirFrame, receiver: int) -> bool:
        """Whether a frame that was lost to noise would have come through without sources of interference."""
        return receiver in _met(frame).lost_to_sources

    def first_transmissions(self) -> list[Receptions]:
        """What first transmissions to all met since the last call, alone on the air."""
        first, self._first = self._first, []
        return first

    def _draw(self, frame: AirFrame) -> Receptions:
        packets, counted = _as_packets(frame, [frame.started_ns])
        if frame.kind != "data" or frame.attempt > 1:
            return self._other.receptions(packets, counted)
        receptions = self._judged.receptions(packets, counted)
        self._first.append(receptions)
        return receptions

    def _per_of(self, tx: int, rx: int, sinr: float, length_bytes: float) -> float:
        return float(self._judged.radio(tx, rx).per_unchecked(db_from_ratio(sinr), length_bytes))


def _met(frame: AirFrame) -> Met:
    met = frame.met
    assert isinstance(met, Met), "a frame on the air has met this world"
    return met


def _as_packets(frame: AirFrame, instants_ns: Sequence[int]) -> tuple[Packets, NDArray[np.int64]]:
    """A frame as packets to everybody, sent at instants, with their lengths for the error model."""
    count = len(instants_ns)
    lengths = np.full(count, frame.length_bytes)
    packets = Packets(
        np.array(instants_ns),
        np.full(count, frame.node, dtype=np.intp),
        np.full(count, frame.number),
        lengths,
        np.full(count, EVERYBODY, dtype=np.intp),
    )
    return packets, lengths


def _noise_at(noise: NoisePieces | None, row: int, frame: AirFrame, start_mw: float) -> Sequence[Piece]:
    """Noise at one receiver over a frame."""
    if noise is None:
        return [Piece(frame.ended_ns - frame.started_ns, start_mw)]
    return [Piece(*each) for each in zip(noise.durations_ns, noise.noise_mw[:, row].tolist(), strict=True)]


def added(one: Sequence[Piece], other: Sequence[Piece]) -> list[Piece]:
    """The sum of two powers that are constant piece by piece over the same time."""
    sums: list[Piece] = []
    ends = [list(accumulate(piece.duration_ns for piece in pieces)) for pieces in (one, other)]
    begin_ns = 0
    for end_ns in sorted({*ends[0], *ends[1]}):
        powers = [
            pieces[min(bisect_right(those, begin_ns), len(pieces) - 1)].interference_mw
            for pieces, those in zip((one, other), ends, strict=True)
        ]
        sums.append(Piece(end_ns - begin_ns, sum(powers)))
        begin_ns = end_ns
    return sums
