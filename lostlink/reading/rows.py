"""The table of deliveries with names as places: what counts, series and ages of links are computed from."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from bridge.bus.keys import ALL
from bridge.record.tables.schema import DELIVERIES
from lostlink.reading.coded import coded_columns

DELIVERED: Final = "delivered"
Columns = dict[str, NDArray[Any]]


@dataclass(frozen=True)
class LinkRows:
    """Rows of the table, in its order; those for everybody come last, once per receiver.

    Attributes:
        nodes: ids of all nodes; ``tx`` and ``rx`` are places in it.
        fates: what became of packets, sorted, those that occur; ``fate`` is a place in it.
        columns: by name, of one length.
    """

    nodes: tuple[str, ...]
    fates: tuple[str, ...]
    columns: Columns

    @cached_property
    def link(self) -> NDArray[np.int64]:
        """The number of each row's directed link: ``tx * len(nodes) + rx``."""
        return self.columns["tx"] * len(self.nodes) + self.columns["rx"]

    @cached_property
    def links(self) -> NDArray[np.int64]:
        """Numbers of the links that occur, rising: by sender, then receiver."""
        return np.flatnonzero(np.bincount(self.link, minlength=len(self.nodes) ** 2))

    @cached_property
    def place(self) -> NDArray[np.intp]:
        """Where in `links` each row's link is."""
        places = np.zeros(len(self.nodes) ** 2, dtype=np.intp)
        places[self.links] = np.arange(len(self.links))
        return places[self.link]

    @property
    def is_delivered(self) -> NDArray[np.bool_]:
        """Which rows are of packets that arrived."""
        return self.has_fate(DELIVERED)

    def has_fate(self, fate: str) -> NDArray[np.bool_]:
        """Which rows are of packets with a fate."""
        return np.equal(self.columns["fate"], self.fates.index(fate) if fate in self.fates else -1)

    def ends_of(self, links: NDArray[np.int64]) -> tuple[NDArray[Any], NDArray[Any]]:
        """Ids of sender and receiver of links by their numbers."""
        names = np.array(self.nodes, dtype=object)
        return names[links // len(self.nodes)], names[links % len(self.nodes)]

    def counts(self, place: NDArray[np.intp], groups: int) -> NDArray[np.int64]:
        """Packets by group and fate, shape (groups, fates); ``place`` is the group of each row."""
        cells = place * len(self.fates) + self.columns["fate"]
        packets = np.bincount(cells, self.columns["packets"], groups * len(self.fates))
        return np.rint(packets).astype(np.int64).reshape(groups, len(self.fates))

    def delivered(self, counts: NDArray[np.int64]) -> NDArray[np.int64]:
        """Of `counts`, those that arrived."""
        if DELIVERED not in self.fates:
            return np.zeros(len(counts), dtype=np.int64)
        return counts[:, self.fates.index(DELIVERED)]


def link_rows(run: Path, nodes: tuple[str, ...], names: tuple[str, ...]) -> LinkRows:
    """Some columns of the deliveries of a run, and ``tx``, ``rx``, ``packets`` and ``fate`` in any case.

    Args:
        run: the run directory.
        nodes: ids of all its nodes.
        names: of further columns.

    Raises:
        TableError, OSError: the deliveries cannot be read.
    """
    fates: list[str] = []
    labels = {"tx": nodes, "rx": (*nodes, ALL), "fate": fates}
    found = coded_columns(run, DELIVERIES, labels, ("tx", "rx", "packets", "fate", *names))
    for_all = np.flatnonzero(found["rx"] == len(nodes))
    if for_all.size:
        found = _spread(found, for_all, len(nodes))
    occur = np.bincount(found["fate"], minlength=len(fates)) > 0
    known = sorted(fate for fate, does in zip(fates, occur, strict=True) if does)
    place = np.array([known.index(fate) if fate in known else -1 for fate in fates], dtype=np.intp)
    return LinkRows(nodes, tuple(known), found | {"fate": place[found["fate"]]})


def _spread(columns: Columns, for_all: NDArray[np.intp], nodes: int) -> Columns:
    """Rows for everybody, once for each node but their sender."""
    rows, receivers = np.repeat(for_all, nodes), np.tile(np.arange(nodes), len(for_all))
    others = columns["tx"][rows] != receivers
    rows, receivers = rows[others], receivers[others]
    one = np.delete(np.arange(len(columns["tx"])), for_all)
    found = {name: np.concatenate([values[one], values[rows]]) for name, values in columns.items()}
    return found | {"rx": np.concatenate([columns["rx"][one], receivers])}
