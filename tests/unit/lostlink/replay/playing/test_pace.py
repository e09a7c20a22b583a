"""When ticks are due by wall time."""

from __future__ import annotations

import math

import pytest

from lostlink.replay.playing.pace import Pace

S = 1_000_000_000


def test_ticks_are_due_as_fast_as_asked_for() -> None:
    pace = Pace(4.0, 10 * S, 100.0)
    assert pace.due_s(10 * S) == 100.0
    assert pace.due_s(14 * S) == 101.0
    assert Pace(math.inf, 0, 5.0).due_s(600 * S) == 5.0


def test_nothing_is_due_while_paused_and_what_was_missed_is_not_made_up_for() -> None:
    pace = Pace(1.0, 0, 0.0)
    pace.played(2 * S, 2.0)
    pace.pause()
    assert pace.due_s(3 * S) == math.inf
    assert pace.real_time_factor == 0.0
    pace.resume(50.0)
    assert pace.due_s(3 * S) == 51.0


def test_another_speed_goes_on_from_here() -> None:
    pace = Pace(1.0, 0, 0.0)
    pace.played(2 * S, 2.0)
    pace.set_speed(10.0, 2.5)
    assert pace.due_s(3 * S) == pytest.approx(2.6)
    pace.move(100 * S, 3.0)
    assert pace.due_s(100 * S) == 3.0


def test_a_player_that_cannot_keep_up_does_not_hurry_later() -> None:
    pace = Pace(10.0, 0, 0.0)
    pace.played(1 * S, 5.0)  # due at 0.1
    assert pace.due_s(2 * S) == pytest.approx(5.1)


def test_a_tick_that_is_a_little_late_delays_no_other() -> None:
    pace = Pace(1.0, 0, 0.0)
    pace.played(1 * S, 1.4)
    assert pace.due_s(2 * S) == 2.0


def test_how_fast_it_is_is_measured() -> None:
    pace = Pace(8.0, 0, 0.0)
    for tick in range(1, 40):
        pace.played(tick * S // 20, tick / 100.0 + 0.01)
    assert math.isnan(pace.real_time_factor)
    for tick in range(40, 200):
        pace.played(tick * S // 20, tick / 100.0)
    assert pace.real_time_factor == pytest.approx(5.0, rel=0.02)


def test_begins_paused_if_asked_to() -> None:
    pace = Pace(1.0, 0, 0.0, paused=True)
    assert pace.paused
    assert pace.due_s(0) == math.inf
