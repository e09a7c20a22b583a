"""What is known of each link by now: who was heard, and the latest packet's figures; as matrices of nodes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bridge.bus.messages import CommunicationMatrix, CommunicationStatus, Header, Links
from bridge.record.tables.deliveries import DELIVERED, FIGURES
from bridge.record.tables.schema import Columns

LINK_PERIOD_NS = 200_000_000
"""How often link reports are published, sim time."""


class Row(NamedTuple):
    """The communication status of one node: other nodes by index, and whether their latest packets arrived."""

    node: int
    others: NDArray[np.intp]
    delivered: NDArray[np.bool_]


class Picture:
    """The newest of each link. Matrices are indexed [receiver, sender], those per network [network, receiver, sender].

    Args:
        nodes: ids of all nodes.
        networks: names of the radio networks, by which rows name them.
    """

    def __init__(self, nodes: Sequence[str], networks: Sequence[str]) -> None:
        self._nodes, self._networks = tuple(nodes), tuple(networks)
        shape = (len(nodes), len(nodes))
        self._known = np.zeros(shape, dtype=bool)
        self._delivered = np.zeros(shape, dtype=bool)
        self._changed = np.zeros(len(nodes), dtype=bool)
        self._carried = np.zeros((len(networks), *shape), dtype=bool)
        self._figures = np.full((4, len(networks), *shape), np.nan)

    def take(self, columns: Columns) -> None:
        """Take rows of deliveries in canonical order, one per receiver and none of gaps: the later ones stand."""
        radio, rx, tx = columns["radio"], columns["rx"], columns["tx"]
        self._known[rx, tx] = True
        self._delivered[rx, tx] = columns["fate"] == DELIVERED
        self._changed[rx] = True
        self._carried[radio, rx, tx] = True
        for kept, name in zip(self._figures, FIGURES, strict=True):
            kept[radio, rx, tx] = columns[name]

    def changed(self) -> list[Row]:
        """The communication status of each node that got, or missed, a packet since the last call."""
        rows = []
        for node in np.flatnonzero(self._changed).tolist():
            others = np.flatnonzero(self._known[node])
            rows.append(Row(node, others, self._delivered[node, others]))
        self._changed[:] = False
        return rows

    def status(self, row: Row, sim_time_ns: int) -> CommunicationStatus:
        """One node's row as a message of its own."""
        others = tuple(self._nodes[other] for other in row.others.tolist())
        return CommunicationStatus(
            Header.at(sim_time_ns, self._nodes[row.node]), others, tuple(row.delivered.tolist())
        )

    def matrix(self, sim_time_ns: int) -> CommunicationMatrix:
        """All nodes' status."""
        header = Header.at(sim_time_ns, "")
        return CommunicationMatrix(header, self._nodes, self._known.ravel(), self._delivered.ravel())

    def links(
        self, sim_time_ns: int, settled: Sequence[NDArray[np.int64]], radios_off: NDArray[np.bool_]
    ) -> Links:
        """All links that carried a packet, and which nodes' radios are off.

        Packets count when it is known what became of them, as in the fates of ticks.

        Args:
            sim_time_ns: the tick.
            settled: packets of each network by what became of them, shape (nodes, nodes, causes), senders first.
            radios_off: whether each node's is, shape (nodes,).
        """
        radio, tx, rx = np.nonzero(self._carried.transpose(0, 2, 1))
        of_networks = enumerate(settled)
        counts = np.concatenate([each[tx[radio == place], rx[radio == place]] for place, each in of_networks])
        sent, delivered = counts.sum(axis=-1), counts[:, DELIVERED]
        distance_m, received_power_dbm, snr_db, per = (kept[radio, rx, tx] for kept in self._figures)
        return Links(
            Header.at(sim_time_ns, ""),
            self._nodes,
            tx.astype(np.uint16),
            rx.astype(np.uint16),
            distance_m,
            received_power_dbm,
            snr_db,
            per,
            sent.astype(np.uint64),
            delivered.astype(np.uint64),
            np.flatnonzero(radios_off).astype(np.uint16),
            self._networks,
            radio.astype(np.uint16),
        )
