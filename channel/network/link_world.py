"""What frames meet: links of a run, with all that is drawn for them, where the nodes are when a frame starts."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Mapping, Sequence
from functools import lru_cache, partial
from itertools import accumulate, pairwise
from math import inf
from operator import attrgetter
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from channel.access.packets import AirFrame
from channel.access.timing import NS_PER_S
from channel.access.world import Alone, FrameArrivals, Piece, Rows
from channel.checks import FloatArray
from channel.medium.judge.judge import Judge
from channel.medium.judge.taken import Notebook
from channel.medium.medium import Medium
from channel.medium.reception import DELIVERED, ERASED, Receptions
from channel.medium.settling import Settling
from channel.network.drawn import Drawn, as_packets, delays_ns
from channel.network.sources import MediumSources
from channel.numbers.units import SPEED_OF_LIGHT_MPS, db_from_ratio, ratio_from_db

if TYPE_CHECKING:
    from channel.network.foreign_signals import Beside

_Key = tuple[int, int, int, int]
"""Of a frame: instant, ns, transmitter, number, length."""


class Met:
    """What a frame met at all other nodes, in their order: as if it were a packet, alone on the air.

    Args:
        drawn: the pass in which it was drawn.
        number: of it in this pass.
        alone: asks for what comes through.

    Attributes:
        drawn: as given.
        arrivals: at those that hear it.
        first: the row of the first other node in the pass.
        noise: what it had for noise at receivers, piece by piece; without pieces it is that of its start.
        lost_to_sources: receivers at which it came through but for sources of interference and other networks.
    """

    __slots__ = ("_number", "arrivals", "drawn", "first", "lost_to_sources", "noise")

    def __init__(self, drawn: Drawn, number: int, alone: Alone) -> None:
        self.drawn, self._number = drawn, number
        self.arrivals = drawn.arrivals(number, alone)
        self.first = drawn.rows_of(number).start
        self.noise: NoisePieces | None = None
        self.lost_to_sources: set[int] = set()

    @property
    def receptions(self) -> Receptions:
        """At all of them."""
        return self.drawn.receptions_of(self._number)


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
    transmissions are judged, and frames of nodes whose turn it is: how often a frame is tried again depends on what was
    drawn.

    Args:
        medium: where the nodes are, and their radios.
        judge: takes in what is drawn.
        expects: whether `figures` have the chance of delivery; else that is NaN, and takes no time.
        keeps: whether `first_transmissions` has them; who never asks for them would keep them for ever.

    Attributes:
        beside: the network among others in its band; None: there are none.
        sources: interferers and emitters at its nodes; None: there are none.
    """

    def __init__(
        self, medium: Medium, judge: Judge | None = None, *, expects: bool = True, keeps: bool = True
    ) -> None:
        self.nodes, self.ids = tuple(range(len(medium.nodes))), medium.nodes
        self.beside: Beside | None = None
        self._medium, self._judge, self._notebook = medium, judge, Notebook()
        self._expects, self._keeps = expects, keeps
        self._by_rate: dict[float | None, tuple[Settling, Settling]] = {}
        """What draws first transmissions and others, by their bit rates."""
        self._judged, self._other = self._at_rate(None)
        self._always_on = medium.drawing(switched=False)
        """For the noise of a frame that is on the air: its start decides whether radios are on."""
        self._slots_ns, self._has_sources = self._other.slots_ns, self._other.has_sources
        self.sources = MediumSources(medium, self._slots_ns) if self._has_sources else None
        self._expected: dict[_Key, Met] = {}
        """Frames that were drawn before they started."""
        self._first: dict[_Key, Met] = {}
        self._reached: dict[int, Sequence[int]] = {}
        """By the last frame of a node."""
        self._per = lru_cache(maxsize=65_536)(self._per_of)

    def _at_rate(self, bit_rate_bps: float | None) -> tuple[Settling, Settling]:
        """What draws first transmissions, and others, at a bit rate; None: the radios' own."""
        if bit_rate_bps not in self._by_rate:
            notebook = None if self._judge is None else self._notebook
            draw = partial(self._medium.drawing, bit_rate_bps=bit_rate_bps, expects=self._expects)
            self._by_rate[bit_rate_bps] = draw(judge=notebook), draw()
        return self._by_rate[bit_rate_bps]

    def delays_ns(self, frames: Sequence[AirFrame]) -> Sequence[Mapping[int, int]]:
        """To those whom the last frame of its node reached; to all, if there was none."""
        instants_ns, which = np.unique([frame.started_ns for frame in frames], return_inverse=True)
        places = self._medium.positions_ned_m(instants_ns)[:, which]
        tx = np.array([frame.node for frame in frames])
        way = places - np.take_along_axis(places, tx[np.newaxis, :, np.newaxis], axis=2)
        delays = delays_ns(np.sqrt((way * way).sum(axis=0))).astype(np.int64).tolist()
        return [
            {rx: row[rx] for rx in self._reached.get(frame.node, self.nodes)}
            for frame, row in zip(frames, delays, strict=True)
        ]

    def apart_m(self, node: int, other: int, at_ns: int) -> float:
        """How far two nodes are from each other at an instant; inf: a partition is between them."""
        if self.are_apart(node, other, at_ns):
            return inf
        way = self._medium.positions_ned_m(np.array([at_ns]))[:, 0]
        return float(np.linalg.norm(way[:, node] - way[:, other]))

    def expect(self, frames: Sequence[AirFrame]) -> None:
        """Draw frames in one pass that may start before anything in the world is told anew."""
        drawn = self._draw(frames)
        self._expected = {_key(frame): Met(drawn, number, self._alone) for number, frame in enumerate(frames)}

    def forget(self) -> None:
        """Places, radios or sources may be other ones from now on."""
        self._expected = {}

    def reach(self, frame: AirFrame) -> FrameArrivals:
        """All that its power reaches, unless it is far below the noise there, a radio is off, or nodes are apart."""
        if self.beside is not None:
            self.beside.starts(frame)
        key = _key(frame)
        if frame.is_fair:
            met = self._expected.get(key) or Met(self._draw([frame]), 0, self._alone)
            if self._keeps:
                self._first[key] = met
        else:
            packets, counted = as_packets([frame], [frame.started_ns])
            _, other = self._at_rate(frame.bit_rate_bps)
            met = Met(Drawn(other.receptions(packets, counted)), 0, self._alone)
        frame.met, met.noise = met, self._noise_of(frame)
        self._reached[frame.node] = met.arrivals.receiver.tolist()
        return met.arrivals

    def _draw(self, frames: Sequence[AirFrame]) -> Drawn:
        [bit_rate_bps] = {frame.bit_rate_bps for frame in frames}
        judged, _ = self._at_rate(bit_rate_bps)
        receptions = judged.receptions(*as_packets(frames, [frame.started_ns for frame in frames]))
        return Drawn(receptions, self._notebook.taken())

    def _alone(self, frame: AirFrame, rows: Rows) -> NDArray[np.bool_]:
        """Whether a frame comes through at rows of its arrivals, if it is the only one on the air there."""
        met = _met(frame)
        receivers = met.arrivals.receiver[rows]
        fate = met.drawn.receptions.fate[_rows(frame, receivers)]
        came: NDArray[np.bool_] = fate == DELIVERED
        if self._has_sources:
            quiet = [Piece(frame.ended_ns - frame.started_ns, 0.0)]
            is_open = fate == ERASED if met.noise is None else (fate == ERASED) | came
            for place in np.flatnonzero(is_open).tolist():
                power_mw = float(met.arrivals.power_mw[rows[place]])
                came[place], _ = self.survives(frame, int(receivers[place]), power_mw, quiet)
        return came

    def survives(
        self, frame: AirFrame, receiver: int, power_mw: float, pieces: Sequence[Piece]
    ) -> tuple[bool, bool]:
        """By one draw for all: who comes through with interference does so without."""
        met = _met(frame)
        row, r = _row(frame, receiver), met.drawn.receptions
        fate = int(r.fate[met.first + row])
        disturbed = any(interference_mw for _, interference_mw in pieces)
        foreign = self._foreign(frame, receiver)
        has_sources = self._has_sources or bool(foreign)
        if fate not in (DELIVERED, ERASED) or not (disturbed or has_sources):
            return fate == DELIVERED, fate == DELIVERED
        drawn = self._drawn(frame, receiver)
        start_dbm = float(r.received_power_dbm[met.first + row] - r.snr_db[met.first + row])
        start_mw = float(ratio_from_db(start_dbm))
        own = _noise_at(met.noise, row, frame, start_mw)
        if foreign:
            own = added(own, foreign)
        alone = fate == DELIVERED
        if met.noise is not None or (alone and foreign):
            alone = self._outlasts(drawn, frame, receiver, power_mw, own)
        if not alone:
            quiet_mw = float(ratio_from_db(self._other.radio(frame.node, receiver).noise_floor_dbm))
            quiet = [Piece(frame.ended_ns - frame.started_ns, quiet_mw)]
            if has_sources and self._outlasts(drawn, frame, receiver, power_mw, quiet):
                met.lost_to_sources.add(receiver)
            return False, False
        return not disturbed or self._outlasts(drawn, frame, receiver, power_mw, added(own, pieces)), True

    def comes_alone(self, frame: AirFrame, receiver: int, power_mw: float) -> bool:
        """By the same draw; sources of interference and other networks are there."""
        return self.survives(frame, receiver, power_mw, [Piece(frame.ended_ns - frame.started_ns, 0.0)])[1]

    def is_off(self, node: int, at_ns: int) -> bool:
        """Whether a node's radio is off at an instant."""
        return self._medium.radio_off(node, at_ns)

    def are_apart(self, node: int, other: int, at_ns: int) -> bool:
        """Whether a partition is between two nodes at an instant."""
        return self._medium.are_apart(node, other, at_ns)

    def noise_mw(self, node: int, at_ns: int) -> float:
        """The noise of a node's receiver at an instant, with all that interferes but frames."""
        other = self.nodes[0] if node != self.nodes[0] else self.nodes[-1]
        if not self._has_sources:
            return float(ratio_from_db(self._other.radio(other, node).noise_floor_dbm))
        frame = AirFrame(other, 0, "noise", 1, at_ns, at_ns)
        r, row = self._always_on.receptions(*as_packets([frame], [at_ns])), _row(frame, node)
        return float(ratio_from_db(r.received_power_dbm[row] - r.snr_db[row]))

    def _foreign(self, frame: AirFrame, receiver: int) -> Sequence[Piece]:
        """The power of other networks in the band at a receiver, while a frame comes in there; empty: none."""
        if self.beside is None:
            return ()
        met = _met(frame)
        way_m = float(met.drawn.receptions.distance_m[met.first + _row(frame, receiver)])
        delay_ns = round(way_m * (NS_PER_S / SPEED_OF_LIGHT_MPS))
        span = frame.started_ns + delay_ns, frame.ended_ns + delay_ns
        return self.beside.pieces(receiver, frame.channel, *span)

    def _outlasts(
        self, drawn: float, frame: AirFrame, receiver: int, power_mw: float, noise: Sequence[Piece]
    ) -> bool:
        """Whether a draw is above the error rate of a frame by pieces of constant noise.

        These are the share of its bits that they last. The chance to come through all of them falls with each, in
        numbers of the computer, too: the loudest piece, which mostly decides, comes first, and where it does the
        others are not asked.
        """
        duration_ns = sum(piece_ns for piece_ns, _ in noise)
        link = frame.node, receiver, frame.bit_rate_bps

        def chance(piece: Piece) -> float:
            share = frame.length_bytes * piece.duration_ns / duration_ns
            return 1.0 - self._per(*link, power_mw / piece.interference_mw, share)

        if len(noise) > 1 and not drawn > 1.0 - chance(max(noise, key=_power_mw)):
            return False
        whole = 1.0
        for piece in noise:
            whole *= chance(piece)
            if not drawn > 1.0 - whole:
                return False
        return True

    def _drawn(self, frame: AirFrame, receiver: int) -> float:
        packets, _ = as_packets([frame], [frame.started_ns])
        [drawn] = self._judged.erasure_draws(packets, np.zeros(1, dtype=np.intp), np.array([receiver]))
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
        r = self._always_on.receptions(*as_packets([frame] * len(instants), instants))
        noise_mw = ratio_from_db(r.received_power_dbm - r.snr_db)
        durations = [end - begin for begin, end in pairwise((*instants, frame.ended_ns))]
        return NoisePieces(durations, np.asarray(noise_mw).reshape(len(instants), -1))

    def figures(self, frame: AirFrame, receiver: int) -> Sequence[float]:
        """Distance, m, power, dBm, SNR, dB, error rate, chance of delivery of a frame at a node, alone on the air."""
        met = _met(frame)
        figures: list[float] = met.drawn.table[met.first + _row(frame, receiver)].tolist()
        return figures

    def figures_at(self, frame: AirFrame, receivers: Rows) -> FloatArray:
        """As `figures`, at several nodes, shape (nodes, 5)."""
        return _met(frame).drawn.table[_rows(frame, receivers)]

    def fate(self, frame: AirFrame, receiver: int) -> int:
        """What becomes of a frame at a node, alone on the air."""
        met = _met(frame)
        return int(met.drawn.receptions.fate[met.first + _row(frame, receiver)])

    def fates_at(self, frame: AirFrame, receivers: Rows) -> NDArray[np.uint8]:
        """As `fate`, at several nodes."""
        return _met(frame).drawn.receptions.fate[_rows(frame, receivers)]

    def lost_to_sources(self, frame: AirFrame) -> set[int]:
        """Nodes at which a frame was lost to noise, but not without sources of interference and other networks."""
        return _met(frame).lost_to_sources

    def first_transmissions(self) -> list[Receptions]:
        """What first transmissions to all met since the last call, alone on the air; the judge takes them in."""
        first, self._first = self._first, {}
        if self._judge is not None and first:
            passes = {id(met.drawn): met.drawn for met in first.values()}.values()
            order = {key: number for number, key in enumerate(first)}
            self._judge.take_in_order([taken for each in passes for taken in each.taken], order)
        return [met.receptions for met in first.values()]

    def _per_of(
        self, tx: int, rx: int, bit_rate_bps: float | None, sinr: float, length_bytes: float
    ) -> float:
        radio = self._at_rate(bit_rate_bps)[0].radio(tx, rx)
        return float(radio.per_unchecked(db_from_ratio(sinr), length_bytes))


_power_mw = attrgetter("interference_mw")


def _met(frame: AirFrame) -> Met:
    met = frame.met
    assert isinstance(met, Met), "a frame on the air has met this world"
    return met


def _row(frame: AirFrame, receiver: int) -> int:
    """The place of a node among all but the sender."""
    return receiver - (receiver > frame.node)


def _rows(frame: AirFrame, receivers: Rows) -> Rows:
    """The rows of nodes in the pass in which a frame was drawn."""
    rows: Rows = receivers + (_met(frame).first - (receivers > frame.node))
    return rows


def _key(frame: AirFrame) -> _Key:
    """What is drawn for a frame depends on it, and on where the nodes are."""
    return frame.started_ns, frame.node, frame.number, frame.length_bytes


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
