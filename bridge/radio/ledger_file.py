"""The counters of the radio, in `ledger.json`."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from enum import StrEnum
from pathlib import Path
from typing import TypeVar

from channel.medium.judge.check import Verdict
from channel.medium.ledger import Ledger

LEDGER = "ledger.json"
NOTHING_JUDGED = Verdict(())
Refusal = TypeVar("Refusal", bound=StrEnum)


def write_ledger(
    path: Path,
    ledger: Ledger,
    refused: Mapping[Refusal, int],
    progress: Callable[[float], object] = lambda _: None,
    verdict: Verdict = NOTHING_JUDGED,
    *,
    shares_draws: bool = False,
) -> None:
    """Write the counters: per directed link, what was measured and predicted per bin, what was not taken; the verdict.

    ``progress`` is called now and then with the share of the bins that is done. The ratio of packets that share what is
    drawn has no binomial interval.
    """
    links = [
        {"tx": tx, "rx": rx, "sent": a.sent, "delivered": a.delivered, "lost": dict(sorted(a.lost.items()))}
        for (tx, rx), a in sorted(ledger.links.items())
    ]
    bins = [
        {
            "tx": b.tx,
            "rx": b.rx,
            "distance_min_m": b.distance_min_m,
            "distance_max_m": b.distance_max_m,
            "sent": b.sent,
            "delivered": b.delivered,
            "measured": b.measured,
            "predicted": b.predicted,
            "ci99": None if shares_draws else [b.ci99_low, b.ci99_high],
        }
        for b in ledger.bins(progress)
    ]
    partial = path.with_suffix(".partial")
    partial.write_text(
        json.dumps(
            {
                "links": links,
                "bins": bins,
                "refused": {r.value: n for r, n in sorted(refused.items())},
                "checks": [check.plain for check in verdict.checks],
                "unjudged": [each._asdict() for each in verdict.unjudged],
            },
            indent=1,
        )
        + "\n",
        encoding="ascii",
    )
    partial.replace(path)
