"""A record as the view's source: played by wall time at any speed, held, or brought to any instant.

To go to an instant is to play up to it in a hurry, so that charts and counts are what they would be after watching.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from contextlib import suppress
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from bridge.bus.messages import AgentStatus
from lostlink.replay.moment import Moment
from lostlink.replay.player import Player
from lostlink.replay.playing.pace import Pace
from lostlink.view.picture.fleet_view import TRAIL_PERIOD_NS, FleetView

SLICE_S = 0.03
"""Longest that is played at once: viewers are served in between."""
REST_S = 0.02
STATES_PERIOD_S = 0.25
"""How often the states of autopilots are looked up."""
CLOCK_PERIOD_S = 0.25
"""How often the clock is repeated while it stands."""


class RecordSource:
    """Plays a record into a view (a `TimeControl`).

    Args:
        player: of the record.
        view: what is fed.
        clock: wall time in seconds, from anywhere.
    """

    can_seek = True

    def __init__(self, player: Player, view: FleetView, clock: Callable[[], float]) -> None:
        self._player, self._view, self._clock = player, view, clock
        self._pace = Pace(1.0, player.begin_ns, clock())
        self._goal_ns: int | None = None
        self._trail_ns = -TRAIL_PERIOD_NS
        self._states_due_s = 0.0
        self._changes = 0
        """Of modes, by now."""
        self._states_are_lost = self._logged_is_lost = False

    # What viewers do.

    def pause(self) -> None:
        """Hold."""
        self._pace.pause()
        self._tell_clock()

    def resume(self) -> None:
        """Go on; from the beginning if this is the end."""
        if self._now_ns >= self._player.end_ns:
            self.seek(self._player.begin_ns / 1e9)
        self._pace.resume(self._clock())
        self._tell_clock()

    def step(self) -> None:
        """Play one tick, and hold."""
        self._pace.pause()
        self._play_next(in_a_hurry=False)

    def speed(self, factor: float) -> None:
        """Play so fast."""
        self._pace.set_speed(factor, self._clock())

    def seek(self, sim_time_s: float) -> None:
        """Go to an instant, or to the end nearest to it."""
        self._goal_ns = min(max(round(sim_time_s * 1e9), self._player.begin_ns), self._player.end_ns)
        if self._goal_ns < self._now_ns:
            self._view.forget()
            self._trail_ns, self._changes = -TRAIL_PERIOD_NS, 0
            self._take(self._player.seek(self._player.begin_ns), in_a_hurry=True)

    # Playing.

    async def run(self) -> None:
        """Play until cancelled."""
        with suppress(OSError, ValueError):  # is reported when they are looked up
            await asyncio.to_thread(lambda: self._player.record.states)
        told_s = self._clock()
        while True:
            self.play()
            if self._clock() - told_s >= CLOCK_PERIOD_S:
                told_s = self._clock()
                self._tell_clock()
            await asyncio.sleep(0 if self._goal_ns is not None else REST_S)

    def play(self) -> None:
        """Play what is due by now, as far as it goes in one slice."""
        until_s = self._clock() + SLICE_S
        if self._goal_ns is not None:
            while self._now_ns < self._goal_ns and self._clock() < until_s:
                self._play_next(in_a_hurry=True)
            self._view.fresh_losses()  # what is passed over was not lost just now
            if self._now_ns >= self._goal_ns:
                self._arrive()
            return
        while not self._pace.paused and self._next_is_due() and self._clock() < until_s:
            self._play_next(in_a_hurry=False)

    def _arrive(self) -> None:
        """Show all of the instant that was sought, and go on from there."""
        self._goal_ns = None
        if self._player.now is not None:
            self._take(self._player.now, in_a_hurry=False, again=True)
            self._pace.move(self._now_ns, self._clock())

    @property
    def _now_ns(self) -> int:
        return self._player.now.sim_time_ns if self._player.now is not None else -1

    def _next_is_due(self) -> bool:
        following_ns = self._player.following_ns
        if following_ns is None:
            self.pause()
            return False
        return self._pace.due_s(following_ns) <= self._clock()

    def _play_next(self, *, in_a_hurry: bool) -> None:
        moment = self._player.step()
        if moment is not None:
            self._take(moment, in_a_hurry=in_a_hurry)
            self._pace.played(moment.sim_time_ns, self._clock())

    def _take(self, moment: Moment, *, in_a_hurry: bool, again: bool = False) -> None:
        """Give a moment to the view; ``again``: what is counted was taken already."""
        view = self._view
        self._tell_clock()  # what is said is said at this tick
        if not again:
            view.take(moment.fates())
            if moment.links_are_due:
                view.take(moment.links())
            for event in moment.events():
                view.tell(event.node, event.text)
            self._take_logged(moment)
        if not in_a_hurry or moment.sim_time_ns - self._trail_ns >= TRAIL_PERIOD_NS:
            self._trail_ns = moment.sim_time_ns
            view.take(moment.truths())
        self._take_states(moment, are_due=not in_a_hurry and (again or self._clock() >= self._states_due_s))

    def _take_states(self, moment: Moment, *, are_due: bool) -> None:
        """The newest states, now and then; and at each tick at which a mode changes, which is told."""
        if self._states_are_lost:
            return
        try:
            changes = int(np.searchsorted(self._modes_change_ns, moment.sim_time_ns, side="right"))
            if not are_due and changes == self._changes:
                return
            self._changes, self._states_due_s = changes, self._clock() + STATES_PERIOD_S
            for node, state in moment.states().items():
                self._view.take(state, node)
        except (OSError, ValueError) as error:
            self._states_are_lost = True
            self._view.tell("", f"the states of autopilots cannot be read: {error}")

    @cached_property
    def _modes_change_ns(self) -> NDArray[np.int64]:
        return self._player.record.states.changes_ns("mode")

    def _take_logged(self, moment: Moment) -> None:
        if self._logged_is_lost:
            return
        try:
            for node, sim_time_ns, item in moment.logged():
                if isinstance(item, AgentStatus):
                    self._view.take(item, node)
                else:
                    self._view.logged.take(node, item.name, sim_time_ns, item.value)
        except (OSError, ValueError) as error:
            self._logged_is_lost = True
            self._view.tell("", f"what agents logged cannot be read: {error}")

    def _tell_clock(self) -> None:
        moment = self._player.now
        if moment is not None:
            self._view.take(moment.clock(self._pace.speed, self._pace.speed, paused=self._pace.paused))
