"""On which cores an exchange and its autopilots run (docs/adr/011-where-autopilot-and-physics-run.md)."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable
from math import inf

from fdm.exchange.placement.shared_core import SharedCore, can_place, process_at
from fdm.exchange.placement.trial import Trial
from fdm.exchange.seat import Seat
from fdm.exchange.settings import Placement

_log = logging.getLogger(__name__)


class Placer:
    """Has an exchange's thread and its autopilots share a core at full speed, if that was asked for or pays.

    Only wall time depends on it. Called from the exchange's loop, but for `give_back`.

    Args:
        placement: of the exchange.
        alone: no other process serves UA of the same fleet.
        find: gives the process behind a UDP address.
    """

    def __init__(
        self,
        placement: Placement,
        *,
        alone: bool,
        find: Callable[[tuple[str, int]], int | None] = process_at,
    ) -> None:
        self._wanted = placement != "spread" and can_place()
        self._trial = Trial() if placement == "auto" else None
        self._alone, self._find = alone, find
        self._shared: SharedCore | None = None
        self._pids: dict[tuple[str, int], int] = {}

    def at_tick(
        self, seats: Iterable[Seat], speed: float, sim_time_ns: int, wall_ns: int, others: int = 0
    ) -> None:
        """A tick of sim time was emitted at `wall_ns` (monotonic): put everybody where they are to be.

        `others` fly beside them, on cores that are not ours to choose.
        """
        if not self._wanted:
            return
        live = [seat.aircraft for seat in seats if seat.member.live]
        if speed != inf or not self._fits(len(live), others, any(aircraft.parallel for aircraft in live)):
            self.give_back()
            return
        pids = self._processes(aircraft.lockstep.sender for aircraft in live)
        if pids is None:
            self.give_back()
        elif self._shares(sim_time_ns, wall_ns) != (self._shared is not None):
            self._change(pids)

    def give_back(self) -> None:
        """Let everybody run where they might before."""
        if self._shared is not None:
            self._shared.give_back()
            self._shared = None
        if self._trial is not None:
            self._trial.restart()

    def _fits(self, live: int, others: int, parallel: bool) -> bool:
        """Whether sharing is to be thought of; unasked only for two who can only work by turns."""
        return live > 0 and (self._trial is None or (self._alone and live + others == 1 and not parallel))

    def _processes(self, senders: Iterable[tuple[str, int]]) -> list[int] | None:
        """The autopilots' processes; None if one of them cannot be found. Each is looked for once."""
        wanted = tuple(senders)
        if wanted != tuple(self._pids):
            if self._shared is not None:
                self._shared.give_back()
                self._shared = None
            self._pids = {sender: self._pids.get(sender) or self._find(sender) or 0 for sender in wanted}
        pids = list(self._pids.values())
        return pids if all(pids) else None

    def _shares(self, sim_time_ns: int, wall_ns: int) -> bool:
        trial = self._trial
        if trial is None:
            return True
        if not trial.done:
            trial.at(sim_time_ns, wall_ns)
            if trial.done:
                _log.info("autopilot and physics %s one core", "share" if trial.second else "do not share")
        return trial.second

    def _change(self, pids: list[int]) -> None:
        if self._shared is None:
            self._shared = SharedCore(pids)
        else:
            self._shared.give_back()
            self._shared = None
