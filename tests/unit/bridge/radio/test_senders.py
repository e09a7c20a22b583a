"""Packets are numbered by their senders: what is missing, too long, too much or repeated is told apart."""

from __future__ import annotations

from bridge.radio.senders import MAX_GAP, TAKEN_MAX_BYTES, Refused, Senders, TxPacket
from bridge.record.tables.deliveries import Cause, Gap
from channel.medium.reception import EVERYBODY

MTU_BYTES = 1000


def packet(seq: int, sim_time_ns: int = 5, tx: int = 0, length: int = 10) -> TxPacket:
    return TxPacket(seq, sim_time_ns, "main/all/team", bytes(length), tx=tx, to=EVERYBODY)


def senders(gaps: list[Gap] | None = None) -> Senders:
    return Senders([[MTU_BYTES, MTU_BYTES]], [].append if gaps is None else gaps.append)


def test_packets_come_out_by_time_sender_and_number() -> None:
    it = senders()
    for each in (packet(0, 9, tx=1), packet(0, 4), packet(1, 5), packet(2, 5), packet(1, 9, tx=1)):
        assert it.take(each)
    assert [(p.sim_time_ns, p.tx, p.seq) for p in it.taken()] == [
        (4, 0, 0),
        (5, 0, 1),
        (5, 0, 2),
        (9, 1, 0),
        (9, 1, 1),
    ]
    assert it.taken() == []


def test_a_jump_of_any_size_costs_one_gap() -> None:
    gaps: list[Gap] = []
    it = senders(gaps)
    assert it.take(packet(MAX_GAP))
    assert gaps == [Gap(5, 0, EVERYBODY, 0, MAX_GAP, 0, Cause.TRANSPORT)]
    assert not it.take(packet(2 * MAX_GAP + 2))
    assert it.refused == {Refused.MALFORMED: 1}
    assert len(gaps) == 1


def test_a_number_said_twice_is_refused() -> None:
    it = senders()
    assert it.take(packet(3))
    assert not it.take(packet(3))
    assert not it.take(packet(2))
    assert it.refused == {Refused.REPEATED: 2}


def test_a_packet_beyond_the_mtu_is_lost_before_the_channel() -> None:
    gaps: list[Gap] = []
    it = senders(gaps)
    assert it.take(packet(0, length=MTU_BYTES))
    assert it.take(packet(1, length=MTU_BYTES + 1))
    assert gaps == [Gap(5, 0, EVERYBODY, 1, 1, MTU_BYTES + 1, Cause.TOO_LONG, "team")]
    assert [each.seq for each in it.taken()] == [0]


def test_a_packet_from_before_the_one_before_is_refused_and_the_next_is_taken() -> None:
    it = senders()
    assert it.take(packet(0, 5))
    assert not it.take(packet(1, 4))
    assert it.refused == {Refused.BACKWARDS: 1}
    assert it.take(packet(1, 5))


def test_one_node_cannot_fill_the_memory_nor_stop_another() -> None:
    gaps: list[Gap] = []
    it = Senders([[TAKEN_MAX_BYTES, TAKEN_MAX_BYTES]], gaps.append)
    big = bytes(TAKEN_MAX_BYTES // 2)
    taken = [it.take(TxPacket(seq, 0, "main/all/team", big, tx=0, to=EVERYBODY)) for seq in range(4)]
    assert taken == [True, True, False, False]
    assert it.refused == {Refused.OVERLOAD: 2}
    assert it.take(packet(0, tx=1))
    it.taken()
    assert it.take(packet(4))  # it goes on from where it was refused
    assert [(gap.first_seq, gap.packets, gap.cause) for gap in gaps] == [
        (2, 1, Cause.TRANSPORT),
        (3, 1, Cause.TRANSPORT),
    ]


def test_what_a_sender_counted_and_never_came_is_a_gap() -> None:
    gaps: list[Gap] = []
    it = senders(gaps)
    it.take(packet(0))
    assert it.told_total(0, 4, 77)
    assert gaps == [Gap(77, 0, EVERYBODY, 1, 3, 0, Cause.TRANSPORT)]
    assert not it.told_total(0, MAX_GAP + 5, 77)
    assert not it.told_total(0, -1, 77)


def test_what_is_known_to_be_lost_is_booked_once() -> None:
    gaps: list[Gap] = []
    it = senders(gaps)
    long = Gap(5, 0, EVERYBODY, 0, 1, 2000, Cause.TOO_LONG, "team")
    it.lose(long)
    assert it.take(packet(1))
    assert gaps == [long]
    assert it.next_packet(0)[0] == 2
