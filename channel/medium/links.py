"""Many links at once, as columns: a packet and one of its receivers each."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from channel.checks import FloatArray
from channel.geometry import Path, path_at, vectors_at
from channel.medium.reception import Packets

Indices = NDArray[np.intp]


class LinksOfPass(NamedTuple):
    """L links of one pass.

    Attributes:
        packets: what was sent.
        packet: row of `packets`, shape (L,).
        tx: transmitting node, index, shape (L,).
        rx: receiving node, index, shape (L,).
        path: geometry: positions and attitudes of shape (L, 3) and (L, 4), heights and distances of shape (L,).
        distance_m: between the ends, not clamped, shape (L,).
        velocity_tx_ned_mps: shape (L, 3), or None if no random term asks for it.
        velocity_rx_ned_mps: likewise.
    """

    packets: Packets
    packet: Indices
    tx: Indices
    rx: Indices
    path: Path
    distance_m: FloatArray
    velocity_tx_ned_mps: FloatArray | None = None
    velocity_rx_ned_mps: FloatArray | None = None

    @property
    def seq(self) -> NDArray[np.int64]:
        """Sequence numbers, shape (L,)."""
        return self.packets.seq[self.packet]

    @property
    def sim_time_ns(self) -> NDArray[np.int64]:
        """When the packets were sent, shape (L,)."""
        return self.packets.sim_time_ns[self.packet]

    def at(self, links: Indices) -> LinksOfPass:
        """Return some of the links."""
        return self._replace(
            packet=self.packet[links],
            tx=self.tx[links],
            rx=self.rx[links],
            path=path_at(self.path, links),
            distance_m=self.distance_m[links],
            velocity_tx_ned_mps=vectors_at(self.velocity_tx_ned_mps, links),
            velocity_rx_ned_mps=vectors_at(self.velocity_rx_ned_mps, links),
        )
