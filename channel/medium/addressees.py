"""Who packets are for: the one place where `Packets.to` is resolved to receivers."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence, Set
from functools import cached_property
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from channel.checks import ChannelInputError
from channel.medium.links import Indices
from channel.medium.reception import EVERYBODY, Packets

NO_GROUPS: Mapping[str, Collection[str]] = MappingProxyType({})


def codes_of(nodes: Sequence[str], groups: Iterable[str] = ()) -> dict[str, int]:
    """`Packets.to` by name: of a node its place, of a group what comes below EVERYBODY."""
    return {name: place for place, name in enumerate(nodes)} | {
        name: EVERYBODY - 1 - place for place, name in enumerate(groups)
    }


class Addressees:
    """Nodes and groups of one medium. A sender may be in a group that it sends to; it does not hear itself.

    Args:
        nodes: names of all nodes.
        groups: names of the members of each group.

    Attributes:
        codes: `Packets.to` of each node and group, by name.
        nodes: names of all nodes.
        groups: names of the groups.

    Raises:
        ChannelInputError: a group has the name of a node, or a member that is none.
    """

    def __init__(self, nodes: Sequence[str], groups: Mapping[str, Collection[str]] = NO_GROUPS) -> None:
        index = {node: place for place, node in enumerate(nodes)}
        self.nodes, self.groups = tuple(nodes), tuple(groups)
        self._members = np.zeros((len(self.groups) + 1, len(nodes)), dtype=bool)
        self._members[0] = True
        for row, (name, members) in enumerate(groups.items(), start=1):
            if name in index:
                raise ChannelInputError("groups", name, "a name that no node has")
            for member in members:
                if member not in index:
                    raise ChannelInputError(f"groups: {name}", member, f"one of {', '.join(nodes)}")
                self._members[row, index[member]] = True
        self.codes = codes_of(nodes, self.groups)
        self._places = [frozenset(np.flatnonzero(row).tolist()) for row in self._members]

    @cached_property
    def _others(self) -> Indices:
        """All but each node, shape (nodes, nodes - 1)."""
        count = self._members.shape[1]
        nodes = np.arange(max(count - 1, 0))
        return nodes + (nodes >= np.arange(count)[:, np.newaxis])

    def members(self, to: int) -> frozenset[int] | None:
        """The nodes of a group by its code; None: it is of a node, or of everybody."""
        return None if to >= EVERYBODY else self._places[-1 - to]

    def receivers(self, tx: int, to: int) -> set[int]:
        """The nodes that a packet is for."""
        return {to} if to >= 0 else {*self._places[-1 - to]} - {tx}

    def code_of(self, tx: int, receivers: Set[int]) -> int:
        """A code with just these receivers, those of everybody and of groups in their order; EVERYBODY if none has."""
        codes = (EVERYBODY - row for row in range(len(self._places)))
        return next((code for code in codes if self.receivers(tx, code) == receivers), EVERYBODY)

    def count(self, packets: Packets) -> NDArray[np.int64]:
        """How many nodes each packet is for."""
        rows = np.maximum(-1 - packets.to, 0)
        many = self._members.sum(axis=1)[rows] - self._members[rows, packets.tx]
        return np.where(packets.to >= 0, 1, many)

    def links(self, packets: Packets) -> tuple[Indices, Indices]:
        """The row of the packet and the receiver of each link, by packet, then by receiver."""
        rows, to = np.arange(packets.size), packets.to
        if not np.count_nonzero(to != EVERYBODY):
            return rows.repeat(self._others.shape[1]), self._others[packets.tx].reshape(-1)
        one = to >= 0
        if np.count_nonzero(one) == packets.size:
            return rows, to
        is_for = self._members[np.maximum(-1 - to, 0)]
        is_for[one] = False
        is_for[rows, packets.tx] = False
        is_for[rows[one], to[one]] = True
        row, rx = np.nonzero(is_for)
        return row, rx
