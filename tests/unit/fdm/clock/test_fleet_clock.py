from math import inf

import pytest

from fdm.clock.fleet_clock import MAX_GAP_NS, FleetClock
from fdm.clock.pace import NEVER_NS
from fdm.clock.status import ClockSettings

MS = 1_000_000
SECOND = 1_000_000_000


class Fleet:
    """Plays UA against a clock, by function call and with wall time as a number."""

    def __init__(self, steps_ns, joined=True, **settings):
        self.clock = FleetClock(steps_ns, ClockSettings(**{"speed": inf, **settings}), 0)
        self.steps_ns = steps_ns
        self.wall_ns = 0
        self.ticks = []
        self.mute = set()
        if joined:
            for ua_id in steps_ns:
                self.join(ua_id)

    def __getitem__(self, ua_id):
        return self.clock.members[ua_id]

    def join(self, ua_id):
        self.clock.join(self[ua_id])
        self.ask(ua_id)

    def ask(self, ua_id):
        if ua_id not in self.mute:
            self.clock.ask(self[ua_id], self[ua_id].sim_time_ns + self.steps_ns[ua_id])

    def emit(self):
        while (tick_ns := self.clock.due_tick_ns()) is not None:
            self.ticks.append((tick_ns, {m.ua_id: m.sim_time_ns for m in self.clock.live_members()}))
            self.clock.tick_emitted()

    def turn(self, wall_step_ns=MS):
        """One turn of the loop: every UA that may step does; gives who did."""
        self.wall_ns += wall_step_ns
        self.clock.update(self.wall_ns)
        self.emit()
        moved = []
        for ua_id, member in self.clock.members.items():
            if member.waiting and self.clock.may_step(member):
                self.clock.stepped(member)
                self.ask(ua_id)
                moved.append(ua_id)
        self.emit()
        return moved

    def times(self):
        return {ua_id: member.sim_time_ns for ua_id, member in self.clock.members.items()}


def test_nobody_steps_before_all_have_joined():
    fleet = Fleet({0: MS, 1: MS}, joined=False)
    fleet.join(0)
    assert fleet.turn() == []
    assert fleet.ticks == []
    fleet.join(1)
    assert fleet.turn() == [0, 1]
    assert fleet.ticks == [(0, {0: 0, 1: 0})]


def test_after_the_start_timeout_the_missing_count_as_stalled():
    fleet = Fleet({0: MS, 1: MS}, joined=False, start_timeout_ns=5 * MS)
    fleet.join(0)
    for _ in range(4):
        assert fleet.turn() == []
        assert fleet.clock.take_absent() == []
    assert fleet.turn() == []
    assert fleet.clock.take_absent() == [fleet[1]]
    assert fleet.clock.take_absent() == []
    assert fleet.turn() == [0]
    assert fleet.clock.status(0, {}).stalled_ua == (1,)


def test_the_start_timeout_counts_from_the_beginning_and_not_from_construction():
    fleet = Fleet({0: MS, 1: MS}, joined=False, start_timeout_ns=5 * MS)
    fleet.wall_ns = 60 * SECOND
    fleet.clock.begin(fleet.wall_ns)
    assert fleet.clock.wake_at_ns() == fleet.wall_ns + 5 * MS
    fleet.join(0)
    for _ in range(4):
        assert fleet.turn() == []
        assert fleet.clock.take_absent() == []
    fleet.join(1)
    assert fleet.turn() == [0, 1]
    assert fleet.clock.take_absent() == []
    assert fleet.ticks == [(0, {0: 0, 1: 0})]


def test_whose_packet_is_heard_when_the_start_timeout_passes_is_not_absent():
    fleet = Fleet({0: MS, 1: MS, 2: MS}, joined=False, start_timeout_ns=5 * MS)
    fleet.turn(5 * MS)
    fleet.join(2)
    assert fleet.clock.take_absent() == [fleet[0], fleet[1]]
    assert fleet[2].sim_time_ns == 0
    assert fleet.turn() == [2]
    assert fleet.ticks == [(0, {2: 0})]


def test_getting_ready_counts_towards_no_pace_and_no_stall():
    fleet = Fleet({0: MS, 1: MS}, joined=False, start_together=False, speed=1.0)
    fleet.wall_ns = 60 * SECOND
    fleet.clock.begin(fleet.wall_ns)
    fleet.join(0)
    assert fleet.turn(0) == []
    assert fleet.clock.take_stalled() == []
    assert fleet.turn() == [0]
    assert fleet.turn(0) == []
    assert fleet.clock.status(MS, {}).real_time_factor == 1.0


