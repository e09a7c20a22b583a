"""What the radio of a recorded run decided: the rows of `deliveries` as arrays, and the tick that settled each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bridge.radio.picture import Picture
from bridge.record.tables.deliveries import (
    DELIVERIES,
    FATES,
    GAPS_FROM,
    for_each_receiver,
    no_deliveries,
    read_deliveries,
    settled_ns,
)
from bridge.record.tables.schema import Columns
from channel.medium.ledger import Ledger


@dataclass(frozen=True, slots=True)
class Decisions:
    """Rows of `deliveries`, in its order.

    Attributes:
        nodes: ids of all stations.
        columns: as docs/run-output.md has them; ``tx`` and ``rx`` are places in ``nodes``, ``rx`` of a row for all
            is ``len(nodes)``, and ``fate`` is a place in `bridge.record.tables.deliveries.FATES`.
        settled_ns: the tick that settled each row, rising.
    """

    nodes: tuple[str, ...]
    columns: Columns
    settled_ns: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.settled_ns)

    @property
    def is_gap(self) -> NDArray[np.bool_]:
        """Which rows stand for packets that were lost before the channel."""
        return self.columns["fate"] >= GAPS_FROM

    @classmethod
    def read(cls, run: Path, nodes: Sequence[str], tick_period_ns: int) -> Decisions:
        """Of the run in ``run``; no rows if it was killed before its radio began to write.

        Raises:
            TableError, OSError: its deliveries are damaged, or cannot be read.
        """
        columns = read_deliveries(run, nodes) if DELIVERIES.is_in(run) else no_deliveries()
        # a packet of a free program may wait for its truth, or come late: none was settled before the row before
        return cls(tuple(nodes), columns, np.maximum.accumulate(settled_ns(columns, tick_period_ns)))

    @classmethod
    def of(
        cls, nodes: Sequence[str], columns: Columns, tick_period_ns: int, order_of: Decisions
    ) -> Decisions:
        """Rows in any order, put into that of a record: the one of a run with the same rows, or that of a radio."""
        found = cls(tuple(nodes), columns, settled_ns(columns, tick_period_ns))
        keys, known = found.keys(), order_of.keys()
        mine, theirs = np.argsort(keys, kind="stable"), np.argsort(known, kind="stable")
        if np.array_equal(keys[mine], known[theirs]):
            order = np.empty_like(mine)
            order[theirs] = mine
        else:
            c = columns
            order = np.lexsort((c["rx"], c["seq"], c["tx"], c["sim_time_ns"], found.is_gap, found.settled_ns))
        found = found.at(order)
        return cls(found.nodes, found.columns, np.maximum.accumulate(found.settled_ns))

    def at(self, rows: NDArray[Any] | slice) -> Decisions:
        """Some of the rows."""
        columns = {name: values[rows] for name, values in self.columns.items()}
        return Decisions(self.nodes, columns, self.settled_ns[rows])

    def keys(self) -> NDArray[np.int64]:
        """A number of each row: that of its packet and its receiver."""
        c, nodes = self.columns, len(self.nodes)
        found: NDArray[np.int64] = (c["seq"] * nodes + c["tx"]) * (nodes + 1) + c["rx"]
        return found

    def sorted(self) -> Decisions:
        """The rows in the order of their keys."""
        return self.at(np.argsort(self.keys(), kind="stable"))

    def each(self) -> Decisions:
        """The rows with one for each receiver in the place of one for everybody."""
        whole = for_each_receiver(self.columns | {"settled_ns": self.settled_ns}, len(self.nodes))
        settled = whole.pop("settled_ns")
        return Decisions(self.nodes, whole, settled)

    def counts(self) -> NDArray[np.int64]:
        """How many packets of each link had each fate, shape (nodes, nodes, FATES): [tx, rx, fate]."""
        nodes, c = len(self.nodes), self.each().columns
        counts = np.zeros((nodes, nodes, len(FATES)), dtype=np.int64)
        np.add.at(counts, (c["tx"], c["rx"], c["fate"]), c["packets"])
        return counts


def take_rows(columns: Columns, picture: Picture, ledger: Ledger) -> None:
    """Take rows, one per receiver, into the picture of all links and into their counts, as a run does.

    What was lost before the channel counts, and is in no picture.
    """
    counted = columns["tx"], columns["rx"], columns["fate"]
    np.add.at(ledger.sent, counted[:2], columns["packets"])
    np.add.at(ledger.settled, counted, columns["packets"])
    settled = columns["fate"] < GAPS_FROM
    picture.take({name: values[settled] for name, values in columns.items()})
