"""The medium: who receives which packet. Takes truth and packets with their sim time, gives fates; no I/O, no clock.

A packet waits until the truth at or after its instant is there for every node, so that its fate depends on the
seed, the positions and its sequence number alone: not on the order of arrival, nor on who else flies.
"""

from __future__ import annotations

import heapq
import operator
from collections.abc import Iterable
from typing import Any

from numpy.typing import ArrayLike

from channel.checks import ChannelInputError
from channel.draws import MAX_SEQ, Draws, check_seed
from channel.medium.reception import Fate, Packet, Reception
from channel.medium.settling import Settling
from channel.medium.tracks import Tracks, truth_row

__all__ = ["Fate", "Medium", "Reception"]

MAX_TRUTH_AGE_NS = 1_000_000_000
MAX_LENGTH_BYTES = 1 << 24


class Medium:
    """One radio channel shared by a fixed set of nodes.

    Args:
        radio: the same at every node.
        seed: the run's seed.
        nodes: names of all nodes; every other node is an intended receiver of each packet.
        max_truth_age_ns: how far a node's truth may lag behind the newest before it is used as it is.
    """

    def __init__(
        self, radio: Any, *, seed: int, nodes: Iterable[str], max_truth_age_ns: int = MAX_TRUTH_AGE_NS
    ) -> None:
        radio = next(iter(radio.values())) if isinstance(radio, dict) else radio
        self.radio = radio
        self.nodes = tuple(nodes)
        if len(set(self.nodes)) != len(self.nodes):
            raise ChannelInputError("nodes", self.nodes, "names that differ")
        self.draws = Draws(check_seed(seed))
        self._tracks = Tracks(self.nodes, max_truth_age_ns)
        self._settling = Settling(radio, self.draws, self.nodes, self._tracks)
        self._waiting: list[Packet] = []
        self._out: list[Reception] = []

    @property
    def in_flight(self) -> int:
        """How many fates are still open: packets that wait for truth, times their receivers."""
        return len(self._waiting) * (len(self.nodes) - 1)

    def observe(
        self,
        node: str,
        sim_time_ns: int,
        position_ned_m: ArrayLike,
        attitude_wxyz: ArrayLike | None = None,
    ) -> list[Reception]:
        """Take in where a node was, in the frame common to all; return the fates that this settles.

        How fast it was follows from this and the position before it.

        Raises:
            ChannelInputError: an unknown node, a value that is not finite or a time that is not whole.
        """
        row = truth_row(position_ned_m, attitude_wxyz)
        when_ns = sim_time_ns if type(sim_time_ns) is int else _whole("sim_time_ns", sim_time_ns)
        moved = self._tracks.observe(self._index("node", node), when_ns, row)
        if moved:
            self._out += self._settle()
        return []

    def place(
        self, node: str, position_ned_m: ArrayLike, attitude_wxyz: ArrayLike | None = None
    ) -> list[Reception]:
        """Put a node where it stays for the whole run (a ground station): no packet waits for its truth."""
        moved = self._tracks.place(self._index("node", node), truth_row(position_ned_m, attitude_wxyz))
        return self._settle() if moved else []

    def transmit(self, tx: str, seq: int, sim_time_ns: int, length_bytes: int) -> list[Reception]:
        """Send a packet to every other node; return the fates that are settled by now, its own or none.

        Args:
            tx: transmitting node.
            seq: its sequence number; the same number on the same link always draws the same fate.
            sim_time_ns: when it was sent.
            length_bytes: of the payload; the radio says what it counts as.

        Raises:
            ChannelInputError: an unknown node, a negative sequence number or length, or a number that is not whole.
        """
        if not (type(seq) is type(sim_time_ns) is type(length_bytes) is int):
            seq, sim_time_ns = _whole("seq", seq), _whole("sim_time_ns", sim_time_ns)
            length_bytes = _whole("length_bytes", length_bytes)
        if not 0 <= seq <= MAX_SEQ:
            raise ChannelInputError("seq", seq, f"an integer from 0 to {MAX_SEQ}")
        if not 0 <= length_bytes <= MAX_LENGTH_BYTES:
            raise ChannelInputError("length_bytes", length_bytes, f"0 to {MAX_LENGTH_BYTES}")
        packet = Packet(sim_time_ns, self._index("tx", tx), seq, self.radio.length_bytes(length_bytes))
        if sim_time_ns <= self._tracks.frontier_ns:
            return self._settling.receptions(packet)
        heapq.heappush(self._waiting, packet)
        return []

    def send(self, packets: Any) -> None:
        self._lengths = getattr(self, "_lengths", {})
        for t, tx, seq, n, _ in zip(*(c.tolist() for c in packets), strict=True):
            self._lengths[tx, seq] = n
            self._out += self.transmit(self.nodes[tx], seq, t, n)

    def settle(self) -> Any:
        import numpy as np

        from channel.medium.packets import Packets, Receptions
        from channel.medium.reception import FATES

        out, self._out = self._out, []
        index = {n: i for i, n in enumerate(self.nodes)}
        keys = list(dict.fromkeys((r.sim_time_ns, index[r.tx], r.seq) for r in out))
        row = {k: i for i, k in enumerate(keys)}
        cols = list(zip(*keys, strict=True)) or [(), (), ()]
        packets = Packets(
            *(np.array(c, dtype=np.int64) for c in cols),
            np.array([self._lengths.pop((k[1], k[2])) for k in keys], dtype=np.int64),
            np.full(len(keys), -1),
        )
        f = lambda g, d=float: np.array([g(r) for r in out], dtype=d)
        return Receptions(
            packets,
            f(lambda r: row[r.sim_time_ns, index[r.tx], r.seq], int),
            f(lambda r: index[r.rx], int),
            f(lambda r: r.distance_m),
            f(lambda r: r.received_power_dbm),
            f(lambda r: r.snr_db),
            f(lambda r: r.per),
            f(lambda r: r.probability_of_delivery),
            f(lambda r: FATES.index(r.fate), np.uint8),
        )

    def flush(self) -> Any:
        self._out += self._settle(everything=True)
        return self.settle()

    def _index(self, name: str, node: str) -> int:
        try:
            return self._tracks.index[node]
        except KeyError:
            raise ChannelInputError(name, node, f"one of {', '.join(self.nodes)}") from None

    def _settle(self, *, everything: bool = False) -> list[Reception]:
        settled: list[Reception] = []
        while self._waiting and (everything or self._waiting[0].sim_time_ns <= self._tracks.frontier_ns):
            settled += self._settling.receptions(heapq.heappop(self._waiting))
        return settled


def _whole(name: str, value: int) -> int:
    """Return numpy's integers, too, as Python's; a float would not name an instant or a packet."""
    try:
        return operator.index(value)
    except TypeError as error:
        raise ChannelInputError(name, value, "an integer") from error
