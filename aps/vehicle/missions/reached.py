"""Items of a mission that were reached, as the autopilot says (MISSION_ITEM_REACHED)."""

from __future__ import annotations

from typing import Final

from aps.vehicle.state import VehicleState

_ITEM_REACHED: Final = 46


def reached_since(start: VehicleState, now: VehicleState) -> bool:
    """Whether one was reached since, and not said again."""
    return _reached_ns(now) > _reached_ns(start) and not _repeats_last(start)


class ReachedItems:
    """Those of one flight, from the state before it: what is said at its start may be of the one before."""

    def __init__(self, before: VehicleState) -> None:
        self._before_ns = self._started_ns = _reached_ns(before)
        self._is_stale = _repeats_last(before)
        """Whether it still repeats that it has reached the last item, of the flight before."""
        self.last_ns: int | None = None
        """When the last item was first said to be reached, ns of the daemon's clock."""

    def starts(self, now: VehicleState) -> None:
        """The flight starts with this state, or a later one."""
        self._started_ns = _reached_ns(now)

    def take(self, now: VehicleState) -> bool:
        """Return whether an item was reached in the flight."""
        at_ns = _reached_ns(now)
        self._is_stale &= _repeats_last(now) and at_ns == self._started_ns
        is_new = at_ns > self._before_ns and not self._is_stale
        if self.last_ns is None and is_new and now.mission_reached == now.mission_total:
            self.last_ns = at_ns
        return is_new


def _reached_ns(state: VehicleState) -> int:
    """When one was last reached, ns of the daemon's clock; -1 if none was."""
    return state.heard_ns.get(_ITEM_REACHED, -1)


def _repeats_last(state: VehicleState) -> bool:
    """Whether it may say again that it has reached the last item, of the flight before.

    PX4 does so ten times, at 1 Hz, until it begins anew.
    """
    return state.mission_reached >= 0 and state.mission_reached == state.mission_total
