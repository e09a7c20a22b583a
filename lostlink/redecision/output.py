"""What `lostlink redecide` shows: tables by link and by distance, one sentence, a verdict; all of it as JSON."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

from rich import box
from rich.table import Table

from bridge.radio.ledger_file import judged_in
from lostlink.flight.verdict import RunVerdict, verdict_of
from lostlink.reading.network_names import are_named
from lostlink.reading.spans import spans_of
from lostlink.redecision.comparison import BinChange, DecisionComparison, LinkChange
from lostlink.redecision.redecide import Redecision

SCHEMA = 1
LINKS_SHOWN_MAX = 12


def agrees(result: Redecision) -> bool:
    """Whether the new fates are what the radio says."""
    return all(check["passed"] for check in judged_in(result.books)["checks"])


def verdict_on(result: Redecision, written: Mapping[str, Any] | None) -> RunVerdict:
    """What they are worth; of a run that was ``written``, what its summary says.

    Expectations are judged of a directory: without one the words say that they are not.
    """
    if written is not None:
        return RunVerdict(written["outcome"], written["verdict"])
    links = [
        {"radio": each.radio, "sent": account.sent, "delivered": account.delivered}
        for each in result.books
        for account in each.ledger.links.values()
    ]
    judged, expected = judged_in(result.books), len(result.scenario.expectations)
    remarks = [f"{expected} expectations are judged with --out"] if expected else []
    return verdict_of(judged["checks"], links, "done", unjudged=judged["unjudged"], remarks=remarks)


def plain_of(result: Redecision, written: Mapping[str, Any] | None) -> dict[str, Any]:
    """All of it in plain types, of a run that was ``written`` its verdict; docs/how-to/replay.md has the keys."""
    verdict, scenario = verdict_on(result, written), result.scenario
    what = {"schema": SCHEMA, "run": str(result.run), "radio": scenario.radio, "seed": scenario.seed}
    worth = {"outcome": verdict.outcome, "verdict": verdict.text, "edited": list(result.edited)}
    return what | result.comparison.as_plain() | judged_in(result.books) | worth


def tables(comparison: DecisionComparison) -> Iterator[Table]:
    """What people see of it."""
    yield _links_table(comparison.links)
    radios = list(dict.fromkeys(row.radio for row in comparison.bins))
    for radio in radios:
        title = "Share delivered by distance, all links" + (f" of {radio}" if are_named(radios) else "")
        yield _bins_table([row for row in comparison.bins if row.radio == radio], title)


def sentence(comparison: DecisionComparison) -> str:
    """How much is other than it was."""
    if comparison.changed:
        changes = sorted(comparison.changes, key=lambda c: -c["packets"])
        parts = [f"{c['packets']} {_words(c['before'])} -> {_words(c['after'])}" for c in changes]
        text = f"{comparison.changed} of {comparison.fates} fates are other: {', '.join(parts)}"
    elif not comparison.differs:
        text = f"all {comparison.fates} fates are the same, with their powers and error rates, at the same instants"
    else:
        text = f"all {comparison.fates} fates are the same, but not all powers, error rates and instants of arrival"
    missing = comparison.not_compared
    return text + (f"; {missing} are on one side only: the record was cut" if missing else "")


def _words(cause: str) -> str:
    return cause.replace("_", " ")


def _table(title: str, *columns: str) -> Table:
    table = Table(box=box.SIMPLE_HEAD, title=title, title_justify="left")
    for name in columns:
        table.add_column(name, justify="right")
    return table


def _links_table(links: Sequence[LinkChange]) -> Table:
    table = _table(
        "Delivered, before and after",
        *("link", "sent", "before", "after", "lost before", "lost after"),
        *("mean delay before, ms", "mean delay after, ms"),
    )
    has_names = are_named(link.radio for link in links)
    for link in links[:LINKS_SHOWN_MAX]:
        network = f"{link.radio}: " if has_names else ""
        table.add_row(*_link_row(f"{network}{link.tx} -> {link.rx}", [link]))
    if len(links) > LINKS_SHOWN_MAX:
        table.add_row(*_link_row(f"{len(links) - LINKS_SHOWN_MAX} more", links[LINKS_SHOWN_MAX:]))
    if len(links) > 1:
        table.add_row(*_link_row("all", links), style="bold")
    return table


def _link_row(name: str, links: Sequence[LinkChange]) -> tuple[str, ...]:
    sent = sum(link.sent for link in links)
    before, after = (
        sum(counts) for counts in zip(*((k.delivered_before, k.delivered_after) for k in links), strict=True)
    )
    lost = _lost(link.lost_before for link in links), _lost(link.lost_after for link in links)
    delays_s = (
        _mean((link.delivered_before, link.delay_mean_before_s) for link in links),
        _mean((link.delivered_after, link.delay_mean_after_s) for link in links),
    )
    delays_ms = ("-" if mean_s is None else f"{1e3 * mean_s:.2f}" for mean_s in delays_s)
    return name, str(sent), str(before), str(after), *lost, *delays_ms


def _lost(counts: Iterable[dict[str, int]]) -> str:
    total: dict[str, int] = {}
    for each in counts:
        for cause, number in each.items():
            total[cause] = total.get(cause, 0) + number
    return ", ".join(f"{number} {_words(cause)}" for cause, number in sorted(total.items()))


def _bins_table(bins: Sequence[BinChange], title: str) -> Table:
    """All links of a radio network together, by distance."""
    predicts = any(row.predicted_after is not None for row in bins)
    columns = ("distance, m", "packets", "before", "after", *(["predicted"] if predicts else []))
    table = _table(title, *columns)
    for start_m, end_m in spans_of((each.distance_min_m, each.distance_max_m) for each in bins):
        rows = [each for each in bins if start_m <= each.distance_min_m < end_m]
        sent = sum(row.sent for row in rows)
        before, after = (
            sum(each) for each in zip(*((r.delivered_before, r.delivered_after) for r in rows), strict=True)
        )
        shares = [before / sent, after / sent]
        shares += [_mean((row.sent, row.predicted_after) for row in rows)] if predicts else []
        cells = ("-" if share is None else f"{share:.3f}" for share in shares)
        table.add_row(f"{start_m:.0f}-{end_m:.0f}", str(sent), *cells)
    return table


def _mean(means: Iterable[tuple[int, float | None]]) -> float | None:
    """The mean over all, of those of parts with their counts."""
    known = [(count, mean) for count, mean in means if mean is not None]
    total = sum(count for count, _ in known)
    return sum(count * mean for count, mean in known) / total if total else None
