"""What free programs transmitted in a run that is repeated, from its record."""

from __future__ import annotations

from collections import deque
from collections.abc import Collection, Iterator, Sequence
from heapq import merge
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from bridge.record.packets import SentPacket, packets_of
from bridge.record.tables.deliveries import DELIVERIES, FATES, GAPS_FROM, Cause, Gap, labels_of
from bridge.record.tables.reader import read_batches
from bridge.record.tables.truth import TRUTH
from channel.medium.reception import EVERYBODY
from channel.network.entry import FIRST_EXACT

_SAID: Final = ("channel", "encoding", "radio")
_COLUMNS: Final = (
    *("sim_time_ns", "tx", "rx", "seq", "packets", "length_bytes", "fate", "received_ns"),
    *_SAID,
)


class Repeated(NamedTuple):
    """What a node's program gave to the radio, or what of it was lost before the channel.

    Attributes:
        due_ns: the radio takes it before what it settles for reception later than this.
        seq: number of the packet, or of the first that was lost.
        node: the sender's id.
        what: it.
    """

    due_ns: int
    seq: int
    node: str
    what: SentPacket | Gap


class RepeatedPackets:
    """What a radio takes of nodes whose agents are programs beside the run that is repeated; read as it is needed.

    Args:
        run: directory of that run.
        nodes: ids of all nodes.
        free: those without an agent.

    Raises:
        TableError, StreamError, OSError: its record cannot be read.
    """

    def __init__(self, run: Path, nodes: Sequence[str], free: Collection[str]) -> None:
        gaps = _gaps(run, nodes, free)
        parts = [_of_node(run, node, gaps[node]) for node in gaps]
        self._items: Iterator[Repeated] = merge(*parts, key=lambda item: item.due_ns)
        self._next = next(self._items, None)

    def before(self, due_ns: int) -> Iterator[Repeated]:
        """What is due before an instant, and was not given yet.

        Raises:
            StreamError, OSError: the packets cannot be read.
        """
        while self._next is not None and self._next.due_ns < due_ns:
            yield self._next
            self._next = next(self._items, None)


def _of_node(run: Path, node: str, gaps: Sequence[Repeated]) -> Iterator[Repeated]:
    """What its program transmitted, by number: its modems have theirs again from the bytes of their hosts."""
    lost = deque(gaps)
    for tick_ns, packet in packets_of(run, node):
        if packet.seq >= FIRST_EXACT:
            continue
        while lost and lost[0].seq < packet.seq:
            gap = lost.popleft()
            yield gap._replace(due_ns=min(gap.due_ns, tick_ns))
        yield Repeated(tick_ns, packet.seq, node, packet)
    yield from lost


def _gaps(run: Path, nodes: Sequence[str], free: Collection[str]) -> dict[str, list[Repeated]]:
    """What these nodes' programs lost before the channel, by node and number: streams do not have it."""
    found: dict[str, list[Repeated]] = {node: [] for node in nodes if node in free}
    if not DELIVERIES.is_in(run):
        return found
    places, last_ns = [nodes.index(node) for node in found], _last_tick(run)
    for rows in read_batches(run, DELIVERIES, _COLUMNS, labels_of(nodes)):
        mine = np.isin(rows["tx"], places) & (rows["fate"] >= GAPS_FROM)
        columns = (rows[name][mine].tolist() for name in _COLUMNS)
        for at_ns, tx, rx, seq, count, length_bytes, fate, received_ns, *said in zip(*columns, strict=True):
            to = EVERYBODY if rx == len(nodes) else rx
            gap = Gap(at_ns, tx, to, seq, count, length_bytes, Cause(FATES[fate]), *said)
            may_be_of_the_end = received_ns > last_ns
            due_ns = min(at_ns, received_ns if may_be_of_the_end else received_ns - 1)
            found[nodes[tx]].append(Repeated(due_ns, seq, nodes[tx], gap))
    for gaps in found.values():
        gaps.sort(key=lambda gap: gap.seq)
    return found


def _last_tick(run: Path) -> int:
    """The last tick that has truth, ns; -1 if none has."""
    ticks = read_batches(run, TRUTH, (TRUTH.tick,)) if TRUTH.is_in(run) else ()
    return max((int(batch[TRUTH.tick].max()) for batch in ticks), default=-1)
