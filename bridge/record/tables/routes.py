"""The table `routes`: by which nodes packets came, where nodes hand them on. Written by the radio of such networks."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np

from bridge.record.tables.journal import TableWriter
from bridge.record.tables.reader import no_rows, read_columns
from bridge.record.tables.schema import (
    COUNT,
    LABEL,
    NUMBER_MAX,
    TICK,
    TIME_MAX_NS,
    Column,
    Columns,
    Table,
)
from channel.network.network import RadioRoute

ROUTES: Final = Table(
    "routes",
    (
        Column("sim_time_ns", TICK, most=TIME_MAX_NS),
        Column("tx", LABEL),
        Column("rx", LABEL),
        Column("seq", TICK, most=NUMBER_MAX),
        Column("radio", LABEL),
        Column("arrived_ns", TICK),
        Column("hop", COUNT),
        Column("node", LABEL),
    ),
    keys=("sim_time_ns", "tx", "rx", "seq", "hop"),
    tick="sim_time_ns",
    node="tx",
)
"""A row per hop of the packets that came another way than the packet before on the same link: who transmitted it."""


class RouteWriter:
    """Writes routes as they change.

    Args:
        run: the run directory.
        nodes: ids of all nodes, which routes have the places of.
        radios: names of the radio networks.
    """

    def __init__(self, run: Path, nodes: Sequence[str], radios: Sequence[str]) -> None:
        self._radios = tuple(radios)
        self._writer = TableWriter(run, ROUTES, labels_of(nodes, radios))
        self.flush, self.close = self._writer.flush, self._writer.close

    def write(self, routes: Sequence[tuple[str, RadioRoute]]) -> None:
        """Append routes, each with the name of its network."""
        rows = [
            (r.sim_time_ns, r.tx, r.rx, r.number, self._radios.index(radio), r.arrived_ns, hop, node)
            for radio, r in routes
            for hop, node in enumerate(r.nodes, start=1)
        ]
        if rows:
            columns = zip(ROUTES.columns, zip(*rows, strict=True), strict=True)
            self._writer.append(
                len(rows), **{c.name: np.array(values, dtype=c.dtype) for c, values in columns}
            )


def labels_of(nodes: Sequence[str], radios: Sequence[str]) -> dict[str, Sequence[str]]:
    """The names that rows have places in."""
    return {"tx": tuple(nodes), "rx": tuple(nodes), "radio": tuple(radios), "node": tuple(nodes)}


def read_routes(run: Path, nodes: Sequence[str]) -> Columns:
    """All columns, nodes as their places and radios by name; no rows of a run whose nodes hand nothing on.

    Raises:
        TableError, OSError: the table is damaged, or cannot be read.
    """
    labels = {name: tuple(nodes) for name in ("tx", "rx", "node")}
    return read_columns(run, ROUTES, None, labels) if ROUTES.is_in(run) else no_rows(ROUTES, None, labels)
