"""The medium: who receives which packet. Takes truth and packets with their sim time, gives fates; no I/O, no clock.

A packet waits until the truth at or after its instant is there for every node, so that its fate depends on the
seed, the positions and its sequence number alone: not on the order of arrival, nor on who else flies.
"""

from __future__ import annotations

import heapq
from collections.abc import Iterable
from enum import Enum
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from channel.checks import ChannelInputError, FloatArray
from channel.erasure import MAX_SEQ, Draws, Purpose, check_seed
from channel.radio import Radio, separation_m
from channel.shadowing import standard_normal_from_uniform
from channel.tracks import POSITION, Tracks, truth_row

MAX_TRUTH_AGE_NS = 1_000_000_000
MAX_LENGTH_BYTES = 1 << 24


class Fate(Enum):
    """What became of a packet at one receiver: delivered, or the cause of its loss."""

    DELIVERED = "delivered"
    CHANNEL_ERASURE = "channel_erasure"
    OUT_OF_RANGE = "out_of_range"
    BASE_LOSS = "base_loss"
    NO_POSITION = "no_position"


class Reception(NamedTuple):
    """One packet at one receiver.

    Attributes:
        sim_time_ns: when it was transmitted.
        tx: transmitting node.
        rx: intended receiver.
        seq: the transmitter's sequence number.
        length_bytes: as the error model counted it.
        distance_m: between the two at that instant; NaN with `Fate.NO_POSITION`, as are the next three.
        received_power_dbm: with the drawn shadowing.
        snr_db: with the drawn shadowing.
        per: packet error rate at that SNR; 1 out of range.
        fate: delivered, or the cause of the loss.
        probability_of_delivery: what the model says for this geometry, averaged over the random terms.
    """

    sim_time_ns: int
    tx: str
    rx: str
    seq: int
    length_bytes: int
    distance_m: float
    received_power_dbm: float
    snr_db: float
    per: float
    fate: Fate
    probability_of_delivery: float


class _Packet(NamedTuple):
    """Ordered by time, then transmitter, then sequence number: the order in which packets settle."""

    sim_time_ns: int
    tx: int
    seq: int
    length_bytes: int


