from types import SimpleNamespace

import pytest

from fdm.clock.events import EventKind, UaEvent
from fdm.clock.fleet_ticks import FleetTicks

MS = 1_000_000
BUSY = (False, False)


def truth(ua_id):
    return SimpleNamespace(ua_id=ua_id)


def ids(due):
    return due and (due[0], [truth.ua_id for truth in due[1]])


def test_a_tick_is_due_when_every_process_has_reached_it():
    ticks = FleetTicks([[0, 2], [1]], 50 * MS)
    assert ticks.take_due(BUSY) is None
    ticks.reached(0, 0, [truth(0), truth(2)])
    assert ticks.take_due(BUSY) is None
    ticks.reached(1, 0, [truth(1)])
    assert ids(ticks.take_due(BUSY)) == (0, [0, 1, 2])
    assert ticks.take_due(BUSY) is None
    ticks.reached(1, 50 * MS, [truth(1)])
    ticks.reached(0, 50 * MS, [truth(0), truth(2)])
    assert ids(ticks.take_due(BUSY)) == (50 * MS, [0, 1, 2])


def test_nobody_waits_for_a_process_without_live_ua_and_late_reports_are_dropped():
    ticks = FleetTicks([[0], [1]], 50 * MS)
    assert ticks.take_due((True, True)) is None
    ticks.happened(UaEvent(EventKind.ABSENT, 1, 0))
    ticks.reached(0, 0, [truth(0)])
    assert ids(ticks.take_due((False, True))) == (0, [0])
    ticks.happened(UaEvent(EventKind.JOINED, 1, 0))
    ticks.reached(1, 0, [truth(1)])
    ticks.reached(0, 50 * MS, [truth(0)])
    assert ticks.take_due(BUSY) is None
    ticks.reached(1, 50 * MS, [truth(1)])
    assert ids(ticks.take_due(BUSY)) == (50 * MS, [0, 1])


def test_a_tick_without_a_stalled_ua_waits_for_the_word_that_it_stalled():
    ticks = FleetTicks([[0], [1]], 50 * MS)
    ticks.reached(0, 0, [truth(0)])
    assert ticks.take_due((False, True)) is None  # the shared memory shows it before its event comes
    ticks.happened(UaEvent(EventKind.STALLED, 1, 0))
    assert ids(ticks.take_due((False, True))) == (0, [0])
    assert ticks.status(0, 0, 1.0, paused=False).stalled_ua == (1,)


def test_a_process_that_is_a_tick_ahead_keeps_its_truth_for_then():
    ticks = FleetTicks([[0], [1]], 50 * MS)
    ticks.reached(1, 50 * MS, [truth(1)])  # all its UA joined there
    ticks.reached(0, 0, [truth(0)])
    assert ids(ticks.take_due(BUSY)) == (0, [0])
    ticks.reached(0, 50 * MS, [truth(0)])
    assert ids(ticks.take_due(BUSY)) == (50 * MS, [0, 1])


def test_the_status_follows_the_events():
    ticks = FleetTicks([[3, 1], [2]], 50 * MS)
    for kind, ua_id in [
        (EventKind.JOINED, 1),
        (EventKind.JOINED, 2),
        (EventKind.ABSENT, 3),
        (EventKind.STALLED, 1),
        (EventKind.RESTARTED, 2),
        (EventKind.DIVERGED, 2),
    ]:
        ticks.happened(UaEvent(kind, ua_id, 0))
    status = ticks.status(0, 7, 2.0, paused=True)
    assert (status.stalled_ua, status.ended_ua) == ((1, 3), (2,))
    assert dict(status.restarts) == {1: 0, 2: 1, 3: 0}
    assert (status.speed, status.paused, status.sim_time_ns) == (2.0, True, 0)
    ticks.happened(UaEvent(EventKind.RETURNED, 1, 0))
    ticks.happened(UaEvent(EventKind.RESTARTED, 2, 0))
    status = ticks.status(50 * MS, 7 + 25 * MS, 2.0, paused=False)
    assert (status.stalled_ua, status.ended_ua, status.restarts[2]) == ((3,), (), 2)
    assert status.real_time_factor == 2.0


@pytest.mark.parametrize("kind", [EventKind.SILENT, EventKind.REFUSED, EventKind.REPLACED])
@pytest.mark.parametrize("before", [EventKind.JOINED, EventKind.STALLED])
def test_what_a_ua_is_served_on_in_spite_of_does_not_change_the_status(kind, before):
    ticks = FleetTicks([[0]], 50 * MS)
    ticks.happened(UaEvent(before, 0, 0))
    status = ticks.status(0, 0, 1.0, paused=False)
    ticks.happened(UaEvent(kind, 0, 0))
    assert ticks.status(0, 0, 1.0, paused=False).stalled_ua == status.stalled_ua
