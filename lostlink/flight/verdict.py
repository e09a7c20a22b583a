"""What a run is worth: one outcome, and a line of words that begins with it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby
from operator import itemgetter
from typing import Any

from channel.medium.reception import Fate
from lostlink.expectations.judge import Judgement
from lostlink.flight.exits import RunOutcome
from lostlink.reading.named import named
from lostlink.reading.network_names import are_named

UNJUDGED = {"interrupted": RunOutcome.INTERRUPTED, "failed": RunOutcome.BROKE_OFF}
"""By ending: outcomes of runs that say nothing of the model."""

ITS_LOG = "; its log is "
"""In an error, before the path of a log."""


@dataclass(frozen=True, slots=True)
class RunVerdict:
    """What a run is worth.

    Attributes:
        outcome: for programs.
        text: for people; its first word is the outcome's.
    """

    outcome: RunOutcome
    text: str


def verdict_of(
    checks: Sequence[dict[str, Any]],
    links: Sequence[dict[str, Any]],
    ending: str,
    judgements: Sequence[Judgement] = (),
    unfinished: Sequence[str] = (),
    unjudged: Sequence[dict[str, Any]] = (),
    remarks: Sequence[str] = (),
    *,
    error: str | None = None,
) -> RunVerdict:
    """Whether packets are what the radio says, and the run what its scenario expects.

    Args:
        checks: of packets against the model, as in `summary.json`, as are ``links`` and ``ending``.
        links: with ``radio``, ``sent`` and ``delivered``, and ``lost`` by cause.
        ending: how the run ended.
        judgements: what came of each expectation.
        unfinished: nodes that had not finished.
        unjudged: what the run says too little about, as in `summary.json`.
        remarks: on what it was flown, for runs that came to their end.
        error: what ended a run that broke off; its first line, without the log's path, comes before all that follows.
    """
    outcome = UNJUDGED.get(ending) or _judged(checks, judgements)
    expected, counts = list(_of_expectations(judgements)), _counts(links, outcome)
    if outcome in UNJUDGED.values():
        cause = (error or "").splitlines()[:1]
        told = [*(line.split(ITS_LOG)[0] for line in cause), counts, *expected]
    else:
        told = [*expected, *_of_checks(checks, unjudged), counts, *remarks]
    if unfinished:
        told.append(f"node{'s' * (len(unfinished) > 1)} {named(unfinished)} had not finished")
    return RunVerdict(outcome, f"{outcome.word}: {'; '.join(told)}")


def _judged(checks: Sequence[dict[str, Any]], judgements: Sequence[Judgement]) -> RunOutcome:
    if not all(check["passed"] for check in checks) or not all(each.passed for each in judgements):
        return RunOutcome.FAIL
    return RunOutcome.PASS if checks else RunOutcome.NONE


def _of_expectations(judgements: Sequence[Judgement]) -> Iterator[str]:
    missed = [each.name for each in judgements if not each.passed]
    if missed:
        yield f"{len(missed)} of {len(judgements)} expectations not met: {', '.join(missed)}"
    elif judgements:
        yield f"{len(judgements)} expectations met"


def _of_checks(checks: Sequence[dict[str, Any]], unjudged: Sequence[dict[str, Any]]) -> Iterator[str]:
    failed = [f"{check['name']} (chance {check['chance']:.2g})" for check in checks if not check["passed"]]
    if failed:
        yield f"{len(failed)} of {len(checks)} checks against the model: {', '.join(failed)}"
    elif checks:
        what = "draws and powers" if any("powers" in check["name"] for check in checks) else "draws"
        yield f"{len(checks)} checks of {what} against the model"
    else:
        yield "nothing was drawn"
    blind = [f"{check['name']} ({check['wrong']})" for check in checks if not check["sees"]]
    if blind:
        yield f"too little to see: {', '.join(blind)}"
    if unjudged:
        yield f"not judged: {', '.join(_with_reasons(unjudged))}"


def _with_reasons(unjudged: Sequence[dict[str, Any]]) -> Iterator[str]:
    """Names with the same reason together."""
    for why, each in groupby(unjudged, itemgetter("why")):
        yield f"{', '.join(one['name'] for one in each)} ({why})"


def _counts(links: Sequence[dict[str, Any]], outcome: RunOutcome) -> str:
    if not links and outcome in UNJUDGED.values():
        return "no link was recorded"
    networks = dict.fromkeys(link["radio"] for link in links)
    if not are_named(networks):
        return _delivered(links)
    return "; ".join(
        f"{name}: {_delivered([each for each in links if each['radio'] == name])}" for name in networks
    )


def _delivered(links: Sequence[dict[str, Any]]) -> str:
    sent, delivered = (sum(link[key] for link in links) for key in ("sent", "delivered"))
    told = f"{delivered} of {sent} packets delivered"
    weak = sum(link.get("lost", {}).get(Fate.BELOW_PREAMBLE.value, 0) for link in links)
    return (
        f"{told}, {weak} too weak for their receivers to lock on to ({Fate.BELOW_PREAMBLE.value})"
        if weak
        else told
    )
