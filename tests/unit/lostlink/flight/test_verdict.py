"""A run's outcome, and the words and statuses that follow from it."""

from __future__ import annotations

from typing import Any

import pytest

from lostlink.expectations.judge import Judgement
from lostlink.flight.exits import DISAGREES, UNEXPECTED, WELL, RunOutcome, status_of
from lostlink.flight.verdict import verdict_of

LINKS = [{"radio": "main", "sent": 50, "delivered": 25}]
GOOD = {
    "name": "losses",
    "chance": 0.2,
    "passed": True,
    "wrong": "1% of the packets",
    "power": 1.0,
    "sees": True,
}
BAD = {"name": "noise", "chance": 1e-5, "passed": False, "wrong": "any", "power": 1.0, "sees": True}
BLIND = {
    "name": "level of the powers",
    "chance": 0.5,
    "passed": True,
    "wrong": "2 dB off",
    "power": 0.1,
    "sees": False,
}


def expected(*, passed: bool) -> Judgement:
    return Judgement("range", "position", "within 5 m", 9.0, "m", passed=passed)


MET, MISSED = expected(passed=True), expected(passed=False)


@pytest.mark.parametrize(
    ("checks", "judged", "ending", "outcome", "status", "text"),
    [
        ([GOOD], [MET], "done", "pass", WELL, "pass: 1 expectations met; 1 checks of draws against"),
        ([GOOD], [MISSED, MET], "done", "fail", UNEXPECTED, "fail: 1 of 2 expectations not met: range; 1 ch"),
        ([BAD], [], "done", "fail", DISAGREES, "fail: 1 of 1 checks against the model: noise (chance 1e-05)"),
        (
            [BAD],
            [MISSED],
            "done",
            "fail",
            DISAGREES,
            "fail: 1 of 1 expectations not met: range; 1 of 1 checks",
        ),
        ([], [], "duration", "none", WELL, "no verdict: nothing was drawn; 25 of 50 packets delivered"),
        ([], [MISSED], "done", "fail", UNEXPECTED, "fail: 1 of 1 expectations not met: range; nothing was d"),
        ([BAD], [], "interrupted", "interrupted", WELL, "interrupted: 25 of 50 packets delivered"),
        ([GOOD], [], "failed", "broke_off", DISAGREES, "broke off: 25 of 50 packets delivered"),
    ],
)
def test_words_and_status_follow_from_the_outcome(
    checks: list[dict[str, Any]],
    judged: list[Judgement],
    ending: str,
    outcome: str,
    status: int,
    text: str,
) -> None:
    verdict = verdict_of(checks, LINKS, ending, judged)
    assert verdict.outcome == outcome
    assert verdict.text.startswith(text)
    expectations = [{"passed": each.passed} for each in judged]
    summary = {"outcome": verdict.outcome, "checks": checks, "expectations": expectations}
    assert status_of(summary) == status


def test_packets_are_told_of_each_network() -> None:
    tele = [{"radio": "tele", "sent": 10, "delivered": 0, "lost": {"below_preamble": 4}}] * 2
    assert verdict_of([], [*LINKS, *tele], "interrupted").text == (
        "interrupted: main: 25 of 50 packets delivered; tele: 0 of 20 packets delivered, "
        "8 too weak for their receivers to lock on to (below_preamble)"
    )
    assert verdict_of([], tele[:1], "interrupted").text.startswith("interrupted: tele: 0 of 10 packets")


def test_of_many_that_had_not_finished_the_first_are_named() -> None:
    swarm = verdict_of([GOOD], LINKS, "duration", [], [str(node) for node in range(250)])
    assert swarm.text.endswith("; nodes 0, 1, 2, 3, 4 and 245 more had not finished")


def test_what_ended_a_run_comes_before_what_follows_from_it() -> None:
    error = "the agent of UA 0 failed: ValueError at a tick: oh no; its log is node-0.log\nTraceback"
    broke_off = verdict_of([GOOD], LINKS, "failed", [MISSED], ["0"], error=error)
    assert broke_off.text == (
        "broke off: the agent of UA 0 failed: ValueError at a tick: oh no; 25 of 50 packets delivered; "
        "1 of 1 expectations not met: range; node 0 had not finished"
    )
    interrupted = verdict_of([GOOD], LINKS, "interrupted", [MISSED])
    assert interrupted.text == "interrupted: 25 of 50 packets delivered; 1 of 1 expectations not met: range"


def test_the_first_word_says_that_all_is_well_of_nothing_else() -> None:
    assert [outcome for outcome in RunOutcome if outcome.word.startswith("pass")] == [RunOutcome.PASS]


def test_what_was_not_judged_and_what_would_not_have_been_seen_is_said() -> None:
    few, other = "5 of 8 places", "3 of 8 pairs of packets"
    unjudged = [
        {"name": name, "why": why} for name, why in (("level", few), ("spread", few), ("over place", other))
    ]
    text = verdict_of([GOOD, BLIND], LINKS, "done", unjudged=unjudged).text
    assert text.startswith(
        "pass: 2 checks of draws and powers against the model; too little to see: level of the powers (2 dB off); "
        "not judged: level, spread (5 of 8 places), over place (3 of 8 pairs of packets); 25 of 50"
    )
    assert "judged" not in verdict_of([GOOD], LINKS, "done").text
