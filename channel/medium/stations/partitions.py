"""Between which nodes no signal gets through, and when: a network in parts.

A screen stands between groups of nodes, as far as signals go: what one of a group transmits has no power at the nodes
of the others, neither as a frame nor as a carrier or interference. Nodes of no group are heard by all, and hear all.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from channel.medium.stations.tracks import FOREVER

NO_GROUP = -1


class Partition(NamedTuple):
    """Groups of nodes that do not hear each other for a while.

    Attributes:
        groups: names of the nodes of each; no node is in two.
        from_ns: the first instant, sim time.
        to_ns: the first instant at which they hear each other again; None: they do not.
    """

    groups: Sequence[Collection[str]]
    from_ns: int
    to_ns: int | None = None


class Partitions:
    """All partitions of a run, for some nodes by their places.

    Args:
        nodes: their names; groups may name others.
        partitions: two nodes are apart while any of these has them in different groups.
    """

    def __init__(self, nodes: Sequence[str], partitions: Iterable[Partition] = ()) -> None:
        self._spans = [
            (each.from_ns, FOREVER if each.to_ns is None else each.to_ns, _places(nodes, each.groups))
            for each in partitions
        ]

    @property
    def are_used(self) -> bool:
        """Return whether there is any."""
        return bool(self._spans)

    def between(
        self, tx: NDArray[np.intp], rx: NDArray[np.intp], sim_time_ns: NDArray[np.int64] | int
    ) -> NDArray[np.bool_]:
        """Return whether the two ends of links are apart, each at an instant of its own or all at one, shape (L,)."""
        apart = np.zeros(rx.shape, dtype=bool)
        for from_ns, to_ns, group in self._spans:
            here, there = group[tx], group[rx]
            differ = (here != there) & (here != NO_GROUP) & (there != NO_GROUP)
            apart |= differ & (sim_time_ns >= from_ns) & (sim_time_ns < to_ns)
        return apart

    def are_apart(self, node: int, other: int, sim_time_ns: int) -> bool:
        """Return whether two nodes are apart at an instant."""
        if not self._spans:
            return False
        return bool(self.between(np.array([node]), np.array([other]), sim_time_ns)[0])


def _places(nodes: Sequence[str], groups: Sequence[Collection[str]]) -> NDArray[np.intp]:
    """Return the place of each node's group, or `NO_GROUP`."""
    group_of = {name: place for place, names in enumerate(groups) for name in names}
    return np.array([group_of.get(node, NO_GROUP) for node in nodes], dtype=np.intp)
