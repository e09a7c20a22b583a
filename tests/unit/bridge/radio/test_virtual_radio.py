"""The radio router's core: what it takes, refuses, books and settles."""

from __future__ import annotations

import pytest

from bridge.bus.keys import Address
from bridge.bus.session import Stamp
from bridge.radio.senders import Refused
from bridge.radio.virtual_radio import ENCODING_MAX, VirtualRadio
from bridge.record.tables.deliveries import Cause
from tests.unit.bridge.radio.core import MTU_BYTES, TICK_NS, fates, place, send, virtual_radio


def counts(core: VirtualRadio, tx: int, rx: int) -> tuple[int, int]:
    account = core.airs[0].ledger.account(core.nodes[tx], core.nodes[rx])
    return account.sent, account.delivered


def test_packet_arrives_with_its_bytes_encoding_and_number() -> None:
    core = virtual_radio()
    place(core, 0, n0=0.0, n1=100.0)
    assert send(core, "0", payload=b"\x00payload")
    settled = core.settle()
    (packet,) = settled.packets
    assert (packet.payload, packet.encoding, packet.seq) == (b"\x00payload", "text/plain", 0)
    assert packet.channel == "team"
    assert fates(core, settled) == [("0", "1", 0, "delivered")]


def test_what_is_said_of_a_payload_is_bounded() -> None:
    core = virtual_radio()
    address, stamp = Address("0", "main", "all", "team"), Stamp(0, 0)
    assert not core.on_packet(address, b"", "x" * (ENCODING_MAX + 1), stamp)
    assert core.refused == {Refused.MALFORMED: 1}
    assert core.on_packet(address, b"", "x" * ENCODING_MAX, stamp)


def test_packet_waits_for_the_truth_of_its_instant() -> None:
    core = virtual_radio()
    place(core, 0, n0=0.0, n1=100.0)
    send(core, "0", sim_time_ns=TICK_NS)
    assert fates(core, core.settle()) == []
    place(core, TICK_NS, n0=0.0)
    assert fates(core, core.settle()) == []
    place(core, TICK_NS, n1=100.0)
    assert fates(core, core.settle()) == [("0", "1", 0, "delivered")]


def test_a_unicast_packet_is_offered_to_its_addressee_alone() -> None:
    core = virtual_radio(nodes=("0", "1", "2"))
    place(core, 0, n0=0.0, n1=1.0, n2=2.0)
    assert send(core, "0", 0, to="2")
    assert send(core, "0", 1)
    assert [each[1:3] for each in fates(core, core.settle())] == [("2", 0), ("1", 1), ("2", 1)]
    assert (counts(core, 0, 1), counts(core, 0, 2)) == ((1, 1), (2, 2))
    core.finish()


def test_out_of_range_is_lost_and_booked() -> None:
    core = virtual_radio("disk")
    place(core, 0, n0=0.0, n1=1e6)
    send(core, "0")
    assert fates(core, core.settle()) == [("0", "1", 0, "out_of_range")]
    assert counts(core, 0, 1) == (1, 0)


def test_missing_numbers_are_the_hosts_losses() -> None:
    core = virtual_radio(nodes=("0", "1", "2"))
    place(core, 0, n0=0.0, n1=1.0, n2=2.0)
    send(core, "0", 3)
    settled = core.settle()
    assert [(gap.first_seq, gap.packets, gap.cause) for gap in settled.gaps] == [(0, 3, Cause.TRANSPORT)]
    assert counts(core, 0, 2) == (4, 1)
    core.on_sent_total("0", 6)
    core.on_sent_total("0", 6)
    assert counts(core, 0, 1) == (6, 1)
    core.finish()


@pytest.mark.parametrize(
    ("address", "stamp", "reason"),
    [
        (Address("9", "main", "all", "team"), Stamp(0, 0), Refused.UNKNOWN_NODE),
        (Address("0", "main", "9", "team"), Stamp(1, 0), Refused.UNKNOWN_ADDRESS),
        (Address("0", "main", "0", "team"), Stamp(1, 0), Refused.UNKNOWN_ADDRESS),
        (Address("0", "spare", "all", "team"), Stamp(1, 0), Refused.UNKNOWN_RADIO),
        (Address("0", "main", "all", "team"), None, Refused.WITHOUT_STAMP),
        (Address("0", "main", "all", "team"), Stamp(0, 0), Refused.REPEATED),
        (Address("0", "main", "all", "team"), Stamp(-5, 0), Refused.REPEATED),
        (Address("0", "main", "all", "team"), Stamp(2**62, 0), Refused.MALFORMED),
        (Address("0", "main", "all", "team"), Stamp(1, 2**62), Refused.MALFORMED),
        (Address("0", "main", "all", "team"), Stamp(1, -1), Refused.MALFORMED),
    ],
)
def test_what_is_refused_is_counted_by_reason(address: Address, stamp: Stamp | None, reason: Refused) -> None:
    core = virtual_radio()
    place(core, 0, n0=0.0, n1=1.0)
    send(core, "0")
    assert not core.on_packet(address, b"x", "", stamp)
    assert core.refused == {reason: 1}
    assert len(fates(core, core.settle())) == 1
    core.finish()


