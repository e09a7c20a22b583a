"""From the radio's message for a host to what comes for each of its nodes."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np

from bridge.agents.measurements import measurements_by_node
from bridge.agents.radio import QueueState, UnicastReply
from bridge.agents.running.feed import Arrivals, DeliveredPacket
from bridge.bus.keys import MAIN
from bridge.bus.messages import CommunicationStatus, Header, Heard
from bridge.bus.reception import Instants
from bridge.bus.session import Stamp

OnSerial = Callable[[str, str, int, bytes], object]
"""Called with a node, the name of its modem's network, an instant, and bytes that came out there."""


def hand_out_serial(
    heard: Heard, nodes: Sequence[str], on_serial: OnSerial, networks: Sequence[str] = (MAIN,)
) -> None:
    """Give each node what has come out of its modems.

    Raises:
        ValueError: the message does not fit the run.
    """
    ends = (0, *plain(heard.serial_end))
    columns = (plain(each) for each in (heard.serial_of, heard.serial_radio, heard.serial_ns))
    try:
        for node, radio, at_ns, (begin, end) in zip(*columns, pairwise(ends), strict=True):
            on_serial(nodes[node], networks[radio], at_ns, bytes(heard.serial_data[begin:end]))
    except (IndexError, KeyError) as error:
        raise ValueError(f"serial bytes for a node that is not here: {error!r}") from error


def hand_out(
    heard: Heard,
    nodes: Sequence[str],
    receivers: Mapping[str, Arrivals],
    networks: Sequence[str] = (MAIN,),
) -> None:
    """Give each node what is for it; packets are shared between those that get them.

    Args:
        heard: the message.
        nodes: ids of all nodes of the run, in the order of their indices.
        receivers: the nodes of this host by id.
        networks: names of all radio networks of the run, likewise.

    Raises:
        ValueError: the message does not fit the run.
    """
    try:
        _hand_out(heard, nodes, receivers, networks)
    except (IndexError, KeyError) as error:
        raise ValueError(f"not for a host with nodes {', '.join(receivers)}: {error!r}") from error


def _hand_out(
    heard: Heard, nodes: Sequence[str], receivers: Mapping[str, Arrivals], networks: Sequence[str]
) -> None:
    ends = plain(heard.end)
    packets = [
        DeliveredPacket(nodes[tx], channel, heard.data[begin:end], Stamp(seq, sim_time_ns), networks[radio])
        for tx, channel, (begin, end), seq, sim_time_ns, radio in zip(
            heard.tx,
            heard.channel,
            pairwise((0, *ends)),
            heard.seq,
            heard.sim_time_ns,
            heard.radio,
            strict=True,
        )
    ]
    by_index = {index: receivers[node] for index, node in enumerate(nodes) if node in receivers}
    columns = (plain(each) for each in (heard.packet, heard.rx, heard.rssi_dbm, heard.snr_db))
    instants = (
        plain(each) for each in (heard.entered_ns, heard.started_ns, heard.ended_ns, heard.arrived_ns)
    )
    for index, rx, rssi_dbm, snr_db, *when in zip(*columns, *instants, strict=True):
        by_index[rx].packet_came(packets[index], rssi_dbm, snr_db, Instants(*when))
    replies = heard.reply_seq, heard.reply_acknowledged, heard.reply_attempts, heard.reply_ns
    for node, radio, *reply in zip(heard.reply_to, heard.reply_radio, *replies, strict=True):
        by_index[node].reply_came(UnicastReply(*reply), networks[radio])
    queues = heard.queue_radio, heard.queue_packets, heard.queue_bytes
    for node, radio, *queue in zip(heard.queue_of, *queues, strict=True):
        by_index[node].queue_changed(QueueState(*queue), networks[radio])
    for node, (begin, end) in zip(heard.status_of, pairwise((0, *plain(heard.status_end))), strict=True):
        by_index[node].comm_status_came(partial(_status, heard, nodes, nodes[node], begin, end))
    for node, measurements in measurements_by_node(heard.measurements).items():
        by_index[node].measurements_came(measurements)


def _status(heard: Heard, nodes: Sequence[str], node: str, begin: int, end: int) -> CommunicationStatus:
    others = tuple(nodes[other] for other in plain(heard.status_node[begin:end]))
    header = Header(heard.header.stamp, node)
    return CommunicationStatus(header, others, tuple(plain(heard.status_delivered[begin:end])))


def plain(values: Any) -> Sequence[Any]:
    """Python's numbers: a message that was not on a bus has arrays, whose numbers would compute otherwise."""
    found: Sequence[Any] = values.tolist() if isinstance(values, np.ndarray) else values
    return found
