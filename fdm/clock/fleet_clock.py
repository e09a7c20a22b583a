"""The fleet clock: how far each UA may step, and when. Sans-IO: wall instants are arguments (monotonic, ns).

A UA that wants to step from t to its target may do so if all of these hold:

- the fleet has started (every UA has joined, or the start timeout passed since `begin`);
- ``t < tick bound``: no UA steps beyond a tick before every live UA is quiet there, the tick was emitted and, if
  ticks are held, released. Ticks are the instants k * tick_period_ns of fleet sim time. A UA is quiet at a tick when
  it has reached it and its autopilot is blocked: it has read all answers and asked for its next step, so that nothing
  comes from it before the next answer;
- ``target <= slowest + window``: no UA runs ahead of the slowest live one by more than the window;
- ``target <= pace``: sim time runs at most `speed` times as fast as wall time; a fleet that falls behind by
  more than fdm.clock.pace.MAX_LAG_NS of wall time does not try to make up for it.

A live UA that is not quiet owes a packet. When it owes one for longer than the stall timeout it is stalled: nobody
waits for it any more. When it sends again it joins again, as after a boot, at the next tick.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Protocol

from fdm.clock.member import Member
from fdm.clock.pace import NEVER_NS, FleetPace
from fdm.clock.status import ClockSettings, ClockStatus, RateMeter

__all__ = ["ClockStatus", "FleetClock", "Peers"]

MAX_GAP_NS = 200_000_000
"""Longest time between two updates that counts towards a stall: a sleeping process hears nobody."""
WAKE_CHECK_NS = 20_000_000
"""A UA that waits for another process looks after this long even if no wake came."""


class Peers(Protocol):
    """The fleet clocks of other processes, where a fleet is spread over several."""

    def slowest_ns(self) -> int:
        """Sim time of the slowest live UA of all processes, this one's as published; NEVER_NS: none is live."""

    def largest_step_ns(self) -> int:
        """The longest step of all processes, this one's as published."""

    def publish(self, slowest_ns: int, largest_step_ns: int) -> None:
        """Publish this process's slowest live UA (NEVER_NS: none) and longest step."""

    def ask_for_wake(self) -> None:
        """Have this process woken when `slowest_ns` changes."""


