"""The table of deliveries with names as places: what all that looks at packets of a run is computed from."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bridge.bus.keys import MAIN
from bridge.record.tables.deliveries import (
    DELIVERED,
    DELIVERIES,
    FATES,
    GAPS_FROM,
    WORDS,
    for_each_receiver,
    labels_of,
    no_deliveries,
    read_deliveries,
)
from bridge.record.tables.reader import joined, read_batches
from bridge.record.tables.schema import Columns
from channel.medium.reception import Fate

LINK = ("tx", "rx", "packets", "fate")
"""Columns that are there in any case."""
WRITTEN_BY = ("received_ns", "arrived_ns")
"""Columns by which a run puts its rows in order."""
RUN_ENDED = FATES.index(Fate.RUN_ENDED.value)


@dataclass(frozen=True)
class DeliveryRows:
    """Rows of `deliveries`, in its order. Links are computed from rows with one receiver each (`each`).

    Attributes:
        nodes: ids of all nodes; ``tx`` and ``rx`` are places in it, ``rx`` of a row for everybody is their number, and
            ``fate`` is a place in `bridge.record.tables.deliveries.FATES`.
        columns: by name, of one length.
    """

    nodes: tuple[str, ...]
    columns: Columns

    @classmethod
    def read(cls, run: Path, nodes: Sequence[str], names: Sequence[str] | None = None) -> DeliveryRows:
        """All columns but channel and encoding, or `LINK` and some; no rows if its radio had not begun to write.

        Raises:
            TableError, OSError: its deliveries are damaged, or cannot be read.
        """
        known = [column.name for column in DELIVERIES.columns if column.name not in WORDS]
        chosen = known if names is None else (*LINK, *names)
        is_there = DELIVERIES.is_in(run)
        return cls(tuple(nodes), read_deliveries(run, nodes, chosen) if is_there else no_deliveries(chosen))

    @classmethod
    def some_at_a_time(cls, run: Path, nodes: Sequence[str], names: Sequence[str]) -> Iterator[DeliveryRows]:
        """As `read`, in parts: a record of many UA is larger than memory."""
        if DELIVERIES.is_in(run):
            for columns in read_batches(run, DELIVERIES, (*LINK, *names), labels_of(nodes)):
                yield cls(tuple(nodes), columns)

    @classmethod
    def joined(cls, parts: Sequence[DeliveryRows]) -> DeliveryRows:
        """The rows of all parts, of which there is at least one, one part behind the other."""
        return cls(parts[0].nodes, joined([part.columns for part in parts]))

    def __len__(self) -> int:
        return len(self.columns["tx"])

    def at(self, rows: NDArray[Any] | slice) -> DeliveryRows:
        """Some of the rows."""
        return DeliveryRows(self.nodes, {name: values[rows] for name, values in self.columns.items()})

    def only(self, names: Sequence[str]) -> DeliveryRows:
        """The rows with these columns."""
        return DeliveryRows(self.nodes, {name: self.columns[name] for name in names})

    def each(self) -> DeliveryRows:
        """The rows with one for each receiver in the place of one for everybody."""
        return DeliveryRows(self.nodes, for_each_receiver(self.columns, len(self.nodes)))

    def sorted(self) -> DeliveryRows:
        """The rows in the order of their keys."""
        return self.at(np.argsort(self.keys(), kind="stable"))

    def in_order_of(self, record: DeliveryRows, network: NDArray[np.intp]) -> DeliveryRows:
        """The rows in the order of a record with the same ones, at the same instants; else as a run writes them.

        Args:
            record: with the columns of these.
            network: place of each row's radio network among those of the run.
        """
        keys, known = self.keys(), record.keys()
        mine, theirs = np.argsort(keys, kind="stable"), np.argsort(known, kind="stable")
        order = np.empty_like(mine)
        if np.array_equal(keys[mine], known[theirs]):
            order[theirs] = mine
            found = self.at(order)
            if all(np.array_equal(found.columns[name], record.columns[name]) for name in WRITTEN_BY):
                return found
        return self._as_written(network)

    def _as_written(self, network: NDArray[np.intp]) -> DeliveryRows:
        """Tick by tick of reception, what was lost before the channel last; of an instant, network by network.

        What the end of the run cut off comes after the last tick.
        """
        c, is_gap = self.columns, self.is_gap
        at_ns = np.where(is_gap, c["sim_time_ns"], c["arrived_ns"])
        of_network = np.where(is_gap, 0, network)
        is_cut = c["fate"] == RUN_ENDED
        keys = c["rx"], c["seq"], c["tx"], of_network, at_ns, is_gap, is_cut, c["received_ns"]
        return self.at(np.lexsort(keys))

    def keys(self) -> NDArray[np.int64]:
        """A number of each row: that of its packet and its receiver."""
        c, nodes = self.columns, len(self.nodes)
        found: NDArray[np.int64] = (c["seq"] * nodes + c["tx"]) * (nodes + 1) + c["rx"]
        return found

    @property
    def is_gap(self) -> NDArray[np.bool_]:
        """Which rows stand for packets that were lost before the channel."""
        return np.greater_equal(self.columns["fate"], GAPS_FROM)

    @property
    def is_delivered(self) -> NDArray[np.bool_]:
        """Which rows are of packets that arrived."""
        return np.equal(self.columns["fate"], DELIVERED)

    # Links.

    @cached_property
    def networks(self) -> tuple[str, ...]:
        """Names of the radio networks that have rows, `main` first; `main` alone of rows without ``radio``."""
        names = set(self.columns["radio"].tolist()) if "radio" in self.columns else {MAIN}
        return tuple(sorted(names, key=lambda name: (name != MAIN, name)))

    @cached_property
    def link(self) -> NDArray[np.int64]:
        """The number of each row's directed link, one for each radio network where rows have ``radio``."""
        c, nodes = self.columns, len(self.nodes)
        link: NDArray[np.int64] = c["tx"] * nodes + c["rx"]
        for number, name in enumerate(self.networks[1:], 1):
            link = link + (c["radio"] == name) * (number * nodes**2)
        return link

    @property
    def links_most(self) -> int:
        """How many links there can be: numbers of links are below this."""
        return max(1, len(self.networks)) * len(self.nodes) ** 2

    @cached_property
    def links(self) -> NDArray[np.int64]:
        """Numbers of the links that occur, rising: by network, then sender, then receiver."""
        return np.flatnonzero(np.bincount(self.link, minlength=self.links_most))

    @cached_property
    def place(self) -> NDArray[np.intp]:
        """Where in `links` each row's link is."""
        places = np.zeros(self.links_most, dtype=np.intp)
        places[self.links] = np.arange(len(self.links))
        return places[self.link]

    def ends_of(self, links: NDArray[np.int64]) -> tuple[NDArray[Any], NDArray[Any]]:
        """Ids of sender and receiver of links by their numbers."""
        names, nodes = np.array(self.nodes, dtype=object), len(self.nodes)
        return names[links // nodes % nodes], names[links % nodes]

    def radios_of(self, links: NDArray[np.int64]) -> NDArray[Any]:
        """Names of the radio networks of links by their numbers."""
        return np.array(self.networks, dtype=object)[links // len(self.nodes) ** 2]

    def named(self, links: NDArray[np.int64]) -> Columns:
        """What names links by their numbers: ``radio``, ``tx``, ``rx``."""
        tx, rx = self.ends_of(links)
        return {"radio": self.radios_of(links), "tx": tx, "rx": rx}

    def cells(self, place: NDArray[np.intp], groups: int) -> NDArray[np.int64]:
        """How many packets of each group had each fate, shape (groups, FATES).

        Args:
            place: the group of each row.
            groups: how many there are.
        """
        cells = place * len(FATES) + self.columns["fate"]
        packets = np.bincount(cells, self.columns["packets"], groups * len(FATES))
        return np.rint(packets).astype(np.int64).reshape(groups, len(FATES))

    def counts(self, place: NDArray[np.intp], groups: int) -> Columns:
        """As `cells`, by name: ``sent``, ``delivered``, and the causes of loss that occur anywhere, sorted."""
        counts = self.cells(place, groups)
        occur = np.bincount(self.columns["fate"], minlength=len(FATES)) > 0
        lost = {FATES[i]: counts[:, i] for i in np.flatnonzero(occur).tolist() if i != DELIVERED}
        return {"sent": counts.sum(axis=1), "delivered": counts[:, DELIVERED], **dict(sorted(lost.items()))}


def link_rows(run: Path, nodes: tuple[str, ...], names: tuple[str, ...]) -> DeliveryRows:
    """Rows with one receiver each, of a run that has to have some; `LINK` and the columns of these names.

    Raises:
        TableError, OSError: the deliveries are missing or damaged, or cannot be read.
    """
    return DeliveryRows(nodes, read_deliveries(run, nodes, (*LINK, *names))).each()
