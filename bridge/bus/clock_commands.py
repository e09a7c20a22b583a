"""Commands to the clock of a running simulation: what an operator asks on ``clock/cmd/<verb>``.

The payload is a plain number as text, or empty; the answer is JSON: how the clock stands, or an error with ``error``.
They change how fast sim time goes by wall time, and nothing else: no result depends on it. A record that is played
takes the same ones and ``seek`` (`lostlink.replay.playing.controls`).
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

VERBS: Final = ("pause", "resume", "step", "speed", "status")
STEP_MAX_S: Final = 3600.0


class ClockMistake(ValueError):
    """A command to a clock is wrong; the text says what is right."""


@dataclass(frozen=True, slots=True)
class ClockCommand:
    """One command; ``number`` is seconds (step, seek) or a factor (speed), None if there is none."""

    verb: str
    number: float | None = None


def read_command(verb: str, payload: bytes, verbs: Sequence[str] = VERBS) -> ClockCommand:
    """The command in a query.

    Args:
        verb: what is asked.
        payload: its number as text, or empty.
        verbs: what may be asked.

    Raises:
        ClockMistake: there is no such verb, or its number is wrong.
    """
    if verb not in verbs:
        raise ClockMistake(f"{verb!r} is none of {', '.join(verbs)}")
    text = payload[:64].decode("utf-8", errors="replace").strip()
    if verb in ("pause", "resume", "status"):
        return ClockCommand(verb)
    if verb == "step" and not text:
        return ClockCommand(verb)
    try:
        number = math.inf if verb == "speed" and text == "max" else float(text)
    except ValueError:
        raise ClockMistake(f"{verb} {text!r}: has to be a number") from None
    if verb == "step" and not 0.0 < number <= STEP_MAX_S:
        raise ClockMistake(f"step of {number} s: has to be above 0 and at most {STEP_MAX_S:g}")
    if math.isnan(number):
        raise ClockMistake(f"{verb} {text!r}: has to be a number")
    return ClockCommand(verb, number)


def named_speed(speed: float) -> float | str:
    """A factor as commands and answers have it: ``max`` if it is infinite, which JSON cannot say."""
    return "max" if math.isinf(speed) else speed


def answer(sim_time_ns: int, speed: float, *, paused: bool) -> bytes:
    """What is replied to a command that was taken: how the clock stands now."""
    content = {
        "sim_time_s": sim_time_ns / 1e9,
        "paused": paused,
        "speed": named_speed(speed),
    }
    return json.dumps(content).encode()


def refusal(error: Exception) -> bytes:
    """What is replied, as an error, to one that was not."""
    return json.dumps({"error": str(error)}).encode()
