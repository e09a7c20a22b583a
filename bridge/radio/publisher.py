"""What the router publishes of a tick: to each host its share, to others what they subscribe to, and nothing else."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from bridge.bus.keys import Keys
from bridge.bus.reception import attachment
from bridge.bus.session import Session, Stamp
from bridge.radio.heard import Hosts
from bridge.radio.measurements import Told, as_message
from bridge.radio.picture import LINK_PERIOD_NS, Picture, Row
from bridge.radio.virtual_radio import Settled
from bridge.record.tables.deliveries import fates_message
from channel.medium.ledger import Ledger
from channel.medium.reception import DELIVERED


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
        self._wants_measurements = [session.interest(keys.measurements(node)) for node in nodes]
        self._wants = {
            name: session.interest(keys.tick(name)) for name in ("fates", "communication", "links")
        }

    def to_nodes(self, sim_time_ns: int, settled: Settled, told: Sequence[Told] = ()) -> None:
        """What nodes get at their next tick, with what their sensors tell: it goes out before the tick is released."""
        self._picture.take(settled.columns)
        rows = self._picture.changed()
        for host, share in self._hosts.shares(sim_time_ns, settled, rows, told).items():
            self._session.put(self._keys.heard(host), share, must_arrive=True)
        self._forward(settled)
        self._tell_statuses(sim_time_ns, rows)
        self._tell_measurements(sim_time_ns, told)

    def _forward(self, settled: Settled) -> None:
        """Put each packet that arrives where somebody beside the hosts listens, in canonical order."""
        wanted = np.array([wants() for wants in self._wants_rx], dtype=bool)
        if not wanted.any():
            return
        receptions = settled.receptions
        chosen = np.flatnonzero((receptions.fate == DELIVERED) & wanted[receptions.rx])
        columns = (receptions.packet, receptions.rx, receptions.received_power_dbm, receptions.snr_db)
        rows = zip(*(column[chosen].tolist() for column in columns), strict=True)
        stamps: dict[int, bytes] = {}
        for number, rx, rssi_dbm, snr_db in rows:
            packet = settled.packets[number]
            if number not in stamps:
                stamps[number] = Stamp(packet.seq, packet.sim_time_ns, b"").to_bytes()
            self._session.put_bytes(
                self._keys.rx(self._nodes[rx], self._nodes[packet.tx], packet.channel),
                packet.payload,
                encoding=packet.encoding or None,
                attachment=attachment(stamps[number], rssi_dbm, snr_db),
                must_arrive=True,
            )

    def _tell_statuses(self, sim_time_ns: int, rows: Sequence[Row]) -> None:
        for row in rows:
            if self._wants_status[row.node]():
                key = self._keys.comm_status(self._nodes[row.node])
                self._session.put(key, self._picture.status(row, sim_time_ns), must_arrive=True)

    def _tell_measurements(self, sim_time_ns: int, told: Sequence[Told]) -> None:
        """Put what each sensor tells where somebody beside the hosts listens."""
        for node in sorted({each.node for each in told}):
            if self._wants_measurements[node]():
                mine = [each for each in told if each.node == node]
                message = as_message(sim_time_ns, mine, self._nodes[node])
                self._session.put(self._keys.measurements(self._nodes[node]), message, must_arrive=True)

    def to_observers(
        self,
        sim_time_ns: int,
        settled: Settled,
        ledger: Ledger,
        radios_off: Callable[[int], NDArray[np.bool_]],
        *,
        is_end: bool = False,
    ) -> None:
        """What observers want to see: they can wait."""
        if self._wants["fates"]() and len(settled.receptions.rx):
            fates = fates_message(sim_time_ns, self._nodes, settled.columns)
            self._session.put(self._keys.tick("fates"), fates)
        if self._wants["communication"]():
            self._session.put(self._keys.tick("communication"), self._picture.matrix(sim_time_ns))
        if is_end or sim_time_ns - self._reported_ns >= LINK_PERIOD_NS:
            self._reported_ns = sim_time_ns
            if self._wants["links"]():
                links = self._picture.links(sim_time_ns, ledger, radios_off(sim_time_ns))
                self._session.put(self._keys.tick("links"), links)
