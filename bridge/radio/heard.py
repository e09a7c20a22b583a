"""What each host gets at the end of a tick: one message for all its nodes, each packet in it once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import accumulate

import numpy as np
from numpy.typing import NDArray

from bridge.bus.messages import Header, Heard, Measurements
from bridge.radio.measurements import as_message
from bridge.radio.network_air import QueueOfNode, ReplyToNode, Settled
from bridge.radio.picture import Row
from bridge.radio.radio import SettledTick
from bridge.radio.serial_output import SerialOutput
from bridge.record.tables.deliveries import INSTANTS
from channel.medium.reception import DELIVERED


class Hosts:
    """Which host a node's share goes to.

    Args:
        nodes: all node ids.
        groups: by host, the ids of its nodes.
    """

    def __init__(self, nodes: Sequence[str], groups: Mapping[str, Sequence[str]]) -> None:
        self.names = tuple(groups)
        host_of = {node: index for index, name in enumerate(self.names) for node in groups[name]}
        self._host_of: NDArray[np.intp] = np.array([host_of.get(node, -1) for node in nodes], dtype=np.intp)

    def shares(self, tick: SettledTick) -> dict[str, Heard]:
        """The message for each host for whose nodes there is something."""
        sim_time_ns, settled, rows, told = tick.sim_time_ns, tick.settled, tick.rows, tick.told
        receptions = settled.receptions
        arrived = np.flatnonzero(receptions.fate == DELIVERED)
        hosts = self._host_of[receptions.rx[arrived]]
        found = {}
        for host, name in enumerate(self.names):
            mine = arrived[hosts == host]
            statuses = [row for row in rows if self._host_of[row.node] == host]
            measured = [each for each in told if self._host_of[each.node] == host]
            replies = [each for each in settled.replies if self._host_of[each.node] == host]
            queues = [each for each in settled.queues if self._host_of[each.node] == host]
            serial = [each for each in settled.serial if self._host_of[each.node] == host]
            if statuses or measured or mine.size or replies or queues or serial:
                header = Header.at(sim_time_ns, name)
                message = as_message(sim_time_ns, measured)
                found[name] = _share(header, settled, mine, statuses, replies, queues, serial, message)
        return found


def _share(
    header: Header,
    settled: Settled,
    mine: NDArray[np.intp],
    statuses: Sequence[Row],
    replies: Sequence[ReplyToNode],
    queues: Sequence[QueueOfNode],
    serial: Sequence[SerialOutput],
    measurements: Measurements,
) -> Heard:
    receptions = settled.receptions
    wanted, row = np.unique(receptions.packet[mine], return_inverse=True)
    packets = [settled.packets[index] for index in wanted.tolist()]
    lengths = [len(each.payload) for each in packets]
    entered_ns, started_ns, ended_ns, arrived_ns = (settled.columns[name][mine] for name in INSTANTS)
    return Heard(
        header,
        [each.tx for each in packets],
        [each.seq for each in packets],
        [each.sim_time_ns for each in packets],
        tuple(each.channel for each in packets),
        [*accumulate(lengths)],
        b"".join(each.payload for each in packets),
        np.array([each.network for each in packets], dtype=np.uint16),
        row.astype(np.uint32),
        receptions.rx[mine].astype(np.uint16),
        receptions.received_power_dbm[mine].astype(np.float32),
        receptions.snr_db[mine].astype(np.float32),
        entered_ns,
        started_ns,
        ended_ns,
        arrived_ns,
        [each.node for each in replies],
        [each.reply.packet.number for each in replies],
        [each.reply.at_ns for each in replies],
        [each.reply.acknowledged for each in replies],
        [each.reply.attempts for each in replies],
        [each.network for each in replies],
        [each.node for each in queues],
        [each.packets for each in queues],
        [each.length_bytes for each in queues],
        [each.network for each in queues],
        [each.node for each in statuses],
        [*accumulate(len(each.others) for each in statuses)],
        _joined([each.others for each in statuses], np.uint16),
        _joined([each.delivered for each in statuses], np.bool_),
        [each.node for each in serial],
        [each.at_ns for each in serial],
        [each.network for each in serial],
        [*accumulate(len(each.data) for each in serial)],
        b"".join(each.data for each in serial),
        measurements,
    )


def _joined(columns: Sequence[NDArray[np.generic]], dtype: type[np.generic]) -> NDArray[np.generic]:
    return np.concatenate(columns).astype(dtype) if columns else np.zeros(0, dtype=dtype)
