"""Many links at once, as columns: a packet and one of its receivers each."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from channel.checks import FloatArray
from channel.geometry import Path
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
            path=_path_at(self.path, links),
            distance_m=self.distance_m[links],
            velocity_tx_ned_mps=_at(self.velocity_tx_ned_mps, links),
            velocity_rx_ned_mps=_at(self.velocity_rx_ned_mps, links),
        )


def _path_at(path: Path, links: Indices) -> Path:
    return path._replace(
        frequency_hz=_number_at(path.frequency_hz, links),
        distance_m=path.distance_m[links],
        height_tx_m=_number_at(path.height_tx_m, links),
        height_rx_m=_number_at(path.height_rx_m, links),
        position_tx_ned_m=_at(path.position_tx_ned_m, links),
        position_rx_ned_m=_at(path.position_rx_ned_m, links),
        attitude_tx_wxyz=_at(path.attitude_tx_wxyz, links),
        attitude_rx_wxyz=_at(path.attitude_rx_wxyz, links),
        emitters_ned_m=_emitters_at(path.emitters_ned_m, links),
    )


def _emitters_at(places: Mapping[str, FloatArray] | None, links: Indices) -> Mapping[str, FloatArray] | None:
    """Return places of emitters for some of the links; one place for all is (3,)."""
    if places is None:
        return None
    return {name: place if place.ndim == 1 else place[links] for name, place in places.items()}


def _number_at(column: float | FloatArray, links: Indices) -> float | FloatArray:
    return column[links] if isinstance(column, np.ndarray) else column


def _at(vectors: FloatArray | None, links: Indices) -> FloatArray | None:
    return None if vectors is None else vectors.T.take(links, axis=1).T
