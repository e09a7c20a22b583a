"""What `fly` returns."""

from __future__ import annotations

from pathlib import Path

from lostlink.flight.scripted import RunResult


def test_an_assertion_shows_why_a_run_failed() -> None:
    summary = {
        "ending": "failed",
        "outcome": "broke_off",
        "verdict": "broke off: the agent of UA 1 raised KeyError: 'x'",
        "error": "the agent of UA 1 raised KeyError: 'x'",
        "events": [{"node": str(number)} for number in range(1000)],
    }
    told = "<RunResult r, failed: broke off: the agent of UA 1 raised KeyError: 'x'>"
    assert repr(RunResult(Path("runs/r"), summary)) == told
