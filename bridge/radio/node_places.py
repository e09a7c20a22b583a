"""Places of nodes: columns name a node by its place among all of the run, a network's medium by that among its own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from channel.medium.reception import EVERYBODY, Packets, Receptions


class NodePlaces:
    """Where the nodes of a network are among all.

    Args:
        members: ids of its nodes.
        nodes: ids of all nodes of the run.

    Attributes:
        are_same: whether all nodes are on the network, in their order.
        of_all: place among all of each of its nodes, in the order of these.
        index: the same, by id.
    """

    def __init__(self, members: Sequence[str], nodes: Sequence[str]) -> None:
        everybody = {node: place for place, node in enumerate(nodes)}
        self.index = {node: everybody[node] for node in members}
        self.of_all = np.array([*self.index.values()], dtype=np.intp)
        self.are_same = tuple(members) == tuple(nodes)
        self._of_members = np.full(len(nodes), EVERYBODY, dtype=np.intp)
        self._of_members[self.of_all] = np.arange(self.of_all.size)

    def on_the_network(self, packets: Packets) -> Packets:
        """Packets of its nodes, as its medium has them; codes of groups are the same."""
        if self.are_same:
            return packets
        to = np.where(packets.to < 0, packets.to, self._of_members[np.maximum(packets.to, 0)])
        return packets._replace(tx=self._of_members[packets.tx], to=to)

    def among_all(self, receptions: Receptions) -> Receptions:
        """Receptions of its medium, as the run has them."""
        if self.are_same:
            return receptions
        packets, places = receptions.packets, self.of_all
        to = np.where(packets.to < 0, packets.to, places[np.maximum(packets.to, 0)])
        packets = packets._replace(tx=places[packets.tx], to=to)
        return replace(receptions, packets=packets, rx=places[receptions.rx])
