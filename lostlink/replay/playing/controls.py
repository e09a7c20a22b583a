"""What whoever looks on may ask of a record that is played: pause, go on, a step, another place, another speed."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from bridge.bus.clock_commands import ClockCommand, named_speed, read_command
from lostlink.replay.moment import Moment
from lostlink.replay.player import Player
from lostlink.replay.playing.pace import NS_PER_S, Pace

SPEED_MIN, SPEED_MAX = 0.01, 1000.0
VERBS = ("pause", "resume", "step", "seek", "speed", "status")


class Controls:
    """A player and its pace, moved by verbs. No I/O, no clock.

    Args:
        player: what is played.
        pace: how fast.
        begin_ns: where playing begins, and begins anew.
        end_ns: where it ends.
    """

    def __init__(self, player: Player, pace: Pace, begin_ns: int, end_ns: int) -> None:
        self.player = player
        self.pace = pace
        self.begin_ns = begin_ns
        self.end_ns = end_ns
        self._verbs: dict[str, Callable[[ClockCommand, float], Moment | None]] = {
            "pause": self._pause,
            "resume": self._resume,
            "step": self._step,
            "seek": self._seek,
            "speed": self._speed,
            "status": lambda _command, _now_s: None,
        }

    def do(self, verb: str, text: str, now_s: float) -> Moment | None:
        """Carry out a verb; returns the moment that it led to, if it led to one.

        Args:
            verb: one of VERBS.
            text: its argument: seconds of sim time for ``seek`` and, if more than a tick, ``step``; a real-time factor
                or ``max`` for ``speed``.
            now_s: wall time.

        Raises:
            ValueError: there is no such verb, or its argument is wrong.
        """
        command = read_command(verb, text.encode(), VERBS)
        return self._verbs[verb](command, now_s)

    def status(self) -> dict[str, Any]:
        """Where it is, in plain types."""
        now = self.player.now
        return {
            "sim_time_s": None if now is None else now.sim_time_ns / NS_PER_S,
            "begin_s": self.begin_ns / NS_PER_S,
            "end_s": self.end_ns / NS_PER_S,
            "paused": self.pace.paused,
            "speed": named_speed(self.pace.speed),
        }

    def next(self, now_s: float) -> Moment | None:
        """Play the next tick; None when the end is reached."""
        if self.player.now is None:
            moment: Moment | None = self.player.seek(self.begin_ns)
        else:
            following_ns = self.player.following_ns
            moment = None if following_ns is None or following_ns > self.end_ns else self.player.step()
        if moment is not None:
            self.pace.played(moment.sim_time_ns, now_s)
        return moment

    def rewind(self, now_s: float) -> Moment:
        """Begin anew."""
        return self._to(self.begin_ns, now_s)

    def due_s(self) -> float:
        """Wall time at which the next tick is due; inf: not before somebody asks for it."""
        following_ns = self.player.following_ns
        return self.pace.due_s(self.end_ns if following_ns is None else following_ns)

    def _to(self, sim_time_ns: int, now_s: float) -> Moment:
        moment = self.player.seek(sim_time_ns)
        self.pace.move(moment.sim_time_ns, now_s)
        return moment

    def _pause(self, _command: ClockCommand, _now_s: float) -> None:
        self.pace.pause()

    def _resume(self, _command: ClockCommand, now_s: float) -> None:
        self.pace.resume(now_s)

    def _step(self, command: ClockCommand, now_s: float) -> Moment | None:
        """Go on by whole ticks, and at least by one."""
        self.pace.pause()
        now, following_ns = self.player.now, self.player.following_ns
        if command.number is None or now is None or following_ns is None:
            return self.next(now_s)
        until_ns = min(now.sim_time_ns + round(command.number * NS_PER_S), self.end_ns)
        return self._to(until_ns, now_s) if until_ns > following_ns else self.next(now_s)

    def _seek(self, command: ClockCommand, now_s: float) -> Moment:
        begin_s, end_s = self.begin_ns / NS_PER_S, self.end_ns / NS_PER_S
        seconds = _within(command.number, "seek: seconds of sim time", begin_s, end_s)
        return self._to(round(seconds * NS_PER_S), now_s)

    def _speed(self, command: ClockCommand, now_s: float) -> None:
        is_max = command.number == math.inf
        speed = (
            math.inf if is_max else _within(command.number, "speed: a factor, or max", SPEED_MIN, SPEED_MAX)
        )
        self.pace.set_speed(speed, now_s)


def _within(number: float | None, what: str, least: float, most: float) -> float:
    if number is None or not least <= number <= most:
        raise ValueError(f"{what}, from {least:g} to {most:g}, not {number}")
    return number
