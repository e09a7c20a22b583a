"""Recorded packets through the medium, in large pieces wherever pieces of one tick would give the same.

At a whole tick the radio knew the truth of every node at that instant or after it. What it settled then lies between
two samples of each node that it had by then, and what comes later changes nothing: so any number of whole ticks that
follow each other can be settled at once. At other ticks (a UA that was let go, or had not come yet) it matters what was
known when; they are settled one by one, as in the run.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
from numpy.typing import NDArray

from bridge.record.tables.truth import TrueStates
from channel.access.packets import PLAIN, Handling
from channel.medium.medium import Medium
from channel.medium.reception import Packets, Receptions
from channel.network.network import Lived, Network

TICKS_AT_ONCE = 512
"""Fewer than the medium keeps samples of a node."""


def without_nonsense(positions: TrueStates) -> TrueStates:
    """All but rows that no radio can work with, which the router refuses: a flight model may diverge."""
    length = np.sqrt(np.sum(np.square(positions.attitude_wxyz), axis=-1))
    good = np.isfinite(positions.position_ned_m).all(axis=-1) & (length > 0.5) & (length < 2.0)
    return positions if good.all() else positions.at(good)


def last_whole_ns(positions: TrueStates) -> int:
    """The last tick that has as many rows as the one before it, or that one: a file that was cut ends in a row."""
    rows = np.diff(positions.first)
    is_whole = rows.size < 2 or rows[-1] >= rows[-2]
    return int(positions.ticks_ns[-1 if is_whole else -2])


def settle(
    medium: Medium, positions: TrueStates, packets: Packets, due_ns: NDArray[np.int64]
) -> Iterator[Receptions]:
    """Yield what becomes of packets, at all their receivers.

    Args:
        medium: of the same nodes, which got nothing yet.
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


def live(
    network: Network,
    medium: Medium,
    positions: TrueStates,
    packets: Packets,
    due_ns: NDArray[np.int64],
    handling: Mapping[tuple[int, int], Handling],
    tick_period_ns: int,
) -> Iterator[tuple[int, Lived | None]]:
    """Yield what comes of packets on a medium that takes time, tick by tick as in a run, with the tick of its coming.

    Before each tick is lived through it yields None: networks that live on one clock have to be told first, all of
    them, where their nodes are and what these send.

    Args:
        network: of the medium, which got nothing yet.
        medium: of the same nodes, which got nothing yet.
        positions: where its nodes were and, behind them, its emitters.
        packets: what they transmitted.
        due_ns: the tick at which the radio had each packet, rising.
        handling: of packets that are not plain, by sender and number.
        tick_period_ns: of the run.
    """

    def send(begin: int, end: int | None) -> None:
        now = packets.at(slice(begin, end))
        keys = zip(now.tx.tolist(), now.seq.tolist(), strict=True)
        network.send(now, [handling.get(key, PLAIN) for key in keys])

    sent, came_ns = 0, 0
    for tick, tick_ns in enumerate(positions.ticks_ns.tolist()):
        _observe(medium, positions, tick)
        until = int(np.searchsorted(due_ns, tick_ns, side="right"))
        send(sent, until)
        sent, came_ns = until, tick_ns + tick_period_ns
        yield came_ns, None
        yield came_ns, network.live(came_ns)
    send(sent, None)
    yield came_ns, network.end()


def _observe(medium: Medium, positions: TrueStates, tick: int) -> None:
    """Give the medium the places of all at a tick: emitters, which exchange no packets, come behind the nodes."""
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


def _whole_ticks(positions: TrueStates) -> NDArray[np.bool_]:
    """At which ticks there is a truth of each node, and none is older than the tick."""
    young = positions.sim_time_ns >= positions.ticks_ns[positions.tick]
    known = np.bincount(positions.tick[young], minlength=positions.ticks_ns.size)
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
