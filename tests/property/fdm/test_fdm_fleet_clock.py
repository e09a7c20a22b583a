"""The fleet clock with any mix of rates, windows, mute and returning UA."""

from math import inf

from hypothesis import given
from hypothesis import strategies as st

from fdm.clock.fleet_clock import FleetClock
from fdm.clock.status import ClockSettings

MS = 1_000_000
steps = st.lists(
    st.sampled_from([833_333, 1_250_000, 2_500_000, 5_000_000, 11_111_111]), min_size=1, max_size=8
)
turns = st.lists(st.tuples(st.integers(0, 7), st.booleans()), max_size=80)


@given(steps, st.sampled_from([None, 3 * MS, 20 * MS]), turns)
def test_live_ua_keep_together_and_never_pass_a_tick_that_was_not_emitted(steps_ns, window_ns, acts):
    settings = ClockSettings(
        speed=inf, window_ns=window_ns, tick_period_ns=20 * MS, stall_timeout_ns=5 * MS, start_together=False
    )
    clock = FleetClock(range(len(steps_ns)), settings, 0)
    members = [clock.members[i] for i in range(len(steps_ns))]
    allowed_ns = max(window_ns or 0, *steps_ns)
    wall_ns, next_tick_ns = 0, 0
    for which, answers in acts:
        wall_ns += MS // 2
        clock.update(wall_ns)
        member = members[which % len(members)]
        if answers and not member.waiting:
            if not member.live:
                joined_ns = clock.join(member)
                assert joined_ns % (20 * MS) == 0
            clock.ask(member, member.sim_time_ns + steps_ns[member.ua_id])
        for member in clock.take_stalled():
            assert not member.live
        moved = True
        while moved:
            moved = False
            while (tick_ns := clock.due_tick_ns()) is not None:
                assert tick_ns == next_tick_ns
                assert all(m.sim_time_ns >= tick_ns and m.quiet for m in clock.live_members())
                next_tick_ns += 20 * MS
                clock.tick_emitted()
            for member in members:
                if member.waiting and clock.may_step(member):
                    assert member.sim_time_ns < next_tick_ns
                    clock.stepped(member)
                    slowest_ns = min(m.sim_time_ns for m in clock.live_members())
                    assert member.sim_time_ns - slowest_ns <= allowed_ns
                    moved = True
        # Nobody is held for nothing: if all live UA wait, somebody may step.
        live = clock.live_members()
        assert not live or not all(m.waiting for m in live)
