"""Items of a mission that were reached, as the autopilot says (MISSION_ITEM_REACHED)."""

from __future__ import annotations

from typing import Final

from aps.vehicle.state import VehicleState

__all__ = ["reached_ns", "reached_since", "repeats_last"]

_ITEM_REACHED: Final = 46


def reached_ns(state: VehicleState) -> int:
    """When one was last reached, ns of the daemon's clock; -1 if none was."""
    return state.heard_ns.get(_ITEM_REACHED, -1)


def repeats_last(state: VehicleState) -> bool:
    """Whether it may say again that it has reached the last item, of the flight before.

    PX4 does so ten times, at 1 Hz, until it begins anew.
    """
    return state.mission_reached >= 0 and state.mission_reached == state.mission_total


def reached_since(start: VehicleState, now: VehicleState) -> bool:
    """Whether one was reached since, and not said again."""
    return reached_ns(now) > reached_ns(start) and not repeats_last(start)
