"""Recorded packets through the medium, in large pieces wherever pieces of one tick would give the same.

At a whole tick the radio knew the truth of every node at that instant or after it. What it settled then lies between
two samples of each node that it had by then, and what comes later changes nothing: so any number of whole ticks that
follow each other can be settled at once. At other ticks (a UA that was let go, or had not come yet) it matters what was
known when; they are settled one by one, as in the run.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from channel.medium.medium import Medium
from channel.medium.reception import Packets, Receptions
from lostlink.reading.positions import Positions

TICKS_AT_ONCE = 512
"""Fewer than the medium keeps samples of a node."""


def settle(
    medium: Medium, positions: Positions, packets: Packets, due_ns: NDArray[np.int64]
) -> Iterator[Receptions]:
    """Yield what becomes of packets, at all their receivers.

    Args:
        medium: of the same nodes, which nothing was told yet.
        positions: where its nodes were and, behind them, its emitters.
        packets: what they transmitted.
        due_ns: the tick at which the radio had each packet, rising.
    """
    whole = _whole_ticks(positions)
    sent = 0
    for begin, end in _parts(whole):
        for tick in range(begin, end):
            _observe(medium, positions, tick)
        until = int(np.searchsorted(due_ns, positions.ticks_ns[end - 1], side="right"))
        medium.send(packets.at(slice(sent, until)))
        sent = until
        yield medium.settle()
    medium.send(packets.at(slice(sent, None)))
    yield medium.flush()


def _observe(medium: Medium, positions: Positions, tick: int) -> None:
    """Tell the medium where all were at a tick: emitters, which exchange no packets, come behind the nodes."""
    rows = slice(int(positions.first[tick]), int(positions.first[tick + 1]))
    ours = positions.node[rows] < len(medium.nodes)
    if ours.any():
        medium.observe(
            positions.node[rows][ours],
            positions.sim_time_ns[rows][ours],
            positions.position_ned_m[rows][ours],
            positions.attitude_wxyz[rows][ours],
        )
    for row in np.flatnonzero(~ours) + rows.start:
        name, place = positions.nodes[positions.node[row]], positions.position_ned_m[row]
        medium.emitters.observe([name], int(positions.sim_time_ns[row]), [place])


def _whole_ticks(positions: Positions) -> NDArray[np.bool_]:
    """At which ticks there is a truth of each node, and none is older than the tick."""
    ticks = positions.ticks_ns.size
    tick_of = np.repeat(np.arange(ticks), np.diff(positions.first))
    young = positions.sim_time_ns >= positions.ticks_ns[tick_of]
    known = np.bincount(tick_of[young], minlength=ticks)
    return np.equal(known, len(positions.nodes))


def _parts(whole: NDArray[np.bool_]) -> Iterator[tuple[int, int]]:
    """Which ticks are settled together."""
    begin = 0
    while begin < whole.size:
        end = begin + 1
        while whole[begin] and end < whole.size and whole[end] and end - begin < TICKS_AT_ONCE:
            end += 1
        yield begin, end
        begin = end
