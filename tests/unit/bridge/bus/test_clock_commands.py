"""Commands to a clock, as they come over Zenoh."""

from __future__ import annotations

import json
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bridge.bus.clock_commands import VERBS, ClockCommand, ClockMistake, answer, read_command, refusal


@pytest.mark.parametrize(
    ("verb", "payload", "command"),
    [
        ("pause", b"", ClockCommand("pause")),
        ("resume", b"whatever", ClockCommand("resume")),
        ("step", b"", ClockCommand("step")),
        ("step", b" 0.5 ", ClockCommand("step", 0.5)),
        ("speed", b"2", ClockCommand("speed", 2.0)),
        ("speed", b"max", ClockCommand("speed", math.inf)),
        ("speed", b"inf", ClockCommand("speed", math.inf)),
    ],
)
def test_what_is_asked(verb: str, payload: bytes, command: ClockCommand) -> None:
    assert read_command(verb, payload) == command


@pytest.mark.parametrize(
    ("verb", "payload", "what"),
    [
        ("speed", b"", "has to be a number"),
        ("speed", b"fast", "'fast': has to be a number"),
        ("speed", b"nan", "has to be a number"),
        ("step", b"0", "above 0 and at most 3600"),
        ("step", b"-1", "above 0"),
        ("step", b"inf", "at most 3600"),
        ("step", b"nan", "above 0"),
        ("seek", b"5", "'seek' is none of pause, resume, step, speed, status"),
        ("*", b"", "is none of pause"),
    ],
)
def test_mistakes_are_told(verb: str, payload: bytes, what: str) -> None:
    with pytest.raises(ClockMistake, match=what) as error:
        read_command(verb, payload)
    assert json.loads(refusal(error.value)) == {"error": str(error.value)}


@given(verb=st.sampled_from(VERBS), payload=st.binary(max_size=80))
def test_any_bytes_are_a_command_or_a_mistake(verb: str, payload: bytes) -> None:
    try:
        command = read_command(verb, payload)
    except ClockMistake:
        return
    assert command.verb == verb


def test_answers_are_json() -> None:
    assert json.loads(answer(50_000_000, 2.0, paused=True)) == {
        "sim_time_s": 0.05,
        "paused": True,
        "speed": 2.0,
    }
    assert json.loads(answer(0, math.inf, paused=False))["speed"] == "max"
