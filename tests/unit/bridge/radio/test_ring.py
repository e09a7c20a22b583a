"""The ring closes an instant when every regulated node has answered it, and only then."""

from __future__ import annotations

import pytest

from bridge.radio.ring import Closed, Ring

TICK_NS = 50_000_000


def ring(**more: object) -> Ring:
    return Ring(("0", "1"), tick_period_ns=TICK_NS, **more)  # type: ignore[arg-type]


def test_a_tick_closes_with_the_last_answer() -> None:
    it = ring()
    it.tick(0)
    assert it.answer("1", 0) is None
    assert it.waiting_for == ("0",)
    assert it.answer("0", 0) == Closed(0, is_tick=True, is_end=False)


def test_an_answer_said_twice_counts_once() -> None:
    it = ring()
    assert it.answer("1", 0) is None
    assert it.answer("1", 0) is None
    assert it.answer("0", 0) is not None
    assert it.answer("0", 0) is None
    assert it.answer("0", TICK_NS) is None


def test_an_instant_between_ticks_closes_without_being_one() -> None:
    it = ring()
    it.answer("0", 0)
    it.answer("1", 0)
    it.answer("0", TICK_NS // 5)
    assert it.answer("1", TICK_NS // 5) == Closed(TICK_NS // 5, is_tick=False, is_end=False)


def test_a_node_that_is_ahead_closes_nothing_by_itself() -> None:
    it = ring()
    it.answer("0", 0)
    it.answer("0", TICK_NS)
    assert it.answer("1", 0) == Closed(0, is_tick=True, is_end=False)
    assert it.answer("1", TICK_NS) == Closed(TICK_NS, is_tick=True, is_end=False)


def test_nobody_waits_for_a_stranger() -> None:
    with pytest.raises(KeyError):
        ring().answer("gcs", 0)


def closed(it: Ring, sim_time_ns: int) -> Closed | None:
    it.answer("0", sim_time_ns)
    return it.answer("1", sim_time_ns)


def test_the_run_ends_at_its_last_tick() -> None:
    it = ring(end_ns=2 * TICK_NS)
    ends = [closed(it, n * TICK_NS) for n in range(3)]
    assert [each.is_end for each in ends if each is not None] == [False, False, True]


def test_the_run_ends_when_all_tasks_are_done_but_not_at_an_exchange() -> None:
    it = ring(tasks=("0",))
    closed(it, 0)
    it.done("1")
    assert closed(it, TICK_NS) == Closed(TICK_NS, is_tick=True, is_end=False)
    it.done("0")
    assert closed(it, TICK_NS + TICK_NS // 2) == Closed(TICK_NS + TICK_NS // 2, is_tick=False, is_end=False)
    assert closed(it, 2 * TICK_NS) == Closed(2 * TICK_NS, is_tick=True, is_end=True)