class FleetClock:
    """Sim time of a fleet.

    Args:
        ua_ids: the fleet, each once, at least one.
        settings: how to run.
        wall_ns: the present instant; see `begin`.
        peers: the rest of the fleet, in other processes; None = there is none. The ticks are then those of this
            process, to be held until all processes have reached them.

    Attributes:
        pace: how far sim time may go by wall time; set it by the clock's own methods.
        wall_ns: instant of the latest `update`.
        limits_version: changes whenever a UA that was refused a step might be granted it now, or a tick is due.
    """

    def __init__(
        self, ua_ids: Iterable[int], settings: ClockSettings, wall_ns: int, peers: Peers | None = None
    ) -> None:
        self.members = {ua_id: Member(ua_id) for ua_id in ua_ids}
        if not self.members:
            raise ValueError("a fleet clock needs at least one UA")
        self._settings = settings
        self._peers = peers
        self.pace = FleetPace(settings.speed)
        self.started = not settings.start_together
        self.limits_version = 0
        self._live: list[Member] = []
        self._slowest_ns = 0  # of the whole fleet; the next two are of this process
        self._own_slowest_ns = 0
        self._at_slowest = 0
        self._largest_step_ns = 0
        self._window_limit_ns = 0
        self._next_tick_ns = 0
        self._released_ns = -1
        self._tick_bound_ns = 0
        self.wall_ns = self._begin_ns = wall_ns
        self._count_from_here()
        if self.started:
            self._set_slowest()

    def begin(self, wall_ns: int) -> None:
        """The exchange begins to serve: time-outs, pace and rate count from here, not from when it was made ready."""
        self.wall_ns = self._begin_ns = wall_ns
        self._count_from_here()

    # The hot path

    def ask(self, member: Member, target_ns: int, quiet: bool = True) -> None:
        """Take note that a live `member` wants to step to `target_ns` of fleet sim time.

        If its autopilot is not `quiet` yet, this is to be called again when it is.
        """
        member.target_ns = target_ns
        member.waiting = True
        member.quiet = quiet
        if quiet and member.sim_time_ns >= self._next_tick_ns:
            self.limits_version += 1
        step_ns = target_ns - member.sim_time_ns
        if step_ns > self._largest_step_ns:
            self._largest_step_ns = step_ns
            self._set_slowest()

    def may_step(self, member: Member) -> bool:
        """Whether `member` may take the step it asked for, now."""
        now_ns, target_ns = member.sim_time_ns, member.target_ns
        return (
            now_ns < self._tick_bound_ns
            and (target_ns <= self._window_limit_ns or now_ns == self._slowest_ns)
            and target_ns <= self.pace.limit_ns
        )

    def stepped(self, member: Member) -> None:
        """Take note that `member` took its step and was answered."""
        was_slowest = member.sim_time_ns == self._own_slowest_ns
        member.sim_time_ns = member.target_ns
        member.waiting = member.quiet = False
        member.idle_ns = 0
        if len(self._live) == 1 and self._peers is None:
            # Nobody else waits, so that no limit changes; and silence counts from this frame on.
            self._slowest_ns = self._own_slowest_ns = member.sim_time_ns
            self._stall_check_ns = self.wall_ns
        elif was_slowest:
            self._at_slowest -= 1
            if self._at_slowest <= 0:
                self._find_slowest()

    def update(self, wall_ns: int) -> None:
        """Let wall time reach `wall_ns`: the pace moves on."""
        gap_ns = wall_ns - self.wall_ns
        self.wall_ns = wall_ns
        if not self.started:
            return
        if self.pace.moves and self.pace.move(self._slowest_ns, wall_ns):
            self.limits_version += 1
        if self._peers is not None and self._peers.slowest_ns() != self._slowest_ns:
            self._set_slowest()
        if gap_ns > MAX_GAP_NS:
            self._stall_check_ns += gap_ns - MAX_GAP_NS

    def update_deaf(self, wall_ns: int) -> None:
        """As `update`, after a time in which nobody could be heard: it counts towards no stall."""
        self._stall_check_ns += wall_ns - self.wall_ns
        self.wall_ns = wall_ns
        self.update(wall_ns)

    # Joining, leaving

    def join(self, member: Member) -> int:
        """`member` boots, or returns after a stall; gives the fleet sim time at which it goes on, ns.

        Before the start that is 0; later the next tick, so that its frames keep in step with the ticks.
        """
        self._drop(member)
        member.sim_time_ns = self._next_tick_ns if self.started else 0
        member.live = True
        member.joined = True
        member.ended = False
        member.idle_ns = 0
        self._live.append(member)
        if not self.started and all(other.joined for other in self.members.values()):
            self._start()
        self._find_slowest()
        return member.sim_time_ns

    def end(self, member: Member) -> None:
        """`member` is out: nobody waits for it until it joins again."""
        self._drop(member)
        member.ended = True
        self._find_slowest()

    def excuse(self, member: Member) -> None:
        """`member` owes nothing for now, as it has not been answered yet: its silence begins anew."""
        member.idle_ns = 0

    def take_absent(self) -> list[Member]:
        """If the start timeout has just passed, start, and give the members that have not joined.

        Call it when all packets that are there were heard.
        """
        if self.started or self.wall_ns - self._begin_ns < self._settings.start_timeout_ns:
            return []
        self._start()
        return [member for member in self.members.values() if not member.joined]

    def take_stalled(self) -> list[Member]:
        """The members that have just stalled, if any. Call it when all packets that are there were heard.

        A stall is looked for only every tenth of the stall timeout.
        """
        timeout_ns = self._settings.stall_timeout_ns
        elapsed_ns = self.wall_ns - self._stall_check_ns
        if not self.started or elapsed_ns < timeout_ns // 10:
            return []
        self._stall_check_ns = self.wall_ns
        stalled = []
        for member in self._live:
            if not member.quiet:
                member.idle_ns += elapsed_ns
                if member.idle_ns > timeout_ns:
                    stalled.append(member)
        for member in stalled:
            self._drop(member)
        if stalled:
            self._find_slowest()
        return stalled

    # Ticks

    def due_tick_ns(self) -> int | None:
        """The tick at which every live UA is quiet, once; None before that, and while the tick before it is held."""
        if (
            self._own_slowest_ns >= self._next_tick_ns
            and self._live
            and self.started
            and not self._tick_is_held()
            and all(member.quiet for member in self._live)
        ):
            return self._next_tick_ns
        return None

    def tick_emitted(self) -> None:
        """The tick that was due was emitted."""
        self._next_tick_ns += self._settings.tick_period_ns
        self._set_tick_bound()

    def release(self, sim_time_ns: int) -> None:
        """Let UA step beyond the ticks up to `sim_time_ns` (only matters with hold_ticks)."""
        if sim_time_ns > self._released_ns:
            self._released_ns = sim_time_ns
            self._set_tick_bound()

    def pass_ticks(self, sim_time_ns: int) -> None:
        """The ticks up to `sim_time_ns` were emitted by peers: who joins from now on joins at a later one."""
        if not self._live and self._next_tick_ns <= sim_time_ns:
            self._next_tick_ns = sim_time_ns + self._settings.tick_period_ns
            self._set_tick_bound()

    def live_members(self) -> list[Member]:
        """The members that others wait for, by UA id."""
        return sorted(self._live, key=lambda member: member.ua_id)

    def status(self, sim_time_ns: int, restarts: Mapping[int, int]) -> ClockStatus:
        """The status at the tick `sim_time_ns`."""
        members = sorted(self.members.values(), key=lambda member: member.ua_id)
        return ClockStatus(
            sim_time_ns=sim_time_ns,
            speed=self.pace.speed,
            real_time_factor=self._rate.measure(sim_time_ns, self.wall_ns),
            paused=self.pace.paused,
            stalled_ua=tuple(m.ua_id for m in members if not m.live and not m.ended) if self.started else (),
            restarts=dict(restarts),
            ended_ua=tuple(m.ua_id for m in members if m.ended),
        )

    # Speed

    def set_speed(self, speed: float) -> None:
        """Aim at `speed` (sim per wall time, inf = as fast as possible) from now on.

        Raises:
            ValueError: a speed out of its range (fdm.clock.status.SPEED_RANGE).
        """
        self.pace.set_speed(speed)
        self._restart_pace()

    def pause(self) -> None:
        """Hold sim time where it is."""
        self.pace.pause(self._slowest_ns)

    def resume(self) -> None:
        """End a pause."""
        self.pace.resume(self._slowest_ns, self.wall_ns)
        self.limits_version += 1

    def step(self, sim_ns: int) -> None:
        """While paused: let sim time go on by `sim_ns`, then hold again.

        Raises:
            ValueError: `sim_ns` is not above 0.
        """
        self.pace.step(sim_ns)
        self.limits_version += 1

    def wake_at_ns(self) -> int:
        """Wall instant at which `update`, `take_absent` or `take_stalled` has work though nothing was received."""
        if not self.started:
            return self._begin_ns + self._settings.start_timeout_ns
        wake_ns = self._stall_check_ns + self._settings.stall_timeout_ns // 10 + 1
        if self._peers is not None:
            wake_ns = min(wake_ns, self._wake_with_peers_ns(self._peers))
        if not self.pace.moves:
            return wake_ns
        for member in self._live:
            if member.waiting and member.target_ns > self.pace.limit_ns:
                wake_ns = min(wake_ns, self.pace.allows_at_ns(member.target_ns))
        return wake_ns

    # Inner workings

    def _start(self) -> None:
        self.started = True
        self._find_slowest()
        self._count_from_here()

    def _count_from_here(self) -> None:
        self._stall_check_ns = self.wall_ns
        self._rate = RateMeter(self.wall_ns)
        self._restart_pace()

    def _drop(self, member: Member) -> None:
        if member.live:
            self._live.remove(member)
        member.live = False
        member.waiting = member.quiet = False

    def _find_slowest(self) -> None:
        if len(self._live) == 1:
            self._own_slowest_ns, self._at_slowest = self._live[0].sim_time_ns, 1
        elif self._live:
            times = [member.sim_time_ns for member in self._live]
            self._own_slowest_ns = min(times)
            self._at_slowest = times.count(self._own_slowest_ns)
        self._set_slowest()

    def _set_slowest(self) -> None:
        slowest_ns = self._own_slowest_ns
        if self._peers is not None and self.started:
            self._peers.publish(slowest_ns if self._live else NEVER_NS, self._largest_step_ns)
            slowest_ns = self._peers.slowest_ns()
            self._largest_step_ns = self._peers.largest_step_ns()
        if slowest_ns != NEVER_NS:
            self._slowest_ns = slowest_ns
        self._set_window_limit()

    def _wake_with_peers_ns(self, peers: Peers) -> int:
        if not any(member.waiting for member in self._live):
            return NEVER_NS
        peers.ask_for_wake()
        # What changed before the wake was asked for would go unnoticed.
        return self.wall_ns + WAKE_CHECK_NS if peers.slowest_ns() == self._slowest_ns else self.wall_ns

    def _set_window_limit(self) -> None:
        window_ns = self._settings.window_ns
        self._window_limit_ns = self._slowest_ns + (self._largest_step_ns if window_ns is None else window_ns)
        self.limits_version += 1

    def _set_tick_bound(self) -> None:
        last_tick_ns = self._next_tick_ns - self._settings.tick_period_ns
        self._tick_bound_ns = last_tick_ns if self._tick_is_held() else self._next_tick_ns
        self.limits_version += 1

    def _tick_is_held(self) -> bool:
        last_tick_ns = self._next_tick_ns - self._settings.tick_period_ns
        return self._settings.hold_ticks and self._released_ns < last_tick_ns

    def _restart_pace(self) -> None:
        self.pace.restart(self._slowest_ns, self.wall_ns)
        self.limits_version += 1
