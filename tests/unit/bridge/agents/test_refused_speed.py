"""A `goto` that is flown, but not at the speed that was asked for."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from bridge.agents.client import UaClient
from bridge.bus.messages import AgentStatus, CommandEvent, CommandGoal

TOLD = "DO_CHANGE_SPEED refused: FAILED (a speed beyond AIRSPEED_MIN to AIRSPEED_MAX)"


class Outlet:
    """Carries out what it is given, and keeps what is reported."""

    def __init__(self, text: str, outcome: str) -> None:
        self._text, self._outcome = text, outcome
        self.said: list[str] = []

    def command(self, verb: str, goal: CommandGoal, on_event: Callable[[CommandEvent], object]) -> None:
        on_event(CommandEvent(CommandEvent.FEEDBACK, True, self._text, outcome=self._outcome))
        on_event(CommandEvent(CommandEvent.ACCEPTED, True, "accepted by the autopilot"))
        on_event(CommandEvent(CommandEvent.RESULT, True, f"{verb} reached", outcome="reached"))

    def report(self, status: AgentStatus) -> None:
        self.said.append(status.activity)


@pytest.mark.parametrize(
    ("text", "outcome", "said"),
    [
        (TOLD, "refused", [f"goto: {TOLD}"]),
        ("in progress, 30 %", "", []),
        ("the last try was refused: it goes on", "", []),
    ],
)
async def test_it_is_told_unless_the_agent_listens_itself(text: str, outcome: str, said: list[str]) -> None:
    outlet = Outlet(text, outcome)
    ua = UaClient("0", outlet)  # type: ignore[arg-type]
    assert await ua.goto(47.0, 8.0, 20.0, speed_mps=7.0)
    assert outlet.said == said
    heard: list[str] = []
    assert await ua.goto(47.0, 8.0, 20.0, speed_mps=7.0, on_feedback=lambda event: heard.append(event.text))
    assert (outlet.said, heard) == (said, [text])
