"""How rows of deliveries are written and read."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.record.bench_record import Columns, fleet_columns
from bridge.bus.keys import ALL
from bridge.record.tables.deliveries import DELIVERIES, FATES, WORDS, DeliveryWriter, Vocabulary
from bridge.record.tables.reader import read_columns
from bridge.record.tables.schema import Table

__all__ = ["Columns", "assert_same", "fleet_columns", "joined", "read", "write_deliveries"]


def write_deliveries(run: Path, ticks: list[Columns], nodes: int) -> None:
    run.mkdir(parents=True, exist_ok=True)
    writer = DeliveryWriter(run, [str(node) for node in range(nodes)])
    for columns in ticks:
        writer.append(len(columns["tx"]), **columns)
    writer.close()


def joined(ticks: list[Columns]) -> Columns:
    """All rows, with names as text."""
    whole = {name: np.concatenate([tick[name] for tick in ticks]) for name in ticks[0]}
    fates = np.array(FATES, dtype=object)
    texts = {name: whole[name].astype(str).astype(object) for name in ("tx", "rx")}
    firsts = {"radio": "main", "channel": "", "encoding": ""}
    texts |= {name: np.full(len(whole["tx"]), firsts[name], dtype=object) for name in WORDS}
    return whole | texts | {"fate": fates[whole["fate"]]}


def read(run: Path, table: Table = DELIVERIES) -> Columns:
    return read_columns(run, table)


def assert_same(found: Columns, expected: Columns) -> None:
    assert found.keys() == expected.keys()
    for name, values in expected.items():
        assert len(found[name]) == len(values), name
        kind = values.dtype.kind
        same = (
            np.array_equal(found[name], values, equal_nan=True)
            if kind == "f"
            else (found[name] == values).all()
        )
        assert same, name


@dataclass(frozen=True, slots=True)
class DeliveryRow:
    """One row of `deliveries`."""

    sim_time_ns: int
    tx: str
    rx: str
    seq: int
    length_bytes: int
    distance_m: float
    received_power_dbm: float
    snr_db: float
    per: float
    fate: str
    packets: int = 1
    radio: str = "main"
    channel: str = "team"
    encoding: str = ""
    received_ns: int = 0


def append_rows(
    writer: DeliveryWriter, nodes: Sequence[str], rows: Sequence[DeliveryRow], words: Vocabulary
) -> None:
    """Append rows by their names; ``words`` are the writer's."""
    if not rows:
        return
    columns: dict[str, Any] = {name: [getattr(row, name) for row in rows] for name in DeliveryRow.__slots__}
    for end in ("tx", "rx"):
        columns[end] = [(*nodes, ALL).index(node) for node in columns[end]]
    columns["fate"] = [FATES.index(fate) for fate in columns["fate"]]
    writer.append(len(rows), **columns | {name: words.places(name, columns[name]) for name in WORDS})
