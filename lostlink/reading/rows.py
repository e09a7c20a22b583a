"""The table of deliveries with names as places: what all that looks at packets of a run is computed from."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Protocol

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
Cells = NDArray[np.int64]
RUN_ENDED = FATES.index(Fate.RUN_ENDED.value)


@dataclass(frozen=True)
class DeliveryRows:
    """Rows of `deliveries`, in its order. Links are computed from rows with one receiver each (`each`).

    Attributes:
        nodes: ids of all nodes; ``tx`` and ``rx`` are places in it, ``rx`` of a row for everybody is their number, and
            ``fate`` is a place in `bridge.record.tables.deliveries.FATES`.
        columns: by name, of one length.
        networks: names of the radio networks that links are told apart by; of more than one the rows have ``radio``.
    """

    nodes: tuple[str, ...]
    columns: Columns
    networks: tuple[str, ...] = (MAIN,)

    @classmethod
    def read(cls, run: Path, nodes: Sequence[str]) -> DeliveryRows:
        """All columns but names (`WORDS`); no rows if its radio had not begun to write.

        Raises:
            TableError, OSError: its deliveries are damaged, or cannot be read.
        """
        known = [column.name for column in DELIVERIES.columns if column.name not in WORDS]
        is_there = DELIVERIES.is_in(run)
        return cls(tuple(nodes), read_deliveries(run, nodes, known) if is_there else no_deliveries(known))

    @classmethod
    def joined(cls, parts: Sequence[DeliveryRows]) -> DeliveryRows:
        """The rows of all parts, of which there is at least one, one part behind the other."""
        return replace(parts[0], columns=joined([part.columns for part in parts]))

    def __len__(self) -> int:
        return len(self.columns["tx"])

    def parts(self, *_names: str) -> Iterator[DeliveryRows]:
        """As of `Deliveries`: all of them at once."""
        yield self

    def at(self, rows: NDArray[Any] | slice) -> DeliveryRows:
        """Some of the rows."""
        return replace(self, columns={name: values[rows] for name, values in self.columns.items()})

    def only(self, names: Sequence[str]) -> DeliveryRows:
        """The rows with these columns."""
        return replace(self, columns={name: self.columns[name] for name in names})

    def each(self) -> DeliveryRows:
        """The rows with one for each receiver in the place of one for everybody."""
        return replace(self, columns=for_each_receiver(self.columns, len(self.nodes)))

    def order_of(self, record: DeliveryRows, network: NDArray[np.intp]) -> NDArray[np.intp]:
        """The order of a record with the same rows, at the same instants; else that in which a run writes them.

        Args:
            record: with the columns of these.
            network: place of each row's radio network among those of the run.
        """
        keys, known = self.keys(), record.keys()
        mine, theirs = np.argsort(keys, kind="stable"), np.argsort(known, kind="stable")
        order = np.empty_like(mine)
        if np.array_equal(keys[mine], known[theirs]):
            order[theirs] = mine
            if all(np.array_equal(self.columns[name][order], record.columns[name]) for name in WRITTEN_BY):
                return order
        return self._as_written(network)

    def _as_written(self, network: NDArray[np.intp]) -> NDArray[np.intp]:
        """Tick by tick of reception, what was lost before the channel last; of an instant, network by network.

        What the end of the run cut off comes after the last tick.
        """
        c, is_gap = self.columns, self.is_gap
        at_ns = np.where(is_gap, c["sim_time_ns"], c["arrived_ns"])
        of_network = np.where(is_gap, 0, network)
        is_cut = c["fate"] == RUN_ENDED
        keys = c["rx"], c["seq"], c["tx"], of_network, at_ns, is_gap, is_cut, c["received_ns"]
        return np.lexsort(keys)

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
    def link(self) -> NDArray[np.int64]:
        """The number of each row's directed link: ``(network * len(nodes) + tx) * len(nodes) + rx``."""
        c, nodes = self.columns, len(self.nodes)
        link: NDArray[np.int64] = c["tx"] * nodes + c["rx"]
        for number, name in enumerate(self.networks[1:], 1):
            link = link + (c["radio"] == name) * (number * nodes**2)
        return link

    def cells(self, place: NDArray[np.intp], groups: int) -> Cells:
        """How many packets of each group had each fate, shape (groups, FATES).

        Args:
            place: the group of each row.
            groups: how many there are.
        """
        found = np.zeros((groups, len(FATES)), dtype=np.int64)
        self.add_to(found, place)
        return found

    def add_to(self, cells: Cells, place: NDArray[np.intp]) -> None:
        """Add what `cells` gives to what other rows have given."""
        at = place * len(FATES) + self.columns["fate"]
        np.add.at(cells.reshape(-1), at, self.columns["packets"].astype(np.int64))


