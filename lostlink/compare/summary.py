"""Whether `summary.json` says what the record of its run says: its digests and counts, computed anew from the files."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final

from bridge.radio.ledger_file import LEDGER, read_ledger
from bridge.record.digests import digest_line, digests
from bridge.record.tables.deliveries import DELIVERIES
from bridge.record.tables.every import TABLES
from bridge.run.directory import SCENARIO_FILE, RunDirectory
from channel.medium.judge.check import BASE_LOSS
from lostlink.reading.links.counts import link_counts

FROM_LEDGER: Final = frozenset(("links", "bins", "refused", "checks", "unjudged"))
"""Keys that a summary has from `ledger.json`, as they are there."""
SHOWN: Final = 12
Counts = dict[tuple[str, str], tuple[int, int]]


def mistakes_in_summary(run: Path) -> list[str]:
    """What the summary of a run says otherwise than its record, a line each; none if it says nothing of it.

    Raises:
        OSError, ValueError: a file cannot be read, or is damaged.
    """
    summary = RunDirectory(run).summary
    if "digests" not in summary:
        return []  # the run has no end
    try:
        return [*_in_digests(summary, run), *_in_links(summary, run), *_in_ledger(summary, run)]
    except (AttributeError, LookupError, TypeError) as error:
        raise ValueError(f"{run}: its summary.json is none of a run: {error!r}") from error


def _in_digests(summary: Mapping[str, Any], run: Path) -> Iterator[str]:
    try:
        said, found = summary["digests"], digests(run)
    except (OSError, ValueError) as error:
        yield f"digests: {error}"
        return
    tables = {table.name for table in TABLES}  # a record may lose its streams, to be small
    for name in sorted(found.keys() | (said.keys() & tables)):
        if said.get(name) != found.get(name):
            yield _told(f"digests.{name}", said.get(name), found.get(name))
    if summary.get("digest") != digest_line(said):
        yield _told("digest", summary.get("digest"), digest_line(said))


def _in_links(summary: Mapping[str, Any], run: Path) -> Iterator[str]:
    """Of links of all networks together, as the table of deliveries counts them."""
    if not summary.get("links") or not DELIVERIES.is_in(run) or not (run / SCENARIO_FILE).is_file():
        return  # its radio left no counters
    said, found = _sums(summary["links"]), _counted(run)
    for link in sorted(said.keys() | found.keys()):
        for place, what in enumerate(("sent", "delivered")):
            one, other = (each.get(link, (0, 0))[place] for each in (said, found))
            if one != other:
                yield _told(f"links, {link[0]} to {link[1]}: {what}", one, other)


def _sums(links: list[Mapping[str, Any]]) -> Counts:
    sent, delivered = Counter[tuple[str, str]](), Counter[tuple[str, str]]()
    for each in links:
        link = each["tx"], each["rx"]
        sent[link] += each["sent"]
        delivered[link] += each["delivered"]
    return {link: (sent[link], delivered[link]) for link in sent}


def _counted(run: Path) -> Counts:
    columns = link_counts(run, RunDirectory(run).scenario.transceiver_ids)
    names = ("tx", "rx", "sent", "delivered")
    rows = zip(*(columns[name].tolist() for name in names), strict=True)
    return _sums([dict(zip(names, row, strict=True)) for row in rows])


def _in_ledger(summary: Mapping[str, Any], run: Path) -> Iterator[str]:
    ledger = read_ledger(run / LEDGER)
    for key in sorted(summary.keys() & ledger.keys() & FROM_LEDGER):
        said = summary[key]
        if key == "unjudged":
            said = [each for each in said if not _is_of_the_summary(each, ledger)]
        if not _same(said, ledger[key]):
            yield f"{key}: not those of {LEDGER}"


def _is_of_the_summary(row: Mapping[str, Any], ledger: Mapping[str, Any]) -> bool:
    """Whether a row is on a base loss of which the ledger says nothing: the summary alone has such."""
    told = {each["name"] for each in (*ledger["checks"], *ledger["unjudged"])}
    return row["name"] not in told and row["name"].split(": ")[-1] == BASE_LOSS


def _same(one: Any, other: Any) -> bool:
    """Whether two values are the same in JSON, where nan is nan."""
    if isinstance(one, dict) and isinstance(other, dict):
        return one.keys() == other.keys() and all(_same(one[key], other[key]) for key in one)
    if isinstance(one, list) and isinstance(other, list):
        return len(one) == len(other) and all(map(_same, one, other))
    return bool(one == other or (one != one and other != other)) and type(one) is type(other)


def _told(key: str, said: object, found: object) -> str:
    one, other = ("nothing" if each is None else str(each)[:SHOWN] for each in (said, found))
    return f"{key} is {one}, that of the record {other}"
