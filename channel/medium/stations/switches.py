"""When each node's radio was switched off and on.

The medium has it, not the nodes: whether a packet leaves an antenna, and whether another antenna takes it, is asked of
both ends at the packet's own instant, as their places are. So an outage from a script, from an operator and from a
record is one and the same, and packets that wait for truth are settled by what held when they were sent.
"""

from __future__ import annotations

import bisect

import numpy as np
from numpy.typing import NDArray


class Switches:
    """The switches of a fixed number of nodes; each is on until it is switched off.

    Args:
        nodes: how many.
    """

    def __init__(self, nodes: int) -> None:
        self._nodes = nodes
        self._times: dict[int, list[int]] = {}
        self._on: dict[int, list[bool]] = {}

    def switch(self, node: int, sim_time_ns: int, *, on: bool) -> None:
        """Set a node's switch from an instant on, until the next one; of two at one instant the later call stands."""
        times = self._times.setdefault(node, [])
        place = bisect.bisect_right(times, sim_time_ns)
        times.insert(place, sim_time_ns)
        self._on.setdefault(node, []).insert(place, on)

    def is_off(self, node: int, sim_time_ns: int) -> bool:
        """Return whether a node is off at an instant."""
        place = bisect.bisect_right(self._times.get(node, ()), sim_time_ns)
        return place > 0 and not self._on[node][place - 1]

    def off_at(self, sim_time_ns: int) -> NDArray[np.bool_]:
        """Return which radios are off at an instant, shape (nodes,)."""
        every = np.arange(self._nodes)
        return self.off(every, np.full(self._nodes, sim_time_ns, dtype=np.int64))

    def off(self, node: NDArray[np.intp], sim_time_ns: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Return whether each of some nodes is off at an instant of its own; all of shape (L,)."""
        off = np.zeros(node.size, dtype=bool)
        for number, times in self._times.items():
            rows = np.flatnonzero(node == number)
            after = np.searchsorted(np.array(times, dtype=np.int64), sim_time_ns[rows], side="right")
            off[rows] = ~np.array([True, *self._on[number]])[after]
        return off

    @property
    def are_used(self) -> bool:
        """Return whether any was ever switched."""
        return bool(self._times)
