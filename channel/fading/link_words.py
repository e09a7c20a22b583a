"""Random words of links: counter-based, by arithmetic on arrays, the same alone and in a crowd.

Each node has a key from the run's seed and its name (BLAKE2b, as all streams of draws). A word of a link is made of
the keys of its two ends by the finaliser of SplitMix64 (Steele, Lea, Flood, OOPSLA 2014): whole-number arithmetic,
which has the same bits on every machine. Nothing is hashed per packet.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from channel.draws import stream_key

Words = NDArray[np.uint64]
Index = NDArray[np.intp]

_FIRST = np.uint64(0xBF58476D1CE4E5B9)
_SECOND = np.uint64(0x94D049BB133111EB)
_GOLDEN = np.uint64(0x9E3779B97F4A7C15)


def mixed(words: Words) -> Words:
    """Return SplitMix64's finaliser of each word: every bit of it depends on every bit of the word."""
    out = words ^ (words >> np.uint64(30))
    out *= _FIRST
    out ^= out >> np.uint64(27)
    out *= _SECOND
    out ^= out >> np.uint64(31)
    return out


def counted(words: Words, count: Words | int) -> Words:
    """Return the word with a number in the sequence that each word starts: SplitMix64 with a jump."""
    steps = np.atleast_1d(np.asarray(count, dtype=np.uint64)) + np.uint64(1)
    return mixed(words + _GOLDEN * steps)


class LinkWords:
    """A random word for each link of a fixed set of nodes.

    Args:
        seed: the run's seed.
        nodes: names, in the order of their indices.
        purpose: links have other words for another purpose.
    """

    def __init__(self, seed: int, nodes: Sequence[str], purpose: str) -> None:
        keys = [stream_key(seed, node, purpose) for node in nodes]
        self._keys = np.array(keys, dtype=np.uint64).reshape(-1, 2).T.copy()
        self._rank = np.argsort(np.argsort(np.array(nodes, dtype=object))) if nodes else np.zeros(0, np.intp)

    def of_direction(self, tx: Index, rx: Index) -> Words:
        """Return a word for each directed link, shape (L,)."""
        return mixed(self._keys[0][tx] + self._keys[1][rx] * _GOLDEN)

    def tx_is_first(self, tx: Index, rx: Index) -> NDArray[np.bool_]:
        """Return whether the transmitter is the first end of its pair, by name: the same for both directions."""
        return np.asarray(self._rank[tx] <= self._rank[rx])

    def of_pair(self, tx: Index, rx: Index) -> Words:
        """Return a word for each link that both directions share, shape (L,)."""
        first = self.tx_is_first(tx, rx)
        return self.of_direction(np.where(first, tx, rx), np.where(first, rx, tx))
