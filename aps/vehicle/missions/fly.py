"""Flying the mission that the autopilot has: start, progress, complete, and where to go on."""

from __future__ import annotations

from math import inf
from typing import Final

from aps.timeouts import MODE_TIMEOUT_S
from aps.vehicle.autopilots.autopilot import Manoeuvre
from aps.vehicle.autopilots.choice import autopilot_of
from aps.vehicle.commands.plan import CommandPlan, Step
from aps.vehicle.flight.returning import Returning
from aps.vehicle.flight.steps import checked, finite_or_none
from aps.vehicle.missions.items import KINDS, first_seq
from aps.vehicle.missions.reached import ReachedItems, reached_since
from aps.vehicle.state import VehicleState
from aps.wire.dialect import is_plane

MISSION_TIMEOUT_S: Final = 24 * 3600.0
STALE_S: Final = 5.0
"""A mission that was begun and still says COMPLETE so long after its start, by the autopilot's clock, is complete (it
was short), not the one before."""
LAST_ITEM_GRACE_MS: Final = 1500
"""Between a heartbeat that shows the mode to which the last item leads, and the MISSION_CURRENT of that item (1 Hz); or
between a MISSION_CURRENT that is back at the first item, as ArduPilot disarms, and the heartbeat of that (1 Hz)."""

_LANDED_STATE: Final = 245


class _End:
    """Whether the mission is complete: the state at the start may still be that of the flight before.

    The autopilot says so; one that does not has reached the last item and does not land there, has landed, or (a fixed
    wing whose last item is a return) circles over home or a rally point.
    """

    def __init__(self, start: VehicleState, way: Manoeuvre) -> None:
        self._start, self._way = start, way
        self._returning = Returning(way.return_modes)
        self._lowest = first_seq(KINDS["mission"], start.autopilot)
        self._reached = ReachedItems(start)
        self._begun = self._started = False
        self._was_armed = False
        """Since: a UA that stands where the flight before has landed it has not flown this one."""
        self._last_item_ms = -inf
        """When it was last at its last item, by the autopilot's clock."""

    def is_there(self, now: VehicleState) -> bool:
        self._begun |= self._shows_begun(now)
        self._was_armed |= now.armed
        if not self._started:
            is_in_mode = not now.mission_state and now.mode in self._way.modes
            self._started = now.mission_state == "ACTIVE" or is_in_mode
            self._reached.starts(now)
        if now.mission_state == "COMPLETE":
            since_ms = now.time_boot_ms - self._start.time_boot_ms
            return self._started or (self._begun and since_ms > STALE_S * 1000.0)
        return self._started and now.mission_total >= self._lowest and self._has_ended(now)

    def is_at_last(self, now: VehicleState) -> bool:
        """Whether it flies the last item, as far as the autopilot says which that is; no mission has none."""
        return now.mission_total <= now.mission_current and now.mission_total not in range(self._lowest)

    def _shows_begun(self, now: VehicleState) -> bool:
        shown = self._way.steps[-1].shown
        if shown is not None:
            return shown(now)
        return now.mode in self._way.modes or reached_since(self._start, now)

    def _has_ended(self, now: VehicleState) -> bool:
        at_last = self.is_at_last(now)
        if at_last:
            self._last_item_ms = now.time_boot_ms
        newly_reached = self._reached.take(now)
        if newly_reached and now.mode in self._way.end_modes and now.mission_reached == now.mission_current:
            return True  # a DO_JUMP at the end is never current
        was_at_last = now.time_boot_ms - self._last_item_ms <= LAST_ITEM_GRACE_MS
        landed = was_at_last and self._was_armed and not now.armed
        returned = at_last and now.mode in self._way.return_modes and self._returning.is_there(now)
        last_ns = self._reached.last_ns
        return landed or returned or (last_ns is not None and not _may_land(now, last_ns))


def _may_land(now: VehicleState, reached_ns: int) -> bool:
    """Whether it sinks where it has reached its last item, or has not said since that it does not.

    PX4 reaches NAV_LAND above the place, and then begins to land (MissionBase::handleLanding).
    """
    heard_ns = now.heard_ns.get(_LANDED_STATE)
    return heard_ns is not None and (heard_ns <= reached_ns or now.landed_state == "landing")


def fly(state: VehicleState, first: int | None = None) -> CommandPlan:
    """Fly the mission; done when its last item is.

    Args:
        state: the UA now.
        first: number of the item to begin with, as the autopilot counts (ArduPilot: the first after home is 1, PX4: 0);
            ``None`` where it stopped before, or at the beginning.
    """
    way = autopilot_of(state.autopilot).mission(state)
    before = () if first is None else (_current_step(state, first),)
    end = _End(state, way)
    return CommandPlan(
        "mission",
        (*before, *way.steps),
        end.is_there,
        MISSION_TIMEOUT_S,
        remaining_m=lambda now: finite_or_none(now.waypoint_distance_m),
        modes=way.modes,
        may_leave=lambda now: now.mode in way.last_modes and end.is_at_last(now),
        leave_grace_ms=LAST_ITEM_GRACE_MS if way.last_modes else 0,
        needs_armed=True,
        launches=is_plane(state.vehicle_type),
        refusal_hint="" if state.mission_total else "the autopilot has no mission",
        interruption_texts=way.interruption_texts,
        position=lambda now: (
            max(0, now.mission_current),
            now.mission_total if now.mission_total > 0 else None,
        ),
    )


def _current_step(state: VehicleState, seq: int) -> Step:
    if isinstance(seq, bool) or not isinstance(seq, int):
        raise ValueError(f"the number of an item is a whole number, not {seq!r}")
    number = checked("the number of an item", seq, 0, 0xFFFE)
    return autopilot_of(state.autopilot).current_item_step(state, int(number))


def set_current(state: VehicleState, seq: int) -> CommandPlan:
    """Have the autopilot go on with another item of its mission.

    Args:
        state: the UA now.
        seq: number of the item, as the autopilot counts (ArduPilot: the first after home is 1, PX4: 0).
    """
    step = _current_step(state, seq)
    # ArduPilot takes home for the first item.
    goals = (seq, max(seq, first_seq(KINDS["mission"], state.autopilot)))
    return CommandPlan(
        "mission_set_current",
        (step,),
        lambda now: now.mission_current in goals,
        MODE_TIMEOUT_S,
        occupies="",
    )
