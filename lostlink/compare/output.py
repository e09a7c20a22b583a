"""What `lostlink compare` and `lostlink refly` say of two runs, as text and as JSON."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from bridge.record.tables.every import TABLES
from lostlink.compare.difference import Comparison, Difference, seconds

SCHEMA = 1


def as_text(comparison: Comparison, run_a: Path, run_b: Path) -> str:
    """One line if the runs are identical, else the first difference with both values."""
    if comparison.difference is not None:
        return _difference_text(comparison.difference, run_a, run_b)
    tables = [table.name for table in TABLES if table.name in comparison.streams]
    streams = len(comparison.streams) - len(tables)
    parts = [*tables, *([f"{streams} streams"] if streams else [])]
    return f"identical: {', '.join(parts)}; {comparison.entries} entries, {comparison.ticks} ticks"


def _difference_text(found: Difference, run_a: Path, run_b: Path) -> str:
    node = f"node {found.node}, " if found.node else ""
    where = f"first difference at {seconds(found.tick_ns)} of sim time: {node}{found.stream}, {found.what}"
    return f"{where}\n  {run_a}: {found.a}\n  {run_b}: {found.b}"


def as_plain(comparison: Comparison) -> dict[str, Any]:
    """In plain types, for --json."""
    found = comparison.difference
    return {
        "schema": SCHEMA,
        "identical": found is None,
        "difference": None if found is None else found.as_dict(),
        "streams": list(comparison.streams),
        "entries": comparison.entries,
        "ticks": comparison.ticks,
    }