def test_without_start_together_the_first_goes_on_alone():
    fleet = Fleet({0: MS, 1: MS}, joined=False, start_together=False)
    fleet.join(0)
    assert fleet.turn() == [0]


@pytest.mark.parametrize(("window_ns", "allowed_ns"), [(None, 3 * MS), (10 * MS, 10 * MS), (MS, 3 * MS)])
def test_nobody_is_further_ahead_than_the_window(window_ns, allowed_ns):
    fleet = Fleet({0: MS, 1: 3 * MS, 2: 2 * MS}, window_ns=window_ns, tick_period_ns=SECOND)
    furthest = 0
    for _ in range(300):
        assert fleet.turn()
        times = fleet.times().values()
        furthest = max(furthest, max(times) - min(times))
    assert furthest <= allowed_ns
    assert furthest > allowed_ns // 2
    assert min(fleet.times().values()) > 100 * MS


def test_ticks_come_at_their_instants_after_every_ua_reached_them():
    fleet = Fleet({0: 833_333, 1: 2_500_000}, tick_period_ns=50 * MS)
    while len(fleet.ticks) < 5:
        assert fleet.turn()
    for number, (tick_ns, times) in enumerate(fleet.ticks):
        assert tick_ns == number * 50 * MS
        for ua_id, time_ns in times.items():
            assert tick_ns <= time_ns < tick_ns + fleet.steps_ns[ua_id]


def test_held_ticks_hold_until_they_are_released():
    fleet = Fleet({0: 10 * MS, 1: 10 * MS}, tick_period_ns=20 * MS, hold_ticks=True)
    assert fleet.turn() == []
    fleet.clock.release(0)
    for _ in range(10):
        fleet.turn()
    assert fleet.times() == {0: 20 * MS, 1: 20 * MS}
    fleet.clock.release(0)
    assert fleet.turn() == []
    fleet.clock.release(60 * MS)
    for _ in range(10):
        fleet.turn()
    assert fleet.times() == {0: 80 * MS, 1: 80 * MS}


def test_a_tick_waits_until_every_ua_is_quiet_there():
    fleet = Fleet({0: 10 * MS, 1: 10 * MS}, tick_period_ns=20 * MS, joined=False)
    fleet.clock.join(fleet[0])
    fleet.clock.join(fleet[1])
    fleet.ask(0)
    fleet.clock.ask(fleet[1], 10 * MS, quiet=False)
    assert fleet.turn() == []
    assert fleet.ticks == []
    seen = fleet.clock.limits_version
    fleet.clock.ask(fleet[1], 10 * MS)
    assert fleet.clock.limits_version != seen
    assert fleet.turn() == [0, 1]
    fleet.mute.add(1)
    fleet.turn()
    assert fleet.times() == {0: 20 * MS, 1: 20 * MS}
    fleet.turn()
    assert [tick_ns for tick_ns, _ in fleet.ticks] == [0]  # all are at 20 ms, but UA 1 has not asked for more
    fleet.mute.clear()
    fleet.ask(1)
    fleet.turn()
    assert [tick_ns for tick_ns, _ in fleet.ticks] == [0, 20 * MS]


@pytest.mark.parametrize("asked", [False, True])
def test_who_is_not_quiet_at_a_tick_owes_a_packet_and_stalls(asked):
    fleet = Fleet({0: 10 * MS, 1: 10 * MS}, tick_period_ns=20 * MS, stall_timeout_ns=500 * MS)
    fleet.turn()
    fleet.mute.add(1)
    fleet.turn()
    if asked:
        fleet.clock.ask(fleet[1], 30 * MS, quiet=False)
    stall(fleet, 1)
    assert [tick_ns for tick_ns, _ in fleet.ticks] == [0]
    assert fleet.turn() == [0]
    assert fleet.ticks[-1] == (20 * MS, {0: 20 * MS})


def test_who_is_held_at_a_tick_never_stalls():
    fleet = Fleet({0: 10 * MS, 1: 10 * MS}, tick_period_ns=20 * MS, hold_ticks=True, stall_timeout_ns=MS)
    for _ in range(1000):
        assert fleet.turn(10 * MS) == []
        assert fleet.clock.take_stalled() == []


def test_no_tick_comes_while_the_one_before_is_held():
    fleet = Fleet({0: MS}, tick_period_ns=50 * MS, hold_ticks=True)
    fleet.turn()
    fleet.join(0)  # it boots anew, and waits at the next tick
    assert fleet[0].sim_time_ns == 50 * MS
    fleet.turn()
    assert [tick_ns for tick_ns, _ in fleet.ticks] == [0]
    fleet.clock.release(0)
    fleet.turn()
    assert [tick_ns for tick_ns, _ in fleet.ticks] == [0, 50 * MS]


