"""The radio router's core: what it forwards, books, refuses and releases."""

from __future__ import annotations

from typing import Any

import pytest

from bridge.bus.keys import Keys
from bridge.bus.messages import CommunicationStatus, Header, Link
from bridge.bus.session import Stamp
from bridge.radio.virtual_radio import TRANSPORT, Action, Forward, Publish, Refused, VirtualRadio
from channel.link.radio import Radio
from channel.medium.medium import Medium
from channel.presets import load_radio

KEYS = Keys("r")
TICK_NS = 50_000_000
LEVEL = (1.0, 0.0, 0.0, 0.0)


def by_agent(seq: int, sim_time_ns: int) -> Stamp:
    return Stamp(seq, sim_time_ns)


def router(preset: str = "perfect", nodes: tuple[str, ...] = ("0", "1"), **more: Any) -> VirtualRadio:
    medium = Medium(Radio(load_radio(preset)), seed=1, nodes=nodes)
    return VirtualRadio(KEYS, medium, nodes, **more)


def place(core: VirtualRadio, sim_time_ns: int, **north_m: float) -> list[Action]:
    actions: list[Action] = []
    for node, north in north_m.items():
        actions += core.on_truth(node.removeprefix("n"), sim_time_ns, (north, 0.0, -40.0), LEVEL)
    return actions


def send(
    core: VirtualRadio, tx: str, payload: bytes, encoding: object = None, stamp: Stamp | None = None
) -> list[Action]:
    """Give a packet to the core and have it settled."""
    core.on_packet(tx, "team", payload, encoding, stamp)
    return core.settle()


def forwards(actions: list[Action]) -> list[Forward]:
    return [action for action in actions if isinstance(action, Forward)]


def published(actions: list[Action], kind: type) -> list[Publish]:
    return [a for a in actions if isinstance(a, Publish) and isinstance(a.message, kind)]


def test_packet_goes_on_with_its_bytes_stamp_and_encoding() -> None:
    core = router()
    place(core, 0, n0=0.0, n1=100.0)
    (forward,) = forwards(send(core, "0", b"\x00payload", "text/plain", by_agent(0, 0)))
    assert forward.key == "lostlink/r/node/1/rx/0/team"
    assert (forward.packet.payload, forward.packet.encoding) == (b"\x00payload", "text/plain")
    assert len(forward.attachment) == 33


def test_packet_waits_for_the_truth_of_its_instant() -> None:
    core = router()
    place(core, 0, n0=0.0, n1=100.0)
    assert not forwards(send(core, "0", b"x", None, by_agent(0, TICK_NS)))
    assert not forwards(place(core, TICK_NS, n0=0.0))
    assert not forwards(place(core, TICK_NS, n1=100.0))  # not beside the clock: with the tick
    core.on_answer("0", TICK_NS)
    assert forwards(core.on_answer("1", TICK_NS))


def test_out_of_range_is_lost_and_booked() -> None:
    core = router("disk")
    place(core, 0, n0=0.0, n1=1e6)
    assert not forwards(send(core, "0", b"x", None, by_agent(0, 0)))
    (row,) = core.settled
    assert (row.tx, row.rx, row.fate) == ("0", "1", "out_of_range")
    assert core.ledger.links["0", "1"].lost == {"out_of_range": 1}


def test_missing_numbers_are_the_hosts_losses() -> None:
    core = router(nodes=("0", "1", "2"))
    place(core, 0, n0=0.0, n1=1.0, n2=2.0)
    send(core, "0", b"x", None, by_agent(3, 0))
    assert core.ledger.links["0", "1"].lost == {TRANSPORT: 3}
    assert core.ledger.links["0", "2"].sent == 4
    core.on_sent_total("0", 6)
    assert core.ledger.links["0", "1"].lost == {TRANSPORT: 5}
    core.on_sent_total("0", 6)
    assert core.ledger.links["0", "1"].sent == 6
    core.finish()


@pytest.mark.parametrize(
    ("tx", "stamp", "payload", "reason"),
    [
        ("9", by_agent(0, 0), b"x", Refused.UNKNOWN_NODE),
        ("0", by_agent(0, 0), b"x", Refused.REPEATED),
        ("0", by_agent(-5, 0), b"x", Refused.REPEATED),
        ("0", by_agent(2**62, 0), b"x", Refused.MALFORMED),
        ("0", by_agent(1, 2**62), b"x", Refused.MALFORMED),
        ("0", by_agent(1, -1), b"x", Refused.MALFORMED),
    ],
)
def test_what_is_refused_is_counted_by_reason(tx: str, stamp: Stamp, payload: bytes, reason: Refused) -> None:
    core = router()
    place(core, 0, n0=0.0, n1=1.0)
    send(core, "0", b"x", None, by_agent(0, 0))
    rows = len(core.settled)
    assert send(core, tx, payload, None, stamp) == []
    assert core.refused == {reason: 1}
    assert len(core.settled) == rows


def test_clock_is_released_when_all_have_answered() -> None:
    core = router()
    place(core, 0, n0=0.0, n1=1.0)
    assert core.on_answer("0", 0) == []
    (release,) = [a for a in core.on_answer("1", 0) if isinstance(a, Publish) and a.key == KEYS.clock_release]
    assert release == Publish(KEYS.clock_release, Header.at(0, ""), must_arrive=True)
    assert core.on_answer("1", 0) == []
    assert core.on_answer("9", 0) == []
    assert core.refused == {Refused.UNKNOWN_NODE: 1}


