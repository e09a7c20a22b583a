"""The command that switches a radio: one argument, true or false."""

from __future__ import annotations

import pytest

from bridge.bus.messages import CommandGoal
from bridge.bus.radio_command import RadioMistake, is_on, radio_goal


@pytest.mark.parametrize("on", [True, False])
def test_a_goal_says_what_it_was_made_of(on: bool) -> None:
    assert is_on(radio_goal(on=on)) is on


@pytest.mark.parametrize(
    "arguments",
    ["", "{}", "true", '{"on": 1}', '{"on": "no"}', '{"on": true, "off": 1}', "[" * 100_000, '{"on"'],
)
def test_anything_else_is_a_mistake(arguments: str) -> None:
    with pytest.raises(RadioMistake, match=r'arguments have to be .*"on": false'):
        is_on(CommandGoal(arguments=arguments))
