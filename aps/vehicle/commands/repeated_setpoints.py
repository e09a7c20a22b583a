"""Setpoints of a plan: sent again and again, with what goes beside them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from aps.vehicle.commands.plan import CommandPlan
from aps.vehicle.execution import NS_PER_S
from aps.vehicle.state import VehicleState

LEAD_PATIENCE: Final = 10.0
"""Leads that are waited for by our clock, if the autopilot's is slower."""
ECHO_SETPOINTS: Final = 5
"""So many setpoints in a row do not get lost."""
MOST_ECHOES: Final = 10
"""That are asked for: it may have no such message."""


class RepeatedSetpoints:
    """Those of one plan.

    Attributes:
        due_ns: when the next one is, by the daemon's clock.
    """

    def __init__(self, plan: CommandPlan) -> None:
        self._plan = plan
        self.due_ns = 0
        self._due_ms = 0
        """The same, by the autopilot's."""
        self._lead: tuple[int, int] | None = None
        """The autopilot's clock, ms, and ours, ns, since when it has had setpoints, ours or of those before us."""
        self._begun_ms: int | None = None
        """The autopilot's clock at our own first one, where that is before acceptance."""
        self._besides = 0
        """How often it had something beside a setpoint."""
        self._echoes = 0
        """How often it was asked what it flies to ..."""
        self._taken = False
        """... whether it said that it is what it was sent ..."""
        self._other: Mapping[str, Any] | None = None
        """... or what else, in the end."""

    def leads(self, state: VehicleState, now_ns: int, lead_s: float) -> bool:
        """Whether it is too early for the first step; an autopilot whose clock stands still is not waited for."""
        if self._begun_ms is None:
            self._begun_ms = state.time_boot_ms
        if self._lead is None:
            self._lead = state.time_boot_ms, now_ns
        from_ms, from_ns = self._lead
        waits = now_ns - from_ns < LEAD_PATIENCE * lead_s * NS_PER_S
        return waits and state.time_boot_ms - from_ms < lead_s * 1000.0

    def leads_on(self, older: RepeatedSetpoints) -> None:
        """Take the place of another plan's, which the autopilot has had until now."""
        if self._plan.lead_s is not None and older._plan.lead_s is not None:
            self._lead = older._lead

    def leave_speed(self) -> None:
        """Ask for its speed no more: a newer command changes it."""
        self._besides = ECHO_SETPOINTS

    def poll(self, state: VehicleState, now_ns: int, accepted_ms: int | None) -> list[Any]:
        """The setpoint, if it is due by the daemon's clock or by the autopilot's, which may run faster.

        Args:
            state: the UA now.
            now_ns: the daemon's clock.
            accepted_ms: the autopilot's clock at acceptance; ``None``: before it.
        """
        plan, clock_ms = self._plan, state.time_boot_ms
        if plan.setpoint is None or (now_ns < self.due_ns and clock_ms < self._due_ms):
            return []
        self.due_ns = now_ns + round(plan.setpoint_period_s * NS_PER_S)
        self._due_ms = clock_ms + round(plan.setpoint_period_s * 1000.0)
        from_ms = (accepted_ms or 0) if self._begun_ms is None else self._begun_ms
        messages = [plan.setpoint(state, (clock_ms - from_ms) / 1000.0)]
        if plan.beside is not None and accepted_ms is not None and self._besides < ECHO_SETPOINTS:
            self._besides += 1
            messages.append(plan.beside)
        if plan.echo is not None and not self._taken and self._echoes < MOST_ECHOES:
            self._echoes += 1
            messages.append(plan.echo.ask)
        return messages

    def on_message(self, name: str, fields: Mapping[str, Any]) -> None:
        """What the autopilot says that it flies to."""
        echo = self._plan.echo
        if echo is not None and echo.name == name and self._echoes:
            self._taken |= echo.is_ours(fields)
            self._other = None if self._taken or self._echoes < ECHO_SETPOINTS else fields

    def refusal(self, state: VehicleState) -> str:
        """What it means if the autopilot has said since the last call that it flies to something else; else empty."""
        echo, other, self._other = self._plan.echo, self._other, None
        return echo.refusal if echo is not None and other is not None and echo.is_true(other, state) else ""
