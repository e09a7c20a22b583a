"""What frames meet: links of a run, with all that is drawn for them, where the nodes are when a frame starts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from channel.access.timing import NS_PER_S
from channel.access.world import AirFrame, Arrival, Piece
from channel.medium.judge.judge import Judge
from channel.medium.medium import Medium
from channel.medium.reception import BASE_LOSS, BURST, DELIVERED, ERASED, EVERYBODY, Packets, Receptions
from channel.numbers.units import SPEED_OF_LIGHT_MPS, db_from_ratio, ratio_from_db

HEARD_DB = -20.0
"""A signal so far below the noise, or further, is no signal, and no interference either."""
HEARD_FATES = (DELIVERED, ERASED, BASE_LOSS, BURST)
"""With others a link does not carry power."""
KEPT_NS = 10 * NS_PER_S
"""For so long after its end it is known what a frame met: a fate may be decided later than by it."""


@dataclass(frozen=True, slots=True, eq=False)
class Met:
    """What a frame met at all other nodes.

    Attributes:
        receptions: as if it were a packet, alone on the air.
        row: of each receiver in these.
    """

    receptions: Receptions
    row: dict[int, int]


class LinkWorld:
    """A world (`channel.access.world.World`) of the nodes of a `Medium`.

    A frame is drawn as a packet is by the medium itself, with the number of the transmission for a sequence number: the
    fate that it would have alone on the air is that, by the same laws. Interference raises the error rate piece by
    piece, against the same draw. Only first transmissions are judged: how often a frame is tried again depends on what
    was drawn.

    Args:
        medium: where the nodes are, and their radios.
        judge: takes in what is drawn.
    """

    def __init__(self, medium: Medium, judge: Judge | None = None) -> None:
        self.nodes = tuple(range(len(medium.nodes)))
        self._judged = medium.drawing(judge=judge)
        self._other = self._judged if judge is None else medium.drawing()
        self._met: dict[AirFrame, Met] = {}
        self._first: list[Receptions] = []
        self._per = lru_cache(maxsize=65_536)(self._per_of)

    def reach(self, frame: AirFrame) -> Sequence[Arrival]:
        """All that its power reaches, unless it is far below the noise there, or the radio is off."""
        receptions = self._draw(frame)
        r = receptions
        self._met[frame] = Met(r, {rx: row for row, rx in enumerate(r.rx.tolist())})
        delays_ns = np.rint(r.distance_m * (NS_PER_S / SPEED_OF_LIGHT_MPS))
        heard = np.isin(r.fate, HEARD_FATES) & (r.snr_db >= HEARD_DB)
        rows = np.flatnonzero(heard)
        rows = rows[np.argsort(delays_ns[rows], kind="stable")]
        power_mw = ratio_from_db(r.received_power_dbm[rows])
        columns = r.rx[rows].tolist(), np.asarray(power_mw).tolist(), delays_ns[rows].astype(int).tolist()
        return [Arrival(*each) for each in zip(*columns, strict=True)]

    def survives(
        self, frame: AirFrame, receiver: int, power_mw: float, pieces: Sequence[Piece]
    ) -> tuple[bool, bool]:
        """By one draw for both: who comes through with interference does so without."""
        met = self._met[frame]
        row, r = met.row[receiver], met.receptions
        alone = int(r.fate[row]) == DELIVERED
        if not alone or not any(interference_mw for _, interference_mw in pieces):
            return alone, alone
        noise_mw = float(ratio_from_db(float(r.received_power_dbm[row] - r.snr_db[row])))
        duration_ns = frame.ended_ns - frame.started_ns
        whole = 1.0
        for piece_ns, interference_mw in pieces:
            sinr = power_mw / (noise_mw + interference_mw)
            share = frame.length_bytes * piece_ns / duration_ns
            whole *= 1.0 - self._per(frame.node, receiver, sinr, share)
        one = np.zeros(1, dtype=np.intp)
        [drawn] = self._judged.erasure_draws(r.packets, one, np.array([receiver]))
        return bool(drawn > 1.0 - whole), True

    def met(self, frame: AirFrame, receiver: int) -> tuple[Receptions, int]:
        """What a frame met at a node: the receptions that have it, and the row there."""
        met = self._met[frame]
        return met.receptions, met.row[receiver]

    def first_transmissions(self) -> list[Receptions]:
        """What first transmissions to all met since the last call, alone on the air."""
        first, self._first = self._first, []
        return first

    def forget(self, now_ns: int) -> None:
        """Nobody asks any more for what ended long ago."""
        old = [frame for frame in self._met if frame.ended_ns < now_ns - KEPT_NS]
        for frame in old:
            del self._met[frame]

    def _draw(self, frame: AirFrame) -> Receptions:
        packets = Packets(
            np.array([frame.started_ns]),
            np.array([frame.node], dtype=np.intp),
            np.array([frame.number]),
            np.array([frame.length_bytes]),
            np.array([EVERYBODY], dtype=np.intp),
        )
        counted: NDArray[np.int64] = packets.length_bytes
        if frame.packet is None or frame.attempt > 1:
            return self._other.receptions(packets, counted)
        receptions = self._judged.receptions(packets, counted)
        self._first.append(receptions)
        return receptions

    def _per_of(self, tx: int, rx: int, sinr: float, length_bytes: float) -> float:
        return float(self._judged.radio(tx, rx).per_unchecked(db_from_ratio(sinr), length_bytes))