def test_release_comes_after_what_the_tick_delivered() -> None:
    core = router()
    place(core, 0, n0=0.0, n1=1.0)
    core.on_packet("0", "team", b"x", None, by_agent(0, 0))
    core.on_answer("0", 0)
    actions = core.on_answer("1", 0)
    (status,) = published(actions, CommunicationStatus)
    assert status.message == CommunicationStatus(status.message.header, ("0",), (True,))  # type: ignore[attr-defined]
    (link,) = published(actions, Link)
    assert (link.message.sent, link.message.delivered) == (1, 1)  # type: ignore[attr-defined]
    order = keys_of(actions)
    release = order.index(KEYS.clock_release)
    assert {order.index(KEYS.rx("1", "0", "team")), order.index(KEYS.comm_status("1"))} <= set(range(release))
    assert order.index(KEYS.link("0", "1")) > release  # observers can wait


def keys_of(actions: list[Action]) -> list[str]:
    return [action.key for action in actions]


def test_run_ends_with_the_tick_in_which_the_last_task_is_done() -> None:
    core = router(tasks=["1"])
    place(core, 0, n0=0.0, n1=1.0)
    core.on_answer("0", 0)
    assert KEYS.clock_release in keys_of(core.on_answer("1", 0))
    core.on_done("0")
    core.on_done("1")
    core.on_answer("0", TICK_NS)
    ending = keys_of(core.on_answer("1", TICK_NS))
    assert KEYS.clock_end in ending
    assert KEYS.clock_release not in ending


def test_run_ends_with_the_tick_of_its_duration() -> None:
    core = router(end_ns=TICK_NS)
    for tick, key in ((0, KEYS.clock_release), (TICK_NS, KEYS.clock_end)):
        core.on_answer("0", tick)
        assert key in keys_of(core.on_answer("1", tick))


def test_who_has_not_answered_is_known_by_name() -> None:
    core = router()
    core.on_tick(TICK_NS)
    assert core.waiting_for == ("0", "1")
    core.on_answer("0", TICK_NS)
    assert core.waiting_for == ("1",)


@pytest.mark.parametrize("sim_time_ns", [-1, 2**62])
def test_answer_of_an_impossible_time_releases_nothing(sim_time_ns: int) -> None:
    core = router()
    place(core, 0, n0=0.0, n1=1.0)
    assert core.on_answer("0", sim_time_ns) == core.on_answer("1", sim_time_ns) == []
    assert core.refused == {Refused.MALFORMED: 2}


def test_packet_that_is_too_long_is_booked_as_such() -> None:
    core = router()
    place(core, 0, n0=0.0, n1=1.0)
    send(core, "0", bytes((1 << 20) + 1), None, by_agent(0, 0))
    send(core, "0", b"x", None, by_agent(1, 0))
    assert [row.fate for row in core.settled] == ["too_long", "delivered"]
    assert core.ledger.links["0", "1"].lost == {"too_long": 1}
    core.finish()


def test_packet_without_a_stamp_is_refused_and_harms_nothing() -> None:
    core = router()
    place(core, 0, n0=0.0, n1=1.0)
    assert send(core, "0", b"x", None, None) == []
    assert core.refused == {Refused.MALFORMED: 1}
    assert forwards(send(core, "0", b"x", None, by_agent(0, 0)))
    assert core.settled[0].seq == 0


def test_what_a_packet_says_of_its_source_is_not_looked_at() -> None:
    core = router()
    place(core, 0, n0=0.0, n1=1.0)
    (forward,) = forwards(send(core, "0", b"x", None, Stamp(0, 0, b"1")))
    assert forward.key == "lostlink/r/node/1/rx/0/team"
    stamp = forward.attachment[17:].rstrip(b"\0")
    assert stamp == b"0"


@pytest.mark.parametrize("sim_time_ns", [-1, 2**62])
def test_truth_and_ticks_of_an_impossible_time_are_refused(sim_time_ns: int) -> None:
    core = router()
    place(core, 0, n0=0.0, n1=1.0)
    assert place(core, sim_time_ns, n0=0.0) == []
    core.on_tick(sim_time_ns)
    assert core.refused == {Refused.MALFORMED: 2}
    send(core, "0", b"x", None, by_agent(0, 2**61))
    assert core.refused == {Refused.MALFORMED: 3}
    core.on_tick(TICK_NS)
    assert core.waiting_for == ("0", "1")


@pytest.mark.parametrize("sent", [-1, 2**62])
def test_impossible_count_of_an_agent_books_nothing(sent: int) -> None:
    core = router()
    core.on_sent_total("0", sent)
    assert core.refused == {Refused.MALFORMED: 1}
    assert core.settled == []


def test_books_balance_when_the_run_ends_with_packets_that_wait() -> None:
    core = router()
    place(core, 0, n0=0.0, n1=1.0)
    send(core, "0", b"x", None, by_agent(0, 10 * TICK_NS))
    core.finish()
    account = core.ledger.links["0", "1"]
    assert (account.sent, account.in_flight) == (1, 0)


def test_packets_of_a_tick_are_settled_in_one_order_whoever_was_first() -> None:
    orders = []
    for senders in (("0", "1", "2"), ("2", "0", "1")):
        core = router(nodes=("0", "1", "2"))
        place(core, 0, n0=0.0, n1=1.0, n2=2.0)
        for tx in senders:
            core.on_packet(tx, "team", b"x", None, by_agent(0, 0))
        orders.append(keys_of(core.settle()))
        assert core.settle() == []
    assert orders[0] == orders[1]
    assert len(orders[0]) == 6
