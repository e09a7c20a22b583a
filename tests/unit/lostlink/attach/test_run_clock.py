"""Wall time of instants, and a word when a run does not keep up."""

from __future__ import annotations

from math import inf

import pytest

from lostlink.attach.run_clock import RunClock

S = 1_000_000_000


@pytest.mark.parametrize(("speed", "wait_s"), [(1.0, 0.5), (4.0, 0.125), (inf, 0.0)])
def test_an_instant_is_as_far_from_the_tick_as_the_speed_says(speed: float, wait_s: float) -> None:
    clock = RunClock()
    clock.came(10 * S, 100.0, speed)
    assert clock.wall_s(10 * S + S // 2) == 100.0 + wait_s
    assert clock.wall_s(9 * S) == clock.wall_s(-1) == 100.0


def test_before_the_first_tick_everything_is_due() -> None:
    assert RunClock().wall_s(5 * S) == -inf


@pytest.mark.parametrize(
    ("speed", "took_s", "said"),
    [
        (1.0, 10.0, ""),
        (1.0, 10.09, ""),
        (1.0, 10.19, ""),
        (1.0, 10.21, "warning: the run went at 0.98 times the speed that was asked for: "),
        (1.0, 16.0, "warning: the run went at 0.62 times the speed that was asked for: "),
        (4.0, 2.5, ""),
        (4.0, 5.0, "warning: the run went at 0.50 times the speed that was asked for: "),
        (inf, 99.0, ""),
    ],
)
def test_a_run_that_does_not_keep_up_is_told_of(speed: float, took_s: float, said: str) -> None:
    clock = RunClock()
    assert clock.warning == ""
    clock.came(5 * S, 50.0, speed)
    assert clock.warning == ""
    clock.came(15 * S, 50.0 + took_s, speed)
    assert clock.warning.startswith(said)
    assert bool(clock.warning) == bool(said)


def test_a_change_of_speed_is_no_slow_run_and_hides_none() -> None:
    clock = RunClock()
    clock.came(0, 0.0, 1.0)
    clock.came(100 * S, 100.0, 1.0)
    clock.operator_did(is_held=False)
    clock.came(101 * S, 100.5, 10.0)
    clock.came(201 * S, 110.5, 10.0)
    assert clock.warning == ""
    clock.came(301 * S, 130.5, 10.0)  # 100 s in 20 s: half as fast as asked, so that 120 s took 130
    assert clock.warning.startswith("warning: the run went at 0.92 times the speed")


def test_time_that_an_operator_held_does_not_count() -> None:
    clock = RunClock()
    clock.came(0, 0.0, 1.0)
    clock.came(10 * S, 10.0, 1.0)
    clock.operator_did(is_held=True)
    clock.came(11 * S, 11.0, 1.0)  # was on its way
    clock.operator_did(is_held=True)
    clock.came(12 * S, 500.0, 1.0)  # a step
    clock.operator_did(is_held=False)
    clock.came(13 * S, 900.0, 1.0)
    clock.came(23 * S, 910.0, 1.0)
    assert clock.warning == ""
    clock.came(24 * S, 930.0, 1.0)  # 21 s took 40
    assert clock.warning.startswith("warning: the run went at 0.53 times the speed")