class Medium:
    """One radio channel shared by a fixed set of nodes.

    Args:
        radio: the same at every node.
        seed: the run's seed.
        nodes: names of all nodes; every other node is an intended receiver of each packet.
        max_truth_age_ns: how far a node's truth may lag behind the newest before it is used as it is.
    """

    def __init__(
        self, radio: Radio, *, seed: int, nodes: Iterable[str], max_truth_age_ns: int = MAX_TRUTH_AGE_NS
    ) -> None:
        self.radio = radio
        self.nodes = tuple(nodes)
        if len(set(self.nodes)) != len(self.nodes):
            raise ChannelInputError("nodes", self.nodes, "names that differ")
        self.draws = Draws(check_seed(seed))
        self._tracks = Tracks(self.nodes, max_truth_age_ns)
        self._waiting: list[_Packet] = []
        self._others = [
            (tuple(n for n in self.nodes if n != node), np.arange(len(self.nodes)) != i)
            for i, node in enumerate(self.nodes)
        ]

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
        velocity_ned_mps: ArrayLike | None = None,
    ) -> list[Reception]:
        """Take in where a node was, in the frame common to all; return the fates that this settles.

        Raises:
            ChannelInputError: an unknown node or a value that is not finite.
        """
        row = truth_row(position_ned_m, attitude_wxyz, velocity_ned_mps)
        moved = self._tracks.observe(self._index("node", node), sim_time_ns, row)
        return self._settle() if moved else []

    def place(
        self, node: str, position_ned_m: ArrayLike, attitude_wxyz: ArrayLike | None = None
    ) -> list[Reception]:
        """Put a node where it stays for the whole run (a ground station): no packet waits for its truth."""
        moved = self._tracks.place(self._index("node", node), truth_row(position_ned_m, attitude_wxyz, None))
        return self._settle() if moved else []

    def transmit(self, tx: str, seq: int, sim_time_ns: int, length_bytes: int) -> list[Reception]:
        """Send a packet to every other node; return the fates that are settled by now, its own or none.

        Args:
            tx: transmitting node.
            seq: its sequence number; the same number on the same link always draws the same fate.
            sim_time_ns: when it was sent.
            length_bytes: of the payload; the radio says what it counts as.

        Raises:
            ChannelInputError: an unknown node, a negative sequence number or length.
        """
        if not 0 <= seq <= MAX_SEQ:
            raise ChannelInputError("seq", seq, f"an integer from 0 to {MAX_SEQ}")
        if not 0 <= length_bytes <= MAX_LENGTH_BYTES:
            raise ChannelInputError("length_bytes", length_bytes, f"0 to {MAX_LENGTH_BYTES}")
        packet = _Packet(sim_time_ns, self._index("tx", tx), seq, self.radio.length_bytes(length_bytes))
        if sim_time_ns <= self._tracks.frontier_ns:
            return self._receptions(packet)
        heapq.heappush(self._waiting, packet)
        return []

    def flush(self) -> list[Reception]:
        """Settle everything that still waits, with the newest positions there are."""
        return self._settle(everything=True)

    def _index(self, name: str, node: str) -> int:
        try:
            return self._tracks.index[node]
        except KeyError:
            raise ChannelInputError(name, node, f"one of {', '.join(self.nodes)}") from None

    def _settle(self, *, everything: bool = False) -> list[Reception]:
        settled: list[Reception] = []
        while self._waiting and (everything or self._waiting[0].sim_time_ns <= self._tracks.frontier_ns):
            settled += self._receptions(heapq.heappop(self._waiting))
        return settled

    def _receptions(self, packet: _Packet) -> list[Reception]:
        """Draw the fates of one packet at all its receivers."""
        rows = self._tracks.rows_at(packet.sim_time_ns)
        receivers, others = self._others[packet.tx]
        tx = self.nodes[packet.tx]
        if not receivers:
            return []
        here, there = rows[packet.tx, POSITION], rows[others, POSITION]
        distance_m = separation_m(here, there)
        mean_dbm = self.radio.mean_power_dbm(self.radio.path_of(here, there, distance_m))
        power_dbm = mean_dbm - self._shadowing_db(tx, receivers, packet.seq)
        snr_db = power_dbm - self.radio.noise_floor_dbm
        per = self.radio.per(snr_db, packet.length_bytes)
        chance = self.radio.expected_delivery(
            mean_dbm - self.radio.noise_floor_dbm, distance_m, packet.length_bytes
        )
        erased = self.draws.uniforms(Purpose.ERASURE, tx, receivers, packet.seq) <= per
        fates = [Fate.CHANNEL_ERASURE if lost else Fate.DELIVERED for lost in erased.tolist()]
        columns = [distance_m, power_dbm, snr_db, per, chance]
        self._base_losses(fates, tx, receivers, packet.seq)
        self._out_of_range(fates, columns)
        self._unknown(fates, columns, packet.tx, others)
        distances, powers, snrs, pers, chances = (column.tolist() for column in columns)
        head = (packet.sim_time_ns, tx)
        tail = (packet.seq, packet.length_bytes)
        return [
            Reception(*head, rx, *tail, *rest)
            for rx, *rest in zip(receivers, distances, powers, snrs, pers, fates, chances, strict=True)
        ]

    def _shadowing_db(self, tx: str, receivers: tuple[str, ...], seq: int) -> FloatArray | float:
        shadowing = self.radio.config.shadowing
        if not shadowing.is_random:
            return 0.0
        uniform = self.draws.uniforms(Purpose.SHADOWING, tx, receivers, seq)
        return shadowing.loss_db(standard_normal_from_uniform(uniform))

    def _base_losses(self, fates: list[Fate], tx: str, receivers: tuple[str, ...], seq: int) -> None:
        base_loss = self.radio.config.base_loss
        if base_loss > 0.0:
            for i, draw in enumerate(self.draws.uniforms(Purpose.BASE_LOSS, tx, receivers, seq).tolist()):
                if draw <= base_loss:
                    fates[i] = Fate.BASE_LOSS

    def _out_of_range(self, fates: list[Fate], columns: list[FloatArray]) -> None:
        beyond = columns[0] > self.radio.max_range_m
        if beyond.any():
            columns[3] = np.where(beyond, 1.0, columns[3])
            for i in np.flatnonzero(beyond):
                fates[i] = Fate.OUT_OF_RANGE

    def _unknown(self, fates: list[Fate], columns: list[FloatArray], tx: int, others: FloatArray) -> None:
        known = self._tracks.known
        if known.all():
            return
        unknown = ~(known[others] & known[tx])
        columns[:4] = [np.where(unknown, np.nan, column) for column in columns[:4]]
        columns[4] = np.where(unknown, 0.0, columns[4])
        for i in np.flatnonzero(unknown):
            fates[i] = Fate.NO_POSITION
