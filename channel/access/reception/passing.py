"""Frames that meet no other: they pass receivers whose access does not attend to them as a whole, as columns."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from channel.access.packets import AirFrame
from channel.access.reception.receiver import Hearing
from channel.access.world import FrameArrivals, Rows

NEVER_NS = -1
UNKNOWN = -1


class PassingFrame:
    """A frame on its way over receivers that do not attend to it.

    Args:
        frame: the only one on the air.
        arrivals: all that it reaches.
        rows: of these, that it passes.

    Attributes:
        frame, arrivals: as given.
        starts_ns, ends_ns: of the signal at all that it reaches.
    """

    __slots__ = ("_is_left", "arrivals", "ends_ns", "frame", "starts_ns")

    def __init__(self, frame: AirFrame, arrivals: FrameArrivals, rows: Rows) -> None:
        self.frame, self.arrivals = frame, arrivals
        self.starts_ns = arrivals.delay_ns + frame.started_ns
        self.ends_ns = arrivals.delay_ns + frame.ended_ns
        self._is_left = np.zeros(len(arrivals), dtype=bool)
        self._is_left[rows] = True

    def take(self) -> Rows:
        """Take out all rows that are left."""
        rows = np.flatnonzero(self._is_left)
        self._is_left[:] = False
        return rows

    def take_out(self, node: int) -> Rows:
        """Take out the row of a node, if it is left."""
        rows = np.flatnonzero(self._is_left & (self.arrivals.receiver == node))
        self._is_left[rows] = False
        return rows


class Notes:
    """What frames that passed left at receivers: when the last one ended, and whether it had errors.

    Args:
        nodes: numbers of all are below this.
    """

    def __init__(self, nodes: int) -> None:
        self._idle_ns = np.full(nodes, NEVER_NS, dtype=np.int64)
        self._damaged = np.full(nodes, UNKNOWN, dtype=np.int8)

    def take(
        self,
        passage: PassingFrame,
        rows: Rows,
        followed: NDArray[np.bool_],
        came: NDArray[np.bool_],
        hearing: Hearing,
    ) -> None:
        """A frame has passed receivers, of which some followed it, and some of these had it without errors."""
        receiver, ends_ns = passage.arrivals.receiver[rows], passage.ends_ns[rows]
        if followed.all():
            self._idle_ns[receiver], self._damaged[receiver] = ends_ns, ~came
            return
        sensed = followed | (passage.arrivals.power_mw[rows] >= hearing.energy_mw)
        self._idle_ns[receiver[sensed]] = ends_ns[sensed]
        self._damaged[receiver[followed]] = ~came[followed]

    def taken(self) -> list[int]:
        """The nodes at which something was left."""
        nodes: list[int] = np.flatnonzero(self._idle_ns != NEVER_NS).tolist()
        return nodes

    def take_out(self, node: int) -> tuple[bool | None, int] | None:
        """Whether the last frame that a node followed had errors, None if it followed none; since when it is idle."""
        idle_ns, damaged = int(self._idle_ns[node]), int(self._damaged[node])
        if idle_ns == NEVER_NS:
            return None
        self._idle_ns[node], self._damaged[node] = NEVER_NS, UNKNOWN
        return None if damaged == UNKNOWN else bool(damaged), idle_ns
