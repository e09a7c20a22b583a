from math import inf

import pytest

from fdm.clock.pace import MAX_LAG_NS, NEVER_NS, FleetPace

MS = 1_000_000


def test_the_limit_keeps_the_speed_from_where_it_was_restarted():
    pace = FleetPace(2.0)
    pace.restart(10 * MS, 500 * MS)
    assert pace.limit_ns == 10 * MS
    assert pace.move(10 * MS, 504 * MS)
    assert pace.limit_ns == 18 * MS
    assert not pace.move(10 * MS, 504 * MS)
    pace.move(10 * MS, pace.allows_at_ns(20 * MS) - 2)
    assert pace.limit_ns < 20 * MS
    pace.move(10 * MS, pace.allows_at_ns(20 * MS))
    assert pace.limit_ns >= 20 * MS


def test_a_late_fleet_makes_up_for_no_more_than_the_lag():
    pace = FleetPace(0.5)
    pace.restart(0, 0)
    pace.move(MS, 60_000 * MS)
    assert pace.limit_ns == MS + MAX_LAG_NS // 2
    pace.move(MS, 60_002 * MS)
    assert pace.limit_ns == MS + MAX_LAG_NS // 2
    pace.move(MS + MAX_LAG_NS // 2, 60_004 * MS)
    assert pace.limit_ns == 2 * MS + MAX_LAG_NS // 2


def test_as_fast_as_possible_has_no_limit_and_no_need_to_move():
    pace = FleetPace(inf)
    assert (pace.limit_ns, pace.moves) == (NEVER_NS, False)
    pace.set_speed(1.0)
    pace.restart(MS, MS)
    assert (pace.limit_ns, pace.moves) == (MS, True)


def test_a_pause_holds_through_a_change_of_speed():
    pace = FleetPace(1.0)
    pace.pause(7 * MS)
    pace.step(2 * MS)
    pace.set_speed(inf)
    pace.restart(7 * MS, 100 * MS)
    assert (pace.limit_ns, pace.moves, pace.paused) == (9 * MS, False, True)
    pace.resume(9 * MS, 200 * MS)
    assert (pace.limit_ns, pace.moves, pace.paused) == (NEVER_NS, False, False)


def test_a_step_does_nothing_without_a_pause_and_is_above_0():
    pace = FleetPace(1.0)
    pace.step(5 * MS)
    assert pace.limit_ns == 0
    with pytest.raises(ValueError, match="step of 0 ns: must be above 0"):
        pace.step(0)
