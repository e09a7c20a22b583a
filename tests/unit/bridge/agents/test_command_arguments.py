"""Arguments of an agent's commands: numpy's numbers are numbers, and a wrong one is told by its name."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest

from bridge.agents.commands import Commands
from bridge.bus.handling import handling_of
from bridge.bus.messages import CommandEvent, CommandGoal


class Noted(Commands):
    """Keeps what is commanded."""

    def __init__(self) -> None:
        self.goals: list[CommandGoal] = []

    async def command(self, verb: str, goal: Any = None, on_feedback: Any = None) -> CommandEvent:
        self.goals.append(goal)
        return CommandEvent(CommandEvent.RESULT, True, outcome="reached", value="1")


async def test_numbers_of_numpy_are_numbers() -> None:
    ua = Noted()
    half, two = np.float32(0.5), np.int64(2)
    await ua.takeoff(half)
    await ua.goto(half, two, np.float64(3.0), yaw_deg=half)
    await ua.goto_ned(half, two, half, within_m=half)
    await ua.velocity(half, two, yaw_rate_dps=half)
    await ua.mission([{"command": two, "params": np.array([0.5, 2.0], np.float32)}])
    takeoff, goto, ned, velocity, mission, flown = ua.goals[:6]
    assert (takeoff.altitude_rel_m, goto.latitude_deg, goto.longitude_deg) == (0.5, 0.5, 2.0)
    assert json.loads(goto.arguments) == {"yaw_deg": 0.5}
    assert json.loads(ned.arguments) == {
        "north_m": 0.5, "east_m": 2.0, "down_m": 0.5, "frame": "origin", "within_m": 0.5
    }  # fmt: skip
    assert json.loads(velocity.arguments)["yaw_rate_dps"] == 0.5
    assert json.loads(mission.arguments)["items"] == [{"command": 2, "params": [0.5, 2.0]}]
    assert json.loads(flown.arguments) == {"first": 0}, "whatever mission was stopped before"
    assert handling_of(np.int8(3), np.float32(0.5), "").lifetime_ns == 500_000_000  # type: ignore[arg-type]


@pytest.mark.parametrize("wrong", [None, "20 m", True, np.array([1.0, 2.0])])
async def test_what_is_no_number_is_told_by_its_name(wrong: Any) -> None:
    ua = Noted()
    with pytest.raises(TypeError, match="goto_ned: north_m has to be a number, and is "):
        await ua.goto_ned(wrong, 0.0, -5.0)
    with pytest.raises(TypeError, match="takeoff: alt_rel_m has to be a number, and is "):
        await ua.takeoff(wrong)
    assert ua.goals == []


async def test_a_frame_that_is_none_is_told_with_all_that_there_are() -> None:
    with pytest.raises(ValueError, match="frame 'fleett' is none of fleet, origin, offset, body"):
        await Noted().goto_ned(1.0, 0.0, -5.0, frame="fleett")


async def test_a_whole_number_that_no_float_can_hold_is_told_by_its_name() -> None:
    with pytest.raises(ValueError, match="goto: lat_deg is more than a number can be: 1000"):
        await Noted().goto(10**400, 8.0, 20.0)


async def test_a_message_may_have_a_field_called_name() -> None:
    ua = Noted()
    await ua.send("NAMED_VALUE_FLOAT", time_boot_ms=0, name="x", value=1.0)
    assert json.loads(ua.goals[0].arguments) == {
        "name": "NAMED_VALUE_FLOAT", "fields": {"time_boot_ms": 0, "name": "x", "value": 1.0}
    }  # fmt: skip
