"""Frames as if each were alone on the air: drawn by the run's own medium, many in one pass."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from channel.access.packets import AirFrame
from channel.access.timing import NS_PER_S
from channel.access.world import Alone, FrameArrivals, Rows
from channel.checks import FloatArray
from channel.medium.judge.taken import Taken
from channel.medium.reception import (
    BASE_LOSS,
    BELOW_PREAMBLE,
    BURST,
    DELIVERED,
    ERASED,
    EVERYBODY,
    FATES,
    Packets,
    Receptions,
)
from channel.numbers.units import SPEED_OF_LIGHT_MPS, ratio_from_db

HEARD_DB = -20.0
"""A signal so far below the noise, or further, is no signal, and no interference either."""
IS_HEARD = np.isin(np.arange(len(FATES)), (DELIVERED, ERASED, BASE_LOSS, BURST, BELOW_PREAMBLE))
"""With which fates a link carries power."""


class Drawn:
    """Frames to everybody that were drawn in one pass.

    Args:
        receptions: of all of them.
        taken: what a judge wants to know of them.
    """

    def __init__(self, receptions: Receptions, taken: Sequence[Taken] = ()) -> None:
        self.receptions, self.taken = receptions, taken
        self._others = receptions.size // max(receptions.packets.size, 1)

    @cached_property
    def table(self) -> FloatArray:
        """Distance, m, power, dBm, SNR, dB, error rate, chance of delivery of each row, shape (rows, 5)."""
        r = self.receptions
        return np.column_stack(
            (r.distance_m, r.received_power_dbm, r.snr_db, r.per, r.probability_of_delivery)
        )

    @cached_property
    def _heard(self) -> tuple[Sequence[int], Rows, FloatArray, NDArray[np.int64]]:
        """Where each frame begins among those who hear one; receivers, powers, mW, delays, ns: nearest first."""
        r = self.receptions
        rows = np.flatnonzero(IS_HEARD[r.fate] & (r.snr_db >= HEARD_DB))
        delay_ns = delays_ns(r.distance_m[rows]).astype(np.int64)
        order = np.lexsort((delay_ns, r.packet[rows]))
        rows = rows[order]
        first: list[int] = np.searchsorted(r.packet[rows], np.arange(r.packets.size + 1)).tolist()
        return first, r.rx[rows], np.asarray(ratio_from_db(r.received_power_dbm[rows])), delay_ns[order]

    def arrivals(self, number: int, alone: Alone) -> FrameArrivals:
        """A frame at all that hear it."""
        first, receiver, power_mw, delay_ns = self._heard
        part = slice(first[number], first[number + 1])
        return FrameArrivals(receiver[part], power_mw[part], delay_ns[part], alone)

    def rows_of(self, number: int) -> slice:
        """The rows of a frame: of all nodes but its own, in their order."""
        return slice(number * self._others, (number + 1) * self._others)

    def receptions_of(self, number: int) -> Receptions:
        """The rows of a frame."""
        r, part = self.receptions, self.rows_of(number)
        return Receptions(
            r.packets.at(slice(number, number + 1)),
            np.zeros(self._others, dtype=np.intp),
            r.rx[part],
            r.distance_m[part],
            r.received_power_dbm[part],
            r.snr_db[part],
            r.per[part],
            r.probability_of_delivery[part],
            r.fate[part],
        )


def delays_ns(distance_m: FloatArray) -> FloatArray:
    """How long a signal is on its way, whole ns."""
    return np.rint(distance_m * (NS_PER_S / SPEED_OF_LIGHT_MPS))


def as_packets(frames: Sequence[AirFrame], instants_ns: Sequence[int]) -> tuple[Packets, NDArray[np.int64]]:
    """Frames as packets to everybody, sent at instants, with their lengths for the error model."""
    lengths = np.array([frame.length_bytes for frame in frames])
    packets = Packets(
        np.array(instants_ns),
        np.array([frame.node for frame in frames], dtype=np.intp),
        np.array([frame.number for frame in frames]),
        lengths,
        np.full(len(frames), EVERYBODY, dtype=np.intp),
    )
    return packets, lengths
