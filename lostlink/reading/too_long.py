"""Packets that were too long to be on the air: by sender, with what there is to do about it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from bridge.record.tables.deliveries import FATES, TOO_LONG, Cause
from channel.medium.reception import Fate
from lostlink.reading.capacity import Capacity
from lostlink.reading.rows import DeliveryRows

NO_ROOM: Final = FATES.index(Fate.TOO_LONG_FOR_A_SLOT.value)
TRANSPORT: Final = FATES.index(Cause.TRANSPORT)


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

    @property
    def remark(self) -> str:
        """For the line of a verdict."""
        return f"{self.packets} of {self.of} packets of node {self.node} too long"

    def warning(self, medium: str) -> str:
        """What happened, and what to do."""
        many = f"all {self.of}" if self.packets == self.of else f"{self.packets} of {self.of}"
        head = f"node {self.node}: {many} packets that it transmitted were longer than"
        longest = f"the longest has {self.longest_bytes} bytes"
        if self.mtu_bytes is None:
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
    for fate in (TOO_LONG, NO_ROOM):
        for tx in np.unique(c["tx"][c["fate"] == fate]).tolist():
            node = rows.nodes[tx]
            mine = (c["tx"] == tx) & (c["fate"] != TRANSPORT)
            lost = mine & (c["fate"] == fate)
            longest_bytes = int(c["length_bytes"][lost].max())
            if fate == NO_ROOM:
                longest_bytes = capacity.payload_bytes(node, longest_bytes)
            mtu_bytes = capacity.radios[node].config.mtu_bytes if fate == TOO_LONG else None
            yield TooLong(node, _count(c["seq"][lost]), _count(c["seq"][mine]), longest_bytes, mtu_bytes)


def _count(numbers: NDArray[Any]) -> int:
    return len(np.unique(numbers))
