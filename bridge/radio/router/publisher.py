"""What the router publishes of a tick: to each host its share, to others what they subscribe to, and nothing else."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bridge.bus.messages import Header, RadioStatus
from bridge.bus.reception import Instants, attachment
from bridge.bus.session import Session, Stamp
from bridge.radio.measurements import Told, as_message
from bridge.radio.network_air import QueueOfNode, ReplyToNode, Settled
from bridge.radio.picture import LINK_PERIOD_NS, Row
from bridge.radio.radio import RecordedRadio, SettledTick
from bridge.record.tables.deliveries import INSTANTS, fates_message
from bridge.run.directory import RunDirectory
from channel.medium.reception import DELIVERED


class TickPublisher:
    """Publishes ticks.

    Args:
        session: the router's.
        run: the run.
        radio: what is published.
    """

    def __init__(self, session: Session, run: RunDirectory, radio: RecordedRadio) -> None:
        keys, nodes = run.keys, run.scenario.transceiver_ids
        self._session, self._keys, self._nodes = session, keys, nodes
        self._radio, self._picture = radio, radio.picture
        self._reported_ns = -LINK_PERIOD_NS
        self._wants_rx = [session.interest(keys.rx(node, "*", "*")) for node in nodes]
        self._wants_status = [session.interest(keys.comm_status(node)) for node in nodes]
        self._wants_radio = [session.interest(keys.radio_status(node)) for node in nodes]
        self._networks = run.scenario.network_names
        self._waiting: dict[tuple[int, int], QueueOfNode] = {}
        """Transmit queues that are not empty, by node and network."""
        self._wants_measurements = [session.interest(keys.measurements(node)) for node in nodes]
        self._wants = {
            name: session.interest(keys.tick(name)) for name in ("fates", "communication", "links")
        }

    def to_nodes(self, tick: SettledTick) -> None:
        """What nodes get at their next tick, for whoever subscribes: it goes out before the tick is released."""
        self._forward(tick.settled)
        self._tell_statuses(tick.sim_time_ns, tick.rows)
        self._tell_radios(tick.sim_time_ns, tick.settled)
        self._tell_measurements(tick.sim_time_ns, tick.told)

    def _forward(self, settled: Settled) -> None:
        """Put each packet that arrives where somebody beside the hosts listens, in canonical order."""
        wanted = np.array([wants() for wants in self._wants_rx], dtype=bool)
        if not wanted.any():
            return
        receptions = settled.receptions
        chosen = np.flatnonzero((receptions.fate == DELIVERED) & wanted[receptions.rx])
        columns = (receptions.packet, receptions.rx, receptions.received_power_dbm, receptions.snr_db)
        instants = (settled.columns[name] for name in INSTANTS)
        rows = zip(*(column[chosen].tolist() for column in (*columns, *instants)), strict=True)
        stamps: dict[int, bytes] = {}
        for number, rx, rssi_dbm, snr_db, *when in rows:
            packet = settled.packets[number]
            if number not in stamps:
                stamps[number] = Stamp(packet.seq, packet.sim_time_ns, b"").to_bytes()
            self._session.put_bytes(
                self._keys.rx(self._nodes[rx], self._nodes[packet.tx], packet.channel),
                packet.payload,
                encoding=packet.encoding,
                attachment=attachment(stamps[number], rssi_dbm, snr_db, Instants(*when), packet.radio),
                must_arrive=True,
            )

    def _tell_statuses(self, sim_time_ns: int, rows: Sequence[Row]) -> None:
        for row in rows:
            if self._wants_status[row.node]():
                key = self._keys.comm_status(self._nodes[row.node])
                self._session.put(key, self._picture.status(row, sim_time_ns), must_arrive=True)

    def _tell_radios(self, sim_time_ns: int, settled: Settled) -> None:
        """Put what a node's own radios report: queues that changed or, for whoever has just joined, are not empty."""
        queues = self._waiting | {(each.node, each.network): each for each in settled.queues}
        self._waiting = {key: each for key, each in queues.items() if each.packets or each.length_bytes}
        nodes = {node for node, _ in queues} | {each.node for each in settled.replies}
        for node in sorted(nodes):
            if self._wants_radio[node]():
                mine = [each for each in queues.values() if each.node == node]
                replies = [each for each in settled.replies if each.node == node]
                header = Header.at(sim_time_ns, self._nodes[node])
                status = radio_status(header, mine, replies, self._networks)
                self._session.put(self._keys.radio_status(self._nodes[node]), status, must_arrive=True)

    def _tell_measurements(self, sim_time_ns: int, told: Sequence[Told]) -> None:
        """Put what each sensor reports where somebody beside the hosts listens."""
        for node in sorted({each.node for each in told}):
            if self._wants_measurements[node]():
                mine = [each for each in told if each.node == node]
                message = as_message(sim_time_ns, mine, self._nodes[node])
                self._session.put(self._keys.measurements(self._nodes[node]), message, must_arrive=True)

    def to_observers(self, tick: SettledTick, *, is_end: bool = False) -> None:
        """What observers want to see: they can wait."""
        sim_time_ns, settled = tick.sim_time_ns, tick.settled
        if self._wants["fates"]() and len(settled.receptions.rx):
            fates = fates_message(sim_time_ns, self._nodes, settled.columns, self._networks)
            self._session.put(self._keys.tick("fates"), fates)
        if self._wants["communication"]():
            self._session.put(self._keys.tick("communication"), self._picture.matrix(sim_time_ns))
        if is_end or sim_time_ns - self._reported_ns >= LINK_PERIOD_NS:
            self._reported_ns = sim_time_ns
            if self._wants["links"]():
                self._session.put(self._keys.tick("links"), self._radio.links(sim_time_ns))


def radio_status(
    header: Header,
    queues: Sequence[QueueOfNode],
    replies: Sequence[ReplyToNode],
    networks: Sequence[str],
) -> RadioStatus:
    """What one node's radios report as a message; ``networks`` are the names of all of the run."""
    told = [each.reply for each in replies]
    return RadioStatus(
        header,
        tuple(networks[each.network] for each in queues),
        [each.packets for each in queues],
        [each.length_bytes for each in queues],
        tuple(networks[each.network] for each in replies),
        [each.packet.number for each in told],
        [each.acknowledged for each in told],
        [each.attempts for each in told],
        [each.at_ns for each in told],
    )
