"""Ticks of a fleet that is spread over processes: a tick is due when every process has reached it. Sans-IO."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from itertools import chain

from fdm.clock.events import EventKind, UaEvent
from fdm.clock.status import ClockStatus, RateMeter
from fdm.model.truth import TrueState

_LIVE_AFTER = {
    EventKind.JOINED: True,
    EventKind.RESTARTED: True,
    EventKind.RETURNED: True,
    EventKind.ABSENT: False,
    EventKind.STALLED: False,
    EventKind.DIVERGED: False,
}


class FleetTicks:
    """Joins what the processes of a fleet report.

    Args:
        shares: per process, the ids of its UA; processes are named by index.
        tick_period_ns: sim time between ticks.
    """

    def __init__(self, shares: Sequence[Sequence[int]], tick_period_ns: int) -> None:
        self._shares = shares
        self._live = dict.fromkeys(sorted(chain(*shares)), True)  # until an event says that one is not
        self._ended: set[int] = set()
        self._restarts = dict.fromkeys(self._live, 0)
        self._reports: list[deque[tuple[int, Sequence[TrueState]]]] = [deque() for _ in shares]
        self._tick_period_ns = tick_period_ns
        self._next_tick_ns = 0
        self._rate: RateMeter | None = None

    def reached(self, process: int, sim_time_ns: int, truths: Sequence[TrueState]) -> None:
        """All live UA of `process` have reached the tick `sim_time_ns`, with these truths."""
        if sim_time_ns >= self._next_tick_ns:  # else it had no live UA when the fleet passed that tick
            self._reports[process].append((sim_time_ns, truths))

    def happened(self, event: UaEvent) -> None:
        """Take note of what happened to a UA."""
        live = self._live[event.ua_id] = _LIVE_AFTER.get(event.kind, self._live[event.ua_id])
        if event.kind is EventKind.DIVERGED:
            self._ended.add(event.ua_id)
        elif live:
            self._ended.discard(event.ua_id)
        if event.kind is EventKind.RESTARTED:
            self._restarts[event.ua_id] += 1

    def take_due(self, idle: Sequence[bool]) -> tuple[int, list[TrueState]] | None:
        """The tick that is due, if one is, with all truths by UA id; the next is then the one after it.

        Args:
            idle: per process, whether it has no live UA, so that nobody waits for it once its events have said so too:
                else the tick's status would depend on which of the two comes first.
        """
        if not any(self._reports):
            return None
        for reports, share, is_idle in zip(self._reports, self._shares, idle, strict=True):
            if not reports and (not is_idle or any(self._live[ua_id] for ua_id in share)):
                return None
        tick_ns = self._next_tick_ns
        truths: list[TrueState] = []
        for reports in self._reports:
            if reports and reports[0][0] == tick_ns:
                truths += reports.popleft()[1]
        self._next_tick_ns += self._tick_period_ns
        return tick_ns, sorted(truths, key=lambda truth: truth.ua_id)

    def status(self, sim_time_ns: int, wall_ns: int, speed: float, paused: bool) -> ClockStatus:
        """The fleet's status at the tick `sim_time_ns`."""
        if self._rate is None:
            self._rate = RateMeter(wall_ns)
        return ClockStatus(
            sim_time_ns=sim_time_ns,
            speed=speed,
            real_time_factor=self._rate.measure(sim_time_ns, wall_ns),
            paused=paused,
            stalled_ua=tuple(i for i, live in self._live.items() if not live and i not in self._ended),
            restarts=dict(self._restarts),
            ended_ua=tuple(sorted(self._ended)),
        )
