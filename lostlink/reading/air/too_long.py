"""Packets that were too long to be on the air: by sender, with what there is to do about it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from bridge.record.tables.deliveries import FATES, TOO_LONG, Cause
from channel.medium.reception import Fate
from lostlink.reading.air.capacity import Capacity
from lostlink.reading.rows import DeliveryRows

NO_ROOM: Final = FATES.index(Fate.TOO_LONG_FOR_A_SLOT.value)
TRANSPORT: Final = FATES.index(Cause.TRANSPORT)
SLOTTED: Final = "tdma"
"""The medium on which room is that of a node's own slots."""
NAMED_MAX: Final = 5
"""Nodes that have a sentence of their own."""


@dataclass(frozen=True, slots=True)
class TooLong:
    """Packets of one node on one network that were too long.

    Attributes:
        node: its id.
        packets: how many were too long.
        of: how many it gave to its radio.
        longest_bytes: payload of the longest of them.
        mtu_bytes: longest payload that its radio takes; None: it took them, and the medium has no room for them.
    """

    node: str
    packets: int
    of: int
    longest_bytes: int
    mtu_bytes: int | None

    def warning(self, medium: str) -> str:
        """What happened, and what to do."""
        many = f"all {self.of}" if self.packets == self.of else f"{self.packets} of {self.of}"
        head = f"node {self.node}: {many} packets that it transmitted were longer than"
        longest = f"the longest has {self.longest_bytes} bytes"
        if self.mtu_bytes is None:
            if medium == SLOTTED:
                return (
                    f"node {self.node}: {many} packets that it transmitted fit into no slot that it has, and were lost "
                    f"(too_long_for_a_slot; {longest}): transmit less in a packet, or give it a slot with the room"
                )
            return (
                f"{head} the medium {medium} has room for, and were lost (too_long_for_a_slot; {longest}): "
                "transmit less in a packet, or give the medium more room"
            )
        return (
            f"{head} the {self.mtu_bytes} bytes that its radio takes (mtu_bytes), and were lost (too_long; {longest}): "
            "transmit less in a packet, or raise mtu_bytes"
        )


def too_long_of(rows: DeliveryRows, capacity: Capacity) -> Iterator[TooLong]:
    """Of each node whose packets were too long for its radio, then for the medium.

    Args:
        rows: of the network.
        capacity: of the network.
    """
    c = rows.columns
    losses = {fate: mask for fate in (TOO_LONG, NO_ROOM) if (mask := c["fate"] == fate).any()}
    given = _packets(rows, c["fate"] != TRANSPORT) if losses else ()
    for fate, lost in losses.items():
        counts, longest = _packets(rows, lost), np.zeros(len(rows.nodes), np.int64)
        np.maximum.at(longest, c["tx"][lost], c["length_bytes"][lost])
        for tx in np.flatnonzero(counts).tolist():
            node, longest_bytes = rows.nodes[tx], int(longest[tx])
            if fate == NO_ROOM:
                longest_bytes = capacity.payload_bytes(node, longest_bytes)
            mtu_bytes = capacity.radios[node].config.mtu_bytes if fate == TOO_LONG else None
            yield TooLong(node, int(counts[tx]), int(given[tx]), longest_bytes, mtu_bytes)


def _packets(rows: DeliveryRows, which: NDArray[np.bool_]) -> NDArray[np.int64]:
    """How many packets each node has in some rows, of which there is one per receiver."""
    columns = [rows.columns[name][which].astype(np.int64) for name in ("tx", "seq")]
    tx, _ = np.unique(np.stack(columns), axis=1)
    return np.bincount(tx, minlength=len(rows.nodes))


def remark_of(found: Sequence[TooLong]) -> str:
    """For the line of a verdict: of how many packets all these are; "" of none."""
    if not found:
        return ""
    packets, of = sum(each.packets for each in found), sum(each.of for each in found)
    nodes = sorted({each.node for each in found})
    whose = f"node {nodes[0]}" if len(nodes) == 1 else f"{len(nodes)} nodes"
    return f"{packets} of {of} packets of {whose} too long"


def warnings_of(found: Sequence[TooLong], medium: str) -> Iterator[str]:
    """A sentence for each, as far as somebody reads them."""
    for each in found[:NAMED_MAX]:
        yield each.warning(medium)
    if (more := len(found) - NAMED_MAX) > 0:
        yield f"so were packets of {more} more nodes (air[].too_long of the summary has them all)"
