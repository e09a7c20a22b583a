"""What the router publishes of a tick: to each host its share, to others what they subscribe to, and nothing else."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from bridge.bus.keys import Keys
from bridge.bus.messages import Fates, Header
from bridge.bus.session import Session, Stamp
from bridge.radio.heard import Hosts
from bridge.radio.picture import Picture, Row
from bridge.radio.virtual_radio import Settled
from channel.medium.ledger import Ledger
from channel.medium.reception import DELIVERED, FATES

LINK_PERIOD_NS = 200_000_000
"""How often link reports are published, sim time."""
CAUSES = tuple(fate.value for fate in FATES)


class TickPublisher:
    """Publishes ticks.

    Args:
        session: the router's.
        keys: of the run.
        nodes: ids of all nodes, in the order of their indices.
        hosts: by name, the ids of their nodes.
    """

    def __init__(
        self, session: Session, keys: Keys, nodes: Sequence[str], hosts: Mapping[str, Sequence[str]]
    ) -> None:
        self._session = session
        self._keys = keys
        self._nodes = tuple(nodes)
        self._hosts = Hosts(nodes, hosts)
        self._picture = Picture(nodes)
        self._reported_ns = -LINK_PERIOD_NS
        self._wants_rx = [session.interest(keys.rx(node, "*", "*")) for node in nodes]
        self._wants_status = [session.interest(keys.comm_status(node)) for node in nodes]
        self._wants = {
            name: session.interest(keys.tick(name)) for name in ("fates", "communication", "links")
        }

    def to_nodes(self, sim_time_ns: int, settled: Settled) -> None:
        """What nodes get at their next tick: it goes out before the tick is released."""
        self._picture.take(settled.receptions)
        rows = self._picture.changed()
        for host, share in self._hosts.shares(sim_time_ns, settled, rows).items():
            self._session.put(self._keys.heard(host), share, must_arrive=True)
        self._forward(settled)
        self._tell_statuses(sim_time_ns, rows)

    def _forward(self, settled: Settled) -> None:
        """Put each packet that arrives where somebody beside the hosts listens, in canonical order."""
        wanted = np.array([wants() for wants in self._wants_rx], dtype=bool)
        if not wanted.any():
            return
        receptions = settled.receptions
        chosen = np.flatnonzero((receptions.fate == DELIVERED) & wanted[receptions.rx])
        rows = zip(receptions.packet[chosen].tolist(), receptions.rx[chosen].tolist(), strict=True)
        stamps: dict[int, bytes] = {}
        for number, rx in rows:
            packet = settled.packets[number]
            if number not in stamps:
                stamps[number] = Stamp(packet.seq, packet.sim_time_ns, b"").to_bytes()
            self._session.put_bytes(
                self._keys.rx(self._nodes[rx], self._nodes[packet.tx], packet.channel),
                packet.payload,
                encoding=packet.encoding or None,
                attachment=stamps[number],
                must_arrive=True,
            )

    def _tell_statuses(self, sim_time_ns: int, rows: Sequence[Row]) -> None:
        for row in rows:
            if self._wants_status[row.node]():
                key = self._keys.comm_status(self._nodes[row.node])
                self._session.put(key, self._picture.status(row, sim_time_ns), must_arrive=True)

    def to_observers(
        self, sim_time_ns: int, settled: Settled, ledger: Ledger, *, is_end: bool = False
    ) -> None:
        """What observers want to see: they can wait."""
        if self._wants["fates"]() and len(settled.receptions.rx):
            self._session.put(self._keys.tick("fates"), self._fates(sim_time_ns, settled))
        if self._wants["communication"]():
            self._session.put(self._keys.tick("communication"), self._picture.matrix(sim_time_ns))
        if is_end or sim_time_ns - self._reported_ns >= LINK_PERIOD_NS:
            self._reported_ns = sim_time_ns
            if self._wants["links"]():
                self._session.put(self._keys.tick("links"), self._picture.links(sim_time_ns, ledger))

    def _fates(self, sim_time_ns: int, settled: Settled) -> Fates:
        r, p = settled.receptions, settled.receptions.packets
        return Fates(
            Header.at(sim_time_ns, ""),
            self._nodes,
            CAUSES,
            p.tx[r.packet].astype(np.uint16),
            r.rx.astype(np.uint16),
            p.seq[r.packet],
            p.sim_time_ns[r.packet],
            settled.counted_bytes[r.packet].astype(np.uint32),
            r.distance_m,
            r.received_power_dbm,
            r.snr_db,
            r.per,
            r.fate.tobytes(),
        )
