"""The table of deliveries with names as places: what counts, series and ages of links are computed from."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bridge.record.tables.deliveries import DELIVERED, FATES, for_each_receiver, read_deliveries
from bridge.record.tables.schema import Columns


@dataclass(frozen=True)
class LinkRows:
    """Rows of the table, in its order; those for everybody once per receiver.

    Attributes:
        nodes: ids of all nodes; ``tx`` and ``rx`` are places in it, ``fate`` is one in FATES.
        columns: by name, of one length.
    """

    nodes: tuple[str, ...]
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
        return np.equal(self.columns["fate"], DELIVERED)

    def ends_of(self, links: NDArray[np.int64]) -> tuple[NDArray[Any], NDArray[Any]]:
        """Ids of sender and receiver of links by their numbers."""
        names = np.array(self.nodes, dtype=object)
        return names[links // len(self.nodes)], names[links % len(self.nodes)]

    def counts(self, place: NDArray[np.intp], groups: int) -> Columns:
        """Packets of each group: ``sent``, ``delivered``, and by the causes of loss that occur anywhere, sorted.

        Args:
            place: the group of each row.
            groups: how many there are.
        """
        cells = place * len(FATES) + self.columns["fate"]
        packets = np.bincount(cells, self.columns["packets"], groups * len(FATES))
        counts = np.rint(packets).astype(np.int64).reshape(groups, len(FATES))
        occur = np.bincount(self.columns["fate"], minlength=len(FATES)) > 0
        lost = {FATES[i]: counts[:, i] for i in np.flatnonzero(occur).tolist() if i != DELIVERED}
        return {"sent": counts.sum(axis=1), "delivered": counts[:, DELIVERED], **dict(sorted(lost.items()))}


def link_rows(run: Path, nodes: tuple[str, ...], names: tuple[str, ...]) -> LinkRows:
    """Some columns of the deliveries of a run, and ``tx``, ``rx``, ``packets`` and ``fate`` in any case.

    Args:
        run: the run directory.
        nodes: ids of all its nodes.
        names: of further columns.

    Raises:
        TableError, OSError: the deliveries cannot be read.
    """
    found = read_deliveries(run, nodes, ("tx", "rx", "packets", "fate", *names))
    return LinkRows(nodes, for_each_receiver(found, len(nodes)))
