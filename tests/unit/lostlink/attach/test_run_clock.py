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
        (1.0, 16.0, "warning: the run went at 0.62 times real time, and 1 was asked for: "),
        (4.0, 2.5, ""),
        (4.0, 5.0, "warning: the run went at 2.00 times real time, and 4 was asked for: "),
        (inf, 99.0, ""),
    ],
)
def test_a_run_that_does_not_keep_up_is_told_of(speed: float, took_s: float, said: str) -> None:
    clock = RunClock()
    assert clock.warning == ""
    clock.came(5 * S, 50.0, speed)
    assert (clock.factor, clock.warning) == (None, "")
    clock.came(15 * S, 50.0 + took_s, speed)
    assert clock.factor == pytest.approx(10.0 / took_s)
    assert clock.warning.startswith(said)
    assert bool(clock.warning) == bool(said)
