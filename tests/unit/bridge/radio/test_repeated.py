"""What free programs transmitted is taken again when the radio took it before; what was lost, is lost again."""

from __future__ import annotations

from pathlib import Path

from bridge.radio.repeated import RepeatedPackets
from bridge.record.names import packets
from bridge.record.packets import SentPacket, encode_packet
from bridge.record.streams import StreamWriter
from bridge.record.tables.deliveries import Cause, DeliveryWriter, Gap, Vocabulary, no_deliveries
from bridge.record.tables.truth import TruthWriter
from channel.medium.reception import EVERYBODY
from channel.network.entry import FIRST_EXACT
from tests.unit.bridge.record.runs import TICK_NS, row_at, truth_at
from tests.unit.bridge.record.tables.rows import append_rows

NODES = ("0", "1", "gcs")


def recorded(run: Path, sent: dict[str, list[tuple[int, int]]], *gaps: tuple[Gap, int]) -> Path:
    """A record of packets, each of a tick and a number, and of what was lost, each with its tick of reception."""
    for node, each in sent.items():
        with StreamWriter(packets(node).path(run)) as writer:
            for tick_ns, seq in each:
                packet = SentPacket(seq, tick_ns, "main/all/team", b"payload")
                writer.write(tick_ns, encode_packet(packet))
    deliveries = DeliveryWriter(run, NODES, words := Vocabulary())
    append_rows(deliveries, NODES, [row_at(0, "0", "1"), row_at(0, "1", "0")], words)
    for gap, received_ns in gaps:
        deliveries.write(no_deliveries(), [gap], received_ns)
    deliveries.close()
    return run


def taken(repeated: RepeatedPackets, until_ns: int) -> list[tuple[str, int]]:
    return [(item.node, item.seq) for item in repeated.before(until_ns)]


def test_packets_are_given_tick_by_tick_of_free_nodes_alone(tmp_path: Path) -> None:
    sent = {"0": [(0, 0)], "1": [(0, 0), (TICK_NS, 1)], "gcs": [(0, 0), (0, 1), (3 * TICK_NS, 2)]}
    repeated = RepeatedPackets(recorded(tmp_path, sent), NODES, {"gcs", "1"})
    assert taken(repeated, TICK_NS) == [("1", 0), ("gcs", 0), ("gcs", 1)]
    assert taken(repeated, TICK_NS) == []
    assert taken(repeated, 3 * TICK_NS) == [("1", 1)]
    assert taken(repeated, 3 * TICK_NS + 1) == [("gcs", 2)]
    assert taken(repeated, 9 * TICK_NS) == []


def test_packets_of_modems_are_their_own(tmp_path: Path) -> None:
    sent = {"1": [(0, 0), (1, FIRST_EXACT), (TICK_NS, 1), (TICK_NS + 1, 2 * FIRST_EXACT)]}
    repeated = RepeatedPackets(recorded(tmp_path, sent), NODES, {"1"})
    assert taken(repeated, 9 * TICK_NS) == [("1", 0), ("1", 1)]


def test_what_was_lost_before_the_channel_comes_before_what_follows_it(tmp_path: Path) -> None:
    long = Gap(TICK_NS, 1, 2, 1, 1, 2000, Cause.TOO_LONG, "team", "text/plain", "main")
    ahead = Gap(4 * TICK_NS, 1, EVERYBODY, 3, 2, 0, Cause.TRANSPORT)
    late = Gap(3 * TICK_NS, 1, EVERYBODY, 6, 1, 0, Cause.TRANSPORT)
    gaps = ((long, 2 * TICK_NS), (ahead, 2 * TICK_NS), (late, 4 * TICK_NS))
    sent = {"1": [(0, 0), (TICK_NS, 2), (TICK_NS, 5)]}
    repeated = RepeatedPackets(recorded(tmp_path, sent, *gaps), NODES, {"1"})
    assert taken(repeated, TICK_NS) == [("1", 0)]
    items = list(repeated.before(2 * TICK_NS))
    assert [item.seq for item in items] == [1, 2, 3, 5]
    assert [item.what for item in items if isinstance(item.what, Gap)] == [long, ahead]
    assert taken(repeated, 3 * TICK_NS) == []
    assert taken(repeated, 3 * TICK_NS + 1) == [("1", 6)]


def test_what_was_stamped_ahead_is_lost_at_the_tick_at_which_it_was(tmp_path: Path) -> None:
    """And what came after the last tick, after it."""
    ahead = Gap(4 * TICK_NS, 1, EVERYBODY, 1, 1, 2000, Cause.TOO_LONG)
    at_end = Gap(6 * TICK_NS, 1, EVERYBODY, 2, 1, 2000, Cause.TOO_LONG)
    gaps = ((ahead, 2 * TICK_NS), (at_end, 6 * TICK_NS))
    truth = TruthWriter(recorded(tmp_path, {"1": [(0, 0)]}, *gaps), NODES)
    for tick in range(6):
        truth.append(tick * TICK_NS, [truth_at("1", tick * TICK_NS)])
    truth.close()
    repeated = RepeatedPackets(tmp_path, NODES, {"1"})
    assert taken(repeated, TICK_NS) == [("1", 0)]
    assert taken(repeated, 2 * TICK_NS) == [("1", 1)]
    assert taken(repeated, 6 * TICK_NS) == []
    assert taken(repeated, 6 * TICK_NS + 1) == [("1", 2)]
