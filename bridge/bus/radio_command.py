"""The command that switches a node's radio: what an operator asks on ``node/<id>/cmd/radio``.

Its one argument is ``on``, true or false. It is the node's own and not its aircraft's, so every node that the clock
waits for takes it; an agent has no such command.
"""

from __future__ import annotations

import json
from typing import Final

from bridge.bus.messages.types import CommandGoal

RADIO: Final = "radio"
"""Its verb."""


class RadioMistake(ValueError):
    """The command's arguments are wrong; the text says what is right."""


def radio_goal(*, on: bool) -> CommandGoal:
    """The goal that switches a radio on or off."""
    return CommandGoal(arguments=json.dumps({"on": on}))


def is_on(goal: CommandGoal) -> bool:
    """Whether a goal switches the radio on, or else off.

    Raises:
        RadioMistake: it does neither.
    """
    try:
        arguments = json.loads(goal.arguments)
    except (ValueError, RecursionError):
        arguments = None
    if not isinstance(arguments, dict) or set(arguments) != {"on"} or not isinstance(arguments["on"], bool):
        raise RadioMistake(f'{RADIO}: arguments have to be {{"on": true}} or {{"on": false}}')
    return bool(arguments["on"])