def most_links(deliveries: Deliveries) -> int:
    """How many links there can be: numbers of links are below this."""
    return len(deliveries.networks) * len(deliveries.nodes) ** 2


def named_links(links: NDArray[np.int64], deliveries: Deliveries) -> Columns:
    """What names links by their numbers: their radio network, sender and receiver, ``radio``, ``tx``, ``rx``."""
    names, nodes = np.array(deliveries.nodes, dtype=object), len(deliveries.nodes)
    networks = np.array(deliveries.networks, dtype=object)
    return {
        "radio": networks[links // nodes**2],
        "tx": names[links // nodes % nodes],
        "rx": names[links % nodes],
    }


def counts_by_name(cells: Cells) -> Columns:
    """By name: ``sent``, ``delivered``, and the causes of loss that occur anywhere, sorted. ``cells`` as of `cells`."""
    occur = np.flatnonzero(cells.any(axis=0)).tolist()
    lost = {FATES[i]: cells[:, i] for i in occur if i != DELIVERED}
    return {"sent": cells.sum(axis=1), "delivered": cells[:, DELIVERED], **dict(sorted(lost.items()))}


class Deliveries(Protocol):
    """Rows with one receiver each, in the order of `deliveries`; a record of many UA is larger than memory."""

    @property
    def nodes(self) -> tuple[str, ...]:
        """As of `DeliveryRows`."""

    @property
    def networks(self) -> tuple[str, ...]:
        """Likewise."""

    def parts(self, *names: str) -> Iterator[DeliveryRows]:
        """All rows, some at a time and as often as they are asked for, with at least `LINK` and these columns.

        Raises:
            TableError, OSError: the deliveries are missing or damaged, or cannot be read.
        """


@dataclass(frozen=True, slots=True)
class Chosen:
    """Some of the rows of others.

    Attributes:
        of_all: the others.
        is_meant: whether each of some rows is one of these.
        names: of the columns by which it goes, beside `LINK`.
    """

    of_all: Deliveries
    is_meant: Callable[[DeliveryRows], NDArray[np.bool_]]
    names: tuple[str, ...] = ()

    @property
    def nodes(self) -> tuple[str, ...]:
        """As of `Deliveries`."""
        return self.of_all.nodes

    @property
    def networks(self) -> tuple[str, ...]:
        """Likewise: all of them."""
        return self.of_all.networks

    def parts(self, *names: str) -> Iterator[DeliveryRows]:
        """As of `Deliveries`."""
        for rows in self.of_all.parts(*names, *self.names):
            yield rows.at(self.is_meant(rows))


def on_network(deliveries: Deliveries, network: str) -> Chosen:
    """Those that were sent on one radio network."""
    place, links = deliveries.networks.index(network), len(deliveries.nodes) ** 2
    return Chosen(deliveries, lambda rows: rows.link // links == place)


def link_rows(
    run: Path, nodes: tuple[str, ...], names: tuple[str, ...], networks: tuple[str, ...] = (MAIN,)
) -> DeliveryRows:
    """All rows of `RecordedDeliveries` at once.

    Raises:
        TableError, OSError: the deliveries are missing or damaged, or cannot be read.
    """
    return DeliveryRows(nodes, read_deliveries(run, nodes, _with_link(names, networks)), networks).each()


def _with_link(names: Sequence[str], networks: Sequence[str]) -> tuple[str, ...]:
    """Names of columns, with those by which links are told apart."""
    return tuple(dict.fromkeys((*LINK, *names, *(["radio"] if len(networks) > 1 else []))))


class RecordedDeliveries:
    """Those of a run: what it writes after they were first asked for is left out.

    Args:
        run: its directory.
        nodes: ids of all nodes.
        networks: names of the radio networks that links are told apart by.
        may_lack: whether there are no rows where its radio had not begun to write; else that is an error.
    """

    def __init__(
        self, run: Path, nodes: Sequence[str], networks: Sequence[str] = (MAIN,), *, may_lack: bool = False
    ) -> None:
        self.nodes, self.networks = tuple(nodes), tuple(networks)
        self._run, self._may_lack = run, may_lack

    @cached_property
    def _rows(self) -> int:
        if self._may_lack and not DELIVERIES.is_in(self._run):
            return 0
        return sum(len(each["packets"]) for each in read_batches(self._run, DELIVERIES, ("packets",)))

    def parts(self, *names: str) -> Iterator[DeliveryRows]:
        """As of `Deliveries`."""
        if left := self._rows:
            chosen = _with_link(names, self.networks)
            for columns in read_batches(self._run, DELIVERIES, chosen, labels_of(self.nodes)):
                part = DeliveryRows(self.nodes, columns, self.networks).at(slice(left))
                yield part.each()
                left -= len(part)
