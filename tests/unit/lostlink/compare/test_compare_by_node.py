"""Tables with a journal for each node: of a killed run each part is compared as far as it goes."""

from __future__ import annotations

from pathlib import Path

import pytest

from bridge.record.tables.every import finish_tables
from bridge.record.tables.states import STATES
from lostlink.compare.difference import Difference
from lostlink.compare.tables import compare_table
from tests.unit.bridge.record.tables.test_journals import NODES, write


def cut(run: Path, node: str, rows: float) -> None:
    """Take so many rows from the end of a node's journal."""
    path = STATES.journal_path(run, node)
    data = path.read_bytes()
    path.write_bytes(data[: len(data) - round(rows * STATES.dtype.itemsize)])


def compared(a: Path, b: Path, *, a_was_cut: bool) -> Difference | None:
    return compare_table(a, b, STATES, None, a_was_cut=a_was_cut, on_equal=lambda _: None)


@pytest.mark.parametrize("node", NODES)
def test_a_node_whose_part_ends_before_those_of_others_is_no_difference(tmp_path: Path, node: str) -> None:
    killed, whole, other = (tmp_path / name for name in ("killed", "whole", "other"))
    for run in (killed, whole, other):
        run.mkdir()
        write(run)
    cut(killed, node, 20.5)
    finish_tables(whole)
    assert compared(killed, whole, a_was_cut=True) is None
    assert compared(killed, whole, a_was_cut=False) is not None
    path = STATES.journal_path(other, node)
    data = bytearray(path.read_bytes())
    data[-25 * STATES.dtype.itemsize] ^= 1  # the first byte of a row, of its time
    path.write_bytes(data)
    found = compared(killed, other, a_was_cut=True)
    assert found is not None
    assert found.node == node
