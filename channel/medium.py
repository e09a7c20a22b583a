"""The medium: who receives which packet. Takes truth and packets with their sim time, gives fates; no I/O, no clock.

A packet waits until the truth at or after its instant is there for every node, so that its fate depends on the
seed, the positions and its sequence number alone: not on the order of arrival, nor on who else flies.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Iterable
from enum import Enum
from itertools import repeat
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from channel.checks import ChannelInputError, FloatArray
from channel.erasure import MAX_SEQ, Draws, Purpose, check_seed
from channel.geometry import LEVEL_WXYZ, Path, separation_m
from channel.radio import Radio
from channel.random_terms import RandomTerms
from channel.tracks import ATTITUDE, POSITION, VELOCITY, Tracks, truth_row

MAX_TRUTH_AGE_NS = 1_000_000_000
MAX_LENGTH_BYTES = 1 << 24


class Fate(Enum):
    """What became of a packet at one receiver: delivered, or the cause of its loss."""

    DELIVERED = "delivered"
    CHANNEL_ERASURE = "channel_erasure"
    OUT_OF_RANGE = "out_of_range"
    BASE_LOSS = "base_loss"
    BURST = "burst"
    NO_POSITION = "no_position"


_DELIVERED, _ERASED = Fate.DELIVERED, Fate.CHANNEL_ERASURE


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
        self._terms = RandomTerms(radio, self.draws)
        self._has_range = math.isfinite(radio.max_range_m)
        self._has_other_losses = radio.kept_share < 1.0
        self._has_interferers = bool(radio.config.interference.interferers)
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
        from_row, to_rows = rows[packet.tx], rows[others]
        here, there = from_row[POSITION], to_rows[:, POSITION]
        distance_m = separation_m(here, there)
        path = self._path(from_row, to_rows, distance_m)
        mean_dbm = self.radio.mean_power_dbm(path)
        power_dbm = mean_dbm + self._random_gain_db(packet, path, from_row, to_rows)
        on = self._terms.interferers_on(packet.sim_time_ns) if self._has_interferers else ()
        snr_db = power_dbm - self.radio.noise_dbm(path, on)
        per = self.radio.per(snr_db, packet.length_bytes)
        chance = self.radio.expected_delivery(mean_dbm, path, packet.length_bytes)
        erased = self.draws.uniforms(Purpose.ERASURE, tx, receivers, packet.seq) <= per
        fates = [_ERASED if lost else _DELIVERED for lost in erased.tolist()]
        columns = [distance_m, power_dbm, snr_db, per, chance]
        if self._has_other_losses:
            self._other_losses(fates, packet, receivers)
        if self._has_range:
            self._out_of_range(fates, columns)
        if not self._tracks.all_known:
            self._unknown(fates, columns, packet.tx, others)
        distances, powers, snrs, pers, chances = (column.tolist() for column in columns)
        when, sender = repeat(packet.sim_time_ns), repeat(tx)
        number, length = repeat(packet.seq), repeat(packet.length_bytes)
        rows_of = zip(when, sender, receivers, number, length, distances, powers, snrs, pers, fates, chances)  # noqa: B905
        return [tuple.__new__(Reception, row) for row in rows_of]

    def _path(self, from_row: FloatArray, to_rows: FloatArray, distance_m: FloatArray) -> Path:
        here, there = from_row[POSITION], to_rows[:, POSITION]
        if not self.radio.needs_attitude:
            return self.radio.path_of(here, there, distance_m)
        return self.radio.path_of(
            here, there, distance_m, _unit(from_row[ATTITUDE]), _unit(to_rows[:, ATTITUDE])
        )

    def _random_gain_db(
        self, packet: _Packet, path: Path, from_row: FloatArray, to_rows: FloatArray
    ) -> FloatArray | float:
        """Return what shadowing and fading do to the power at each receiver, dB."""
        config = self.radio.config
        tx, (receivers, _) = self.nodes[packet.tx], self._others[packet.tx]
        gain_db: FloatArray | float = 0.0
        if config.shadowing.is_random:
            gain_db = -self._terms.shadowing_db(tx, receivers, packet.seq, path)
        if config.fading.is_random:
            way = to_rows[:, VELOCITY] - from_row[VELOCITY]
            speed = np.sqrt(np.sum(way**2, axis=-1))
            gain_db = gain_db + self._terms.fading_db(
                tx, receivers, packet.seq, packet.sim_time_ns, path, speed
            )
        return gain_db

    def _other_losses(self, fates: list[Fate], packet: _Packet, receivers: tuple[str, ...]) -> None:
        """Put in the losses that do not depend on the signal; bursts come before base losses."""
        tx, config = self.nodes[packet.tx], self.radio.config
        if config.base_loss > 0.0:
            _mark(fates, self._terms.base_losses(tx, receivers, packet.seq), Fate.BASE_LOSS)
        if config.bursts.mean_loss > 0.0:
            losses = self._terms.burst_losses(tx, receivers, packet.seq, packet.sim_time_ns)
            _mark(fates, losses, Fate.BURST)

    def _out_of_range(self, fates: list[Fate], columns: list[FloatArray]) -> None:
        beyond = columns[0] > self.radio.max_range_m
        if beyond.any():
            columns[3] = np.where(beyond, 1.0, columns[3])
            columns[4] = np.where(beyond, 0.0, columns[4])
            _mark(fates, beyond.tolist(), Fate.OUT_OF_RANGE)

    def _unknown(
        self, fates: list[Fate], columns: list[FloatArray], tx: int, others: NDArray[np.bool_]
    ) -> None:
        known = self._tracks.known
        unknown = ~(known[others] & known[tx])
        columns[:4] = [np.where(unknown, np.nan, column) for column in columns[:4]]
        columns[4] = np.where(unknown, 0.0, columns[4])
        _mark(fates, unknown.tolist(), Fate.NO_POSITION)


def _mark(fates: list[Fate], where: list[bool], fate: Fate) -> None:
    for i, marked in enumerate(where):
        if marked:
            fates[i] = fate


def _unit(quaternion: FloatArray) -> FloatArray:
    """Return interpolated attitudes at length 1; a node never seen is level."""
    length = np.sqrt(np.sum(quaternion**2, axis=-1, keepdims=True))
    return np.where(length > 0.0, quaternion / np.maximum(length, 1e-9), LEVEL_WXYZ)
