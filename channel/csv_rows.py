"""Rows of a CSV file with headings."""

from __future__ import annotations

import csv
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence


def rows_with_headings(
    lines: Iterable[str], read: Iterable[str]
) -> tuple[Sequence[str], Iterator[tuple[int, dict[str, str | None]]]]:
    """Return the headings, and of each row the number of its line and its fields, stripped; None for what it lacks.

    Args:
        lines: of the file.
        read: columns that are read: each may be there once.

    Raises:
        csv.Error: no CSV, a column that is there twice or, from the rows, one with more fields than headings, as where
            numbers have decimal commas.
    """
    reader = csv.DictReader(lines, skipinitialspace=True)
    headings = [name.strip() for name in reader.fieldnames or ()]
    counts = Counter(headings)
    if twice := [name for name in read if counts[name] > 1]:
        raise csv.Error(f"it has {counts[twice[0]]} columns {twice[0]}")
    reader.fieldnames = headings
    return headings, _rows(reader, len(headings))


def _rows(reader: csv.DictReader[str], width: int) -> Iterator[tuple[int, dict[str, str | None]]]:
    for row in reader:
        more: Sequence[str] = row.pop(None, ())
        if any(map(str.strip, more)):
            raise csv.Error(f"line {reader.line_num} has {width + len(more)} fields under {width} headings")
        yield reader.line_num, {name: field and field.strip() for name, field in row.items()}