@pytest.mark.parametrize("sim_time_ns", [-1, 2**62])
def test_truths_ticks_and_answers_of_an_impossible_time_are_refused(sim_time_ns: int) -> None:
    core = virtual_radio()
    place(core, 0, n0=0.0, n1=1.0)
    place(core, sim_time_ns, n0=0.0)
    core.on_tick(sim_time_ns)
    assert core.on_answer("0", sim_time_ns) is core.on_answer("1", sim_time_ns) is None
    assert core.refused == {Refused.MALFORMED: 4}
    core.on_tick(TICK_NS)
    assert core.ring.waiting_for == ("0", "1")


def test_strangers_are_counted() -> None:
    core = virtual_radio()
    place(core, 0, n9=0.0)
    core.on_answer("9", 0)
    core.on_sent_total("9", 1)
    assert core.refused == {Refused.UNKNOWN_NODE: 3}


@pytest.mark.parametrize("order", [("0", "1"), ("1", "0")])
def test_gaps_of_a_tick_do_not_depend_on_who_was_first(order: tuple[str, str]) -> None:
    core = virtual_radio()
    place(core, 0, n0=0.0, n1=100.0)
    for node in order:
        send(core, node, payload=bytes(MTU_BYTES + 1))
    assert [gap.tx for gap in core.settle().gaps] == [0, 1]


def test_packet_that_is_too_long_is_booked_as_such() -> None:
    core = virtual_radio()
    place(core, 0, n0=0.0, n1=1.0)
    send(core, "0", 0, payload=bytes(MTU_BYTES + 1))
    send(core, "0", 1)
    settled = core.settle()
    assert [(gap.first_seq, gap.cause) for gap in settled.gaps] == [(0, Cause.TOO_LONG)]
    assert fates(core, settled) == [("0", "1", 1, "delivered")]
    assert counts(core, 0, 1) == (2, 1)
    core.finish()


@pytest.mark.parametrize("sent", [-1, 2**62])
def test_impossible_count_of_a_sender_books_nothing(sent: int) -> None:
    core = virtual_radio()
    core.on_sent_total("0", sent)
    assert core.refused == {Refused.MALFORMED: 1}
    assert core.settle().gaps == []


def test_an_impossible_number_of_a_packet_that_was_dropped_books_nothing() -> None:
    core = virtual_radio()
    core.on_dropped("0", 2**62)
    assert core.refused == {Refused.MALFORMED: 1}
    assert core.settle().gaps == []
    core.on_dropped("0", 4)
    assert [gap.packets for gap in core.settle().gaps] == [5]


def test_books_balance_when_the_run_ends_with_packets_that_wait() -> None:
    core = virtual_radio()
    place(core, 0, n0=0.0, n1=1.0)
    send(core, "0", sim_time_ns=10 * TICK_NS)
    assert len(fates(core, core.finish())) == 1


def test_packets_of_a_tick_are_settled_in_one_order_whoever_was_first() -> None:
    orders = []
    for senders in (("0", "1", "2"), ("2", "0", "1")):
        core = virtual_radio(nodes=("0", "1", "2"))
        place(core, 0, n0=0.0, n1=1.0, n2=2.0)
        for tx in senders:
            send(core, tx)
        orders.append(fates(core, core.settle()))
        assert fates(core, core.settle()) == []
    assert orders[0] == orders[1]
    assert len(orders[0]) == 6


def test_a_radio_that_an_operator_switches_is_off_from_that_tick_on() -> None:
    core = virtual_radio(nodes=("0", "1", "2"))
    for tick, on in enumerate((None, False, None, True)):
        place(core, tick * TICK_NS, n0=0.0, n1=1.0, n2=2.0)
        if on is not None:
            core.on_switch("1", tick * TICK_NS, on=on)
        send(core, "0", tick, tick * TICK_NS)
        send(core, "1", tick, tick * TICK_NS)
    assert [node for node, off in zip(core.nodes, core.radios_off(2 * TICK_NS), strict=True) if off] == ["1"]
    found = fates(core, core.settle())
    lost = [(tx, rx, seq) for tx, rx, seq, fate in found if fate == "radio_off"]
    assert lost == [(tx, rx, tick) for tick in (1, 2) for tx, rx in (("0", "1"), ("1", "0"), ("1", "2"))]
    assert {fate for *_, fate in found if fate != "radio_off"} == {"delivered"}
    assert core.airs[0].ledger.account("1", "2").lost == {"radio_off": 2}
    core.finish()


def test_what_is_too_long_for_a_radio_is_so_while_it_is_off() -> None:
    core = virtual_radio()
    place(core, 0, n0=0.0, n1=1.0)
    core.on_switch("0", 0, on=False)
    send(core, "0", payload=bytes(MTU_BYTES + 1))
    core.finish()
    assert core.airs[0].ledger.account("0", "1").lost == {"too_long": 1}


def test_a_switch_of_nobody_or_of_another_time_is_refused() -> None:
    core = virtual_radio()
    core.on_switch("9", 0, on=False)
    core.on_switch("0", 1 << 62, on=False)
    assert core.refused == {Refused.UNKNOWN_NODE: 1, Refused.MALFORMED: 1}
    assert not core.radios_off(1 << 62).any()
