"""How far sim time may go by wall time: speed, pause, single steps. Sans-IO: wall instants are arguments, ns."""

from __future__ import annotations

from math import inf

from fdm.clock.status import check_speed

NEVER_NS = 1 << 62
"""Later than any instant, of sim or wall time."""
MAX_LAG_NS = 100_000_000
"""Wall time that a fleet running late may make up for by running faster."""


class FleetPace:
    """The pace of a fleet. Whenever `limit_ns` was changed, a UA that was refused a step might be granted it.

    Args:
        speed: sim time per wall time; inf = as fast as possible.

    Attributes:
        speed: so.
        paused: sim time is held.
        limit_ns: sim time that no UA may step beyond.
        moves: `limit_ns` grows with wall time.
    """

    __slots__ = ("_sim_ns", "_wall_ns", "limit_ns", "moves", "paused", "speed")

    def __init__(self, speed: float) -> None:
        self.speed = speed
        self.paused = False
        self.restart(0, 0)

    def set_speed(self, speed: float) -> None:
        """Aim at `speed`; `restart` is to follow.

        Raises:
            ValueError: a speed out of its range (fdm.clock.status.SPEED_RANGE).
        """
        check_speed(speed)
        self.speed = speed

    def restart(self, sim_ns: int, wall_ns: int) -> None:
        """Count from here: sim time is `sim_ns` at the instant `wall_ns`. A pause goes on."""
        self._sim_ns, self._wall_ns = sim_ns, wall_ns
        self.moves = not self.paused and self.speed != inf
        if not self.paused:
            self.limit_ns = sim_ns if self.moves else NEVER_NS

    def pause(self, sim_ns: int) -> None:
        """Hold sim time at `sim_ns`."""
        self.paused, self.moves = True, False
        self.limit_ns = sim_ns

    def step(self, sim_ns: int) -> None:
        """While paused: let sim time go on by `sim_ns`, then hold again.

        Raises:
            ValueError: `sim_ns` is not above 0.
        """
        if sim_ns <= 0:
            raise ValueError(f"step of {sim_ns} ns: must be above 0")
        if self.paused:
            self.limit_ns += sim_ns

    def resume(self, sim_ns: int, wall_ns: int) -> None:
        """End a pause; sim time is `sim_ns` at the instant `wall_ns`."""
        self.paused = False
        self.restart(sim_ns, wall_ns)

    def move(self, slowest_ns: int, wall_ns: int) -> bool:
        """Let wall time reach `wall_ns`, while the limit `moves`; gives whether that changed it.

        A fleet whose slowest UA, at `slowest_ns`, is behind by more than MAX_LAG_NS of wall time makes up for no more.
        """
        limit_ns = self._sim_ns + int((wall_ns - self._wall_ns) * self.speed)
        furthest_ns = slowest_ns + int(MAX_LAG_NS * self.speed)
        if limit_ns > furthest_ns:
            limit_ns = self._sim_ns = furthest_ns
            self._wall_ns = wall_ns
        changed = limit_ns != self.limit_ns
        self.limit_ns = limit_ns
        return changed

    def allows_at_ns(self, target_ns: int) -> int:
        """Wall instant at which the limit, while it `moves`, reaches `target_ns`."""
        return self._wall_ns + int((target_ns - self._sim_ns) / self.speed) + 1
