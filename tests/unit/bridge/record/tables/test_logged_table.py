"""What agents logged as a table: Parquet at the end of a run, and CSV."""

from __future__ import annotations

import csv
import math
from pathlib import Path

import pandas as pd
import pyarrow.parquet as pq
from click.testing import CliRunner

from bridge.bus.messages import AgentStatus
from bridge.record import names
from bridge.record.digests import digests
from bridge.record.logged import LoggedValue, encode_logged
from bridge.record.streams import Entry
from bridge.record.tables.logged import LOGGED_FILE, LoggedRow
from bridge.record.tables.truth import TRUTH
from lostlink.cli.records.export import export
from tests.unit.bridge.record.runs import RunContent, make_run

SAID = {
    "0": [
        (5, LoggedValue("gap_m", 1.5)),
        (9, LoggedValue("plan", {"to_m": [3, 4.5], "why": "lost, again"})),
        (9, LoggedValue("heard", {"from": 2})),
        (9, LoggedValue("plan", {"to_m": [], "why": ""})),
        (9, LoggedValue("plan", {})),
        (11, LoggedValue("plan", {"why": "found"})),
    ],
    "1": [
        (5, AgentStatus(activity="climbs")),
        (7, LoggedValue("near", True)),
        (9, LoggedValue("bad", math.nan)),
        (9, LoggedValue("bad", "")),
        (9, LoggedValue("bad", [])),
    ],
}
ROWS = [
    LoggedRow(5, "0", "gap_m", 0, "", "number", 1.5, ""),
    LoggedRow(7, "1", "near", 0, "", "bool", 1.0, ""),
    LoggedRow(9, "0", "plan", 0, "to_m.0", "number", 3.0, ""),
    LoggedRow(9, "0", "plan", 0, "to_m.1", "number", 4.5, ""),
    LoggedRow(9, "0", "plan", 0, "why", "text", math.nan, "lost, again"),
    LoggedRow(9, "0", "heard", 0, "from", "number", 2.0, ""),
    LoggedRow(9, "0", "plan", 1, "to_m", "vector", math.nan, ""),
    LoggedRow(9, "0", "plan", 1, "why", "text", math.nan, ""),
    LoggedRow(9, "0", "plan", 2, "", "mapping", math.nan, ""),
    LoggedRow(9, "1", "bad", 0, "", "number", math.nan, ""),
    LoggedRow(9, "1", "bad", 1, "", "text", math.nan, ""),
    LoggedRow(9, "1", "bad", 2, "", "vector", math.nan, ""),
    LoggedRow(11, "0", "plan", 0, "why", "text", math.nan, "found"),
]


def log(made: RunContent) -> None:
    for node, said in SAID.items():
        made.streams[names.logged(node)] = [Entry(tick_ns, encode_logged(item)) for tick_ns, item in said]


def test_a_run_that_is_over_has_what_agents_logged_as_parquet(tmp_path: Path) -> None:
    run = make_run(tmp_path / "run", log)
    found = [tuple(row.values()) for row in pq.read_table(run / LOGGED_FILE).to_pylist()]
    assert list(map(repr, found)) == [repr(tuple(row)) for row in ROWS]
    assert (
        pq.read_schema(run / LOGGED_FILE).field("node").type
        == pq.read_schema(TRUTH.parquet_path(run)).field("node").type
    )
    assert "logged" not in digests(run)
    assert not (make_run(tmp_path / "other") / LOGGED_FILE).exists()


def test_csv_has_the_same_of_a_killed_run_too(tmp_path: Path) -> None:
    run = make_run(tmp_path / "run", log, is_finished=False)
    done = CliRunner().invoke(export, [str(run), "--csv"])
    assert done.output.split()[-1] == str(run / "logged.csv")
    with (run / "logged.csv").open(newline="") as file:
        header, *rows = csv.reader(file)
    assert tuple(header) == LoggedRow._fields
    assert rows == [[str(cell) for cell in row] for row in ROWS]


def test_what_was_logged_can_be_put_together_again_from_the_table(tmp_path: Path) -> None:
    """By node, tick, name and number: as many values as there were, also of one name at one tick."""
    run = make_run(tmp_path / "run", log)
    rows = pd.read_parquet(run / LOGGED_FILE)
    found = rows.groupby(["tick_ns", "node", "name", "number"], observed=True).size()
    logged = [(t, node, item) for node, said in SAID.items() for t, item in said]
    assert len(found) == sum(isinstance(item, LoggedValue) for *_, item in logged)
    wide = rows[rows.kind.isin(["number", "bool"])].pivot(
        index=["tick_ns", "node", "name", "number"], columns="key", values="value"
    )
    assert wide.loc[(9, "0", "plan", 0), ["to_m.0", "to_m.1"]].tolist() == [3.0, 4.5]
