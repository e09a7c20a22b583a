"""Counter-based draws: a number depends on who asks for what, never on when or in which order.

Philox4x64-10 (Salmon et al. 2011, numpy's `Philox`) is keyed by (run seed, transmitter, receiver, stream); its
counter is the packet's sequence number. One counter step gives four 64-bit words, one per purpose. `Draws` gives the
words of named streams, `LinkDraws` those of many links at once, by the indices of their ends: the same words.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from channel.checks import ChannelInputError, FloatArray
from channel.numbers.philox import WORDS_PER_COUNT, PhiloxRuns, Words, philox_words

__all__ = ["WORDS_PER_COUNT", "Draws", "LinkDraws", "Purpose", "stream_key", "uniform_from_words"]

BLOCK_BITS = 8
BLOCK_PACKETS = 1 << BLOCK_BITS
"""Sequence numbers that are drawn ahead of need per link of a small fleet; a draw does not depend on it."""
AHEAD_MAX_NODES = 64
"""In larger fleets nothing is drawn ahead: the blocks of all links would take too much memory."""
MAX_SEQ = 2**63 - 1
MAX_STREAMS = 20_000
"""Named streams whose keys are kept."""

Indices = NDArray[np.intp]


class Purpose(Enum):
    """What a draw is for: the stream that it is keyed by, and its word within a count."""

    ERASURE = ("packet", 0)
    SHADOWING = ("packet", 1)
    FADING_I = ("packet", 2)
    FADING_Q = ("packet", 3)
    BASE_LOSS = ("extra", 0)
    BURST = ("extra", 1)

    def __init__(self, stream: str, word: int) -> None:
        self.stream = stream
        self.word = word

    __hash__ = object.__hash__
    """There is one of each, and it is looked up for each packet: the hash of its name would take longer."""


def stream_key(seed: int, *names: str) -> Words:
    """Return the 128-bit Philox key of a named stream, as two words.

    BLAKE2b over the seed and the names, each with its length before it: stable between processes, Python
    versions and machines, unlike `hash()`.
    """
    digest = hashlib.blake2b(digest_size=16, person=b"lostlink draws")
    for part in (str(seed), *names):
        data = part.encode()
        digest.update(len(data).to_bytes(4, "little") + data)
    return np.frombuffer(digest.digest(), dtype="<u8").astype(np.uint64)


def uniform_from_words(words: Words) -> FloatArray:
    """Return numbers of the open interval (0, 1) from 64-bit words: the middle of one of 2^52 equal cells."""
    uniform = (words >> np.uint64(12)).astype(np.float64)
    uniform += 0.5
    uniform *= 2.0**-52
    return uniform


class Draws:
    """All random numbers of one run, or of one of its further radio networks.

    Args:
        seed: the run's seed, any integer.
        network: name of the network, whose numbers are others; "": those of the run.

    Attributes:
        seed: what all streams are keyed by.
        common: those of the run, for what is the same on all its networks.
    """

    def __init__(self, seed: int, network: str = "") -> None:
        self.seed = int(stream_key(seed, "network", network)[0]) if network else seed
        self.common = Draws(seed) if network else self
        self._runs = PhiloxRuns()
        self._keys: dict[tuple[str, ...], Words] = {}

    def words(self, names: tuple[str, ...], first: int, count: int) -> Words:
        """Return the words of `count` successive counter values from `first` on, shape (count, 4).

        Raises:
            ChannelInputError: a counter outside 0 .. 2^63 - 1.
        """
        if not 0 <= first <= MAX_SEQ:
            raise ChannelInputError("seq", first, f"an integer from 0 to {MAX_SEQ}")
        key = self._keys.get(names)
        if key is None:
            if len(self._keys) >= MAX_STREAMS:
                self._keys.clear()
            key = self._keys[names] = stream_key(self.seed, *names)
        return self.run(key, first, count)

    def run(self, key: Words, first: int, count: int) -> Words:
        """Return what `words` returns, for a key."""
        return self._runs.words(key, first, count)

    def uniform(self, purpose: Purpose, tx: str, rx: str, seq: int) -> float:
        """Return the draw of one packet on one link, in the open interval (0, 1)."""
        words = self.words((tx, rx, purpose.stream), seq, 1)
        return float(uniform_from_words(words[0, purpose.word]))


class LinkDraws:
    """Draws of many links at once, each link given by the indices of its ends.

    Args:
        draws: the run's draws.
        nodes: names of all nodes.
    """

    def __init__(self, draws: Draws, nodes: Sequence[str]) -> None:
        self.draws = draws
        self.nodes = tuple(nodes)
        order = np.array(sorted(range(len(self.nodes)), key=self.nodes.__getitem__), dtype=np.intp)
        self._rank = np.argsort(order)
        self._keys: dict[tuple[str, ...], tuple[Words, NDArray[np.bool_]]] = {}
        self._ahead: dict[tuple[Purpose, ...], _Ahead] = {}

    def by_name(self, tx: Indices, rx: Indices) -> tuple[Indices, Indices]:
        """Return the ends of links in the order of their names: what both directions of a pair share is keyed so."""
        turned = self._rank[tx] > self._rank[rx]
        return np.where(turned, rx, tx), np.where(turned, tx, rx)

    def keys(self, stream: tuple[str, ...], tx: Indices, rx: Indices) -> Words:
        """Return the keys of one stream, given by the names after the link's, in this direction, shape (2, L)."""
        size = len(self.nodes)
        if stream not in self._keys:
            self._keys[stream] = np.empty((2, size * size), np.uint64), np.zeros(size * size, bool)
        keys, known = self._keys[stream]
        at = tx * size + rx
        if not known[at].all():
            for link in np.unique(at[~known[at]]).tolist():
                names = self.nodes[link // size], self.nodes[link % size]
                keys[:, link] = stream_key(self.draws.seed, *names, *stream)
                known[link] = True
        return keys.take(at, axis=1)

    def words(self, stream: tuple[str, ...], tx: Indices, rx: Indices, counters: NDArray[np.int64]) -> Words:
        """Return the words of each link at its counter, shape (4, L): those of `Draws.words`."""
        return philox_words(self.keys(stream, tx, rx), counters)

    def uniforms(
        self, purposes: tuple[Purpose, ...], packets: tuple[Indices, NDArray[np.int64]], *links: Indices
    ) -> FloatArray:
        """Return the draws of packets at receivers for purposes of one stream, in one call.

        Args:
            purposes: of one stream.
            packets: transmitter and sequence number of each packet, shape (P,) each.
            *links: row of the packet and receiver of each link, shape (L,) each.

        Returns:
            Shape (purposes, L): equal to `Draws.uniform` of each.
        """
        packet, rx = links
        tx, seq = packets
        if len(self.nodes) > AHEAD_MAX_NODES:
            return self._at_once(purposes, tx[packet], rx, seq[packet])
        ahead = self._ahead.get(purposes)
        if ahead is None:
            ahead = self._ahead[purposes] = _Ahead(self, purposes)
        missing, row = ahead.rows(tx, seq)
        uniform = ahead.take(row[packet] + rx)
        if missing is not None:
            late = np.flatnonzero(missing[packet])
            of = packet[late]
            uniform[:, late] = self._at_once(purposes, tx[of], rx[late], seq[of])
        return uniform

    def _at_once(
        self, purposes: tuple[Purpose, ...], tx: Indices, rx: Indices, seq: NDArray[np.int64]
    ) -> FloatArray:
        words = self.words((purposes[0].stream,), tx, rx, seq)
        return uniform_from_words(words[[each.word for each in purposes]])


class _Ahead:
    """The draws of one block of sequence numbers of each transmitter, at all receivers.

    Args:
        links: whose draws.
        purposes: of one stream.
    """

    def __init__(self, links: LinkDraws, purposes: tuple[Purpose, ...]) -> None:
        size = len(links.nodes)
        self._links = links
        self._purposes = purposes
        self._block = np.full(size, -1, dtype=np.int64)
        self._table = np.zeros((len(purposes), size, BLOCK_PACKETS, size))
        self._flat = self._table.reshape(len(purposes), -1)
        # two packets more than a block: rows that are a power of two apart share places in the processor's cache
        self._words = np.zeros((size, BLOCK_PACKETS + 2, WORDS_PER_COUNT), dtype=np.uint64)

    def rows(self, tx: Indices, seq: NDArray[np.int64]) -> tuple[NDArray[np.bool_] | None, Indices]:
        """Return which packets' draws are not in the table, None if all are, and where the row of each begins.

        A transmitter's block moves on with its sequence numbers, never back.
        """
        block = seq >> BLOCK_BITS
        row = ((tx << BLOCK_BITS) + (seq & (BLOCK_PACKETS - 1))) * len(self._block)
        missing = block != self._block[tx]
        if not np.count_nonzero(missing):
            return None, row
        for i in np.flatnonzero(block > self._block[tx]).tolist():
            self._fill(int(tx[i]), int(block[i]))
        return block != self._block[tx], row

    def take(self, at: Indices) -> FloatArray:
        """Return the draws at places in the table, shape (purposes, L)."""
        return self._flat.take(at, axis=1)

    def _fill(self, tx: int, block: int) -> None:
        if block <= self._block[tx]:
            return
        others = np.flatnonzero(np.arange(len(self._block)) != tx)
        keys = self._links.keys((self._purposes[0].stream,), np.full_like(others, tx), others)
        words = self._words
        for rx, key in zip(others.tolist(), np.ascontiguousarray(keys.T), strict=True):
            words[rx, :BLOCK_PACKETS] = self._links.draws.run(key, block * BLOCK_PACKETS, BLOCK_PACKETS)
        for row, purpose in zip(self._table, self._purposes, strict=True):
            by_packet = np.ascontiguousarray(words[:, :BLOCK_PACKETS, purpose.word].T)
            row[tx] = uniform_from_words(by_packet)
        self._block[tx] = block


def check_seed(seed: int) -> int:
    """Return the seed if it is an integer.

    Raises:
        ChannelInputError: it is not.
    """
    if isinstance(seed, bool) or not isinstance(seed, int):
        raise ChannelInputError("seed", seed, "an integer")
    return seed