def test_a_time_in_which_nobody_is_heard_counts_towards_no_stall():
    fleet = Fleet({0: MS, 1: MS}, stall_timeout_ns=100 * MS)
    fleet.mute.add(1)
    fleet.turn()
    for _ in range(50):
        fleet.wall_ns += 150 * MS
        fleet.clock.update_deaf(fleet.wall_ns)
        assert fleet.clock.take_stalled() == []
    stall(fleet, 1)


@pytest.mark.parametrize("speed", [0.1, 1.0, 7.5])
def test_sim_time_keeps_the_pace(speed):
    fleet = Fleet({0: MS, 1: MS}, speed=speed)
    for _ in range(8000):
        fleet.turn(MS // 4)
        while fleet.turn(0):
            pass
    assert min(fleet.times().values()) == pytest.approx(2 * SECOND * speed, abs=MS * max(speed, 1) + MS)


def test_a_late_fleet_makes_up_only_a_little():
    fleet = Fleet({0: MS}, speed=1.0)
    for _ in range(100):
        fleet.turn()
    fleet.turn(10 * SECOND)
    for _ in range(3000):
        fleet.turn(1)
    assert fleet[0].sim_time_ns <= 100 * MS + 110 * MS


def test_pause_step_resume():
    fleet = Fleet({0: MS, 1: MS})
    for _ in range(20):
        fleet.turn()
    fleet.clock.pause()
    held_ns = fleet[0].sim_time_ns
    for _ in range(50):
        fleet.turn()
    assert max(fleet.times().values()) == held_ns
    assert fleet.clock.status(0, {}).paused
    fleet.clock.step(5 * MS)
    for _ in range(50):
        fleet.turn()
    assert fleet.times() == {0: held_ns + 5 * MS, 1: held_ns + 5 * MS}
    fleet.clock.resume()
    assert fleet.turn() == [0, 1]


def test_a_pause_lets_nobody_stall():
    fleet = Fleet({0: MS, 1: MS}, speed=1.0)
    fleet.turn()
    fleet.clock.pause()
    for _ in range(100):
        fleet.turn(100 * MS)
        assert fleet.clock.take_stalled() == []


def stall(fleet, ua_id):
    """Let UA go mute and turn until it stalls; gives the wall time that took, ns."""
    fleet.mute.add(ua_id)
    begin_ns = fleet.wall_ns
    for _ in range(10_000):
        fleet.turn()
        if stalled := fleet.clock.take_stalled():
            assert [member.ua_id for member in stalled] == [ua_id]
            return fleet.wall_ns - begin_ns
    raise AssertionError("it never stalled")


def test_a_mute_ua_is_let_go_after_the_timeout_and_the_others_go_on():
    fleet = Fleet({0: MS, 1: MS}, stall_timeout_ns=500 * MS)
    fleet.turn()
    wall_ns = stall(fleet, 1)
    assert 400 * MS <= wall_ns <= 600 * MS
    assert fleet.turn() == [0]
    assert fleet.clock.status(0, {}).stalled_ua == (1,)


def test_a_returning_ua_goes_on_at_the_next_tick():
    fleet = Fleet({0: MS, 1: MS}, stall_timeout_ns=10 * MS, tick_period_ns=50 * MS)
    fleet.turn()
    stall(fleet, 1)
    for _ in range(120):
        fleet.turn()
    fleet.mute.clear()
    fleet.join(1)
    joined_ns = fleet[1].sim_time_ns
    assert joined_ns % (50 * MS) == 0
    assert 0 <= joined_ns - fleet[0].sim_time_ns <= 50 * MS
    for _ in range(200):
        fleet.turn()
    assert abs(fleet[0].sim_time_ns - fleet[1].sim_time_ns) <= MS
    assert fleet.ticks[-1][1].keys() == {0, 1}
    assert fleet.clock.status(0, {}).stalled_ua == ()


def test_a_process_that_slept_blames_nobody():
    fleet = Fleet({0: MS, 1: MS}, stall_timeout_ns=SECOND)
    fleet.mute.add(1)
    fleet.turn()
    fleet.turn(60 * SECOND)
    assert fleet.clock.take_stalled() == []
    assert MAX_GAP_NS < SECOND


def test_an_ended_ua_is_waited_for_no_more():
    fleet = Fleet({0: MS, 1: MS})
    fleet.turn()
    fleet.clock.end(fleet[1])
    assert [fleet.turn() for _ in range(3)] == [[0]] * 3
    assert fleet.clock.status(0, {}).ended_ua == (1,)
    assert fleet.clock.status(0, {}).stalled_ua == ()


def test_it_wakes_for_the_pace_and_not_for_what_others_hold():
    fleet = Fleet({0: 10 * MS, 1: 10 * MS}, speed=1.0)
    fleet.turn()
    assert fleet.clock.wake_at_ns() == pytest.approx(10 * MS, abs=2 * MS)
    fleet.mute.add(1)
    for _ in range(30):
        fleet.turn()
    assert fleet.times()[0] <= 20 * MS
    assert fleet.clock.wake_at_ns() > fleet.wall_ns + 10 * MS


def test_status_measures_the_real_time_factor():
    fleet = Fleet({0: MS}, tick_period_ns=100 * MS)
    for _ in range(1500):
        fleet.turn(MS // 4)
        fleet.clock.status(fleet[0].sim_time_ns, {})
    fleet.turn(SECOND)
    fleet.clock.status(fleet[0].sim_time_ns, {})
    for _ in range(8000):
        fleet.turn(MS // 4)
        status = fleet.clock.status(fleet[0].sim_time_ns, {0: 2})
    assert status.real_time_factor == pytest.approx(4.0, rel=0.01)
    assert status.restarts == {0: 2}


@pytest.mark.parametrize(
    "settings",
    [
        *({"speed": speed} for speed in (0, -1, float("nan"), 5e-324, 1e300)),
        {"tick_period_ns": 0},
        {"window_ns": 0},
    ],
)
def test_settings_out_of_range_are_refused(settings):
    with pytest.raises(ValueError, match=r"must be (above 0|from 0\.001 to 1e\+06, or inf)"):
        ClockSettings(**settings)


def test_a_fleet_has_somebody():
    with pytest.raises(ValueError, match="at least one"):
        FleetClock([], ClockSettings(), 0)


class SharedNumbers:
    """The board of several clocks in one process."""

    def __init__(self, count):
        self.slowest = [0] * count
        self.steps = [0] * count

    def view(self, index):
        shared = self

        class View:
            woken = 0

            def slowest_ns(self):
                return min(shared.slowest)

            def largest_step_ns(self):
                return max(shared.steps)

            def publish(self, slowest_ns, largest_step_ns):
                shared.slowest[index], shared.steps[index] = slowest_ns, largest_step_ns

            def ask_for_wake(self):
                self.woken += 1

        return View()


class PeerFleet(Fleet):
    def __init__(self, steps_ns, peers, **settings):
        super().__init__(steps_ns, joined=False, hold_ticks=True, **settings)
        clock_settings = ClockSettings(**{"speed": inf, "hold_ticks": True, **settings})
        self.clock = FleetClock(steps_ns, clock_settings, 0, peers)
        for ua_id in steps_ns:
            self.join(ua_id)
        self.clock.release(0)


def test_clocks_of_two_processes_keep_one_window():
    board = SharedNumbers(2)
    first = PeerFleet({0: MS, 1: MS}, board.view(0))
    second = PeerFleet({2: 3 * MS}, board.view(1))
    times = []
    for which in (first, first, first, first, second, first, first, second, second, first) * 5:
        which.turn()
        times = [*first.times().values(), *second.times().values()]
        assert max(times) - min(times) <= 3 * MS  # one frame at the slowest rate, which is the other's
    assert min(times) >= 15 * MS


def test_a_clock_asks_to_be_woken_only_while_a_ua_waits_and_does_not_miss_a_change():
    board = SharedNumbers(2)
    peers = board.view(0)
    fleet = PeerFleet({0: MS}, peers)
    board.slowest[1] = 0
    fleet.turn()
    fleet.turn()
    assert fleet.times() == {0: MS}
    assert fleet.clock.wake_at_ns() > fleet.wall_ns
    assert peers.woken == 1
    board.slowest[1] = MS
    assert fleet.clock.wake_at_ns() == fleet.wall_ns
    fleet.turn()
    assert fleet.times() == {0: 2 * MS}


def test_who_joins_where_all_had_stalled_joins_at_the_fleets_next_tick():
    board = SharedNumbers(2)
    fleet = PeerFleet({0: MS}, board.view(0), stall_timeout_ns=10 * MS)
    fleet.turn()
    board.slowest[1] = 400 * MS
    fleet.mute.add(0)
    for _ in range(20):
        fleet.turn()
        fleet.clock.take_stalled()
    assert board.slowest[0] == NEVER_NS
    fleet.clock.pass_ticks(350 * MS)
    assert fleet.clock.join(fleet[0]) == 400 * MS
