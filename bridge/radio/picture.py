"""What is known of each link by now: who was heard, and the latest packet's figures; as matrices of nodes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bridge.bus.messages import CommunicationMatrix, CommunicationStatus, Header, Links
from channel.medium.ledger import Ledger
from channel.medium.reception import DELIVERED, Receptions

LINK_PERIOD_NS = 200_000_000
"""How often link reports are published, sim time."""


class Row(NamedTuple):
    """The communication status of one node: other nodes by index, and whether their latest packets arrived."""

    node: int
    others: NDArray[np.intp]
    delivered: NDArray[np.bool_]


class Picture:
    """The newest of each link. Matrices are indexed [receiver, sender]."""

    def __init__(self, nodes: Sequence[str]) -> None:
        self._nodes = tuple(nodes)
        shape = (len(nodes), len(nodes))
        self._known = np.zeros(shape, dtype=bool)
        self._delivered = np.zeros(shape, dtype=bool)
        self._changed = np.zeros(len(nodes), dtype=bool)
        self._when = np.zeros(shape, dtype=np.int64)
        self._figures = np.full((4, *shape), np.nan)

    def take(self, receptions: Receptions) -> None:
        """Take fates in canonical order: the later ones stand."""
        rx, tx = receptions.rx, receptions.packets.tx[receptions.packet]
        self._known[rx, tx] = True
        self._delivered[rx, tx] = receptions.fate == DELIVERED
        self._changed[rx] = True
        self._when[rx, tx] = receptions.packets.sim_time_ns[receptions.packet]
        columns = (
            receptions.distance_m,
            receptions.received_power_dbm,
            receptions.snr_db,
            receptions.per,
        )
        for kept, values in zip(self._figures, columns, strict=True):
            kept[rx, tx] = values

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

    def links(self, sim_time_ns: int, ledger: Ledger, radios_off: NDArray[np.bool_]) -> Links:
        """All links that carried a packet, and which nodes' radios are off."""
        tx, rx = np.nonzero(self._known.T)
        sent, delivered = ledger.sent[tx, rx], ledger.settled[tx, rx, DELIVERED]
        distance_m, received_power_dbm, snr_db, per = (kept[rx, tx] for kept in self._figures)
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
        )
