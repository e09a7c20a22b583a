"""Counter-based draws: a number depends on who asks for what, never on when or in which order.

Philox4x64-10 (Salmon et al. 2011, numpy's `Philox`) is keyed by (run seed, transmitter, receiver, stream); its
counter is the packet's sequence number. One counter step gives four 64-bit words, one per purpose. The scalar
and the vectorised functions read the same words.
"""

from __future__ import annotations

import hashlib
from collections import OrderedDict
from collections.abc import Sequence
from enum import Enum

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from channel.checks import ChannelInputError, FloatArray

WORDS_PER_COUNT = 4
BLOCK_PACKETS = 256
"""Sequence numbers drawn at once per link; a draw does not depend on it."""
MAX_BLOCKS = 4096
MAX_SEQ = 2**63 - 1


class Purpose(Enum):
    """What a draw is for: the stream that it is keyed by, and its word within a count."""

    ERASURE = ("packet", 0)
    SHADOWING = ("packet", 1)
    FADING_I = ("packet", 2)
    FADING_Q = ("packet", 3)
    BASE_LOSS = ("extra", 0)
    BURST = ("extra", 1)
    INTERFERENCE = ("extra", 2)
    LINE_OF_SIGHT = ("extra", 3)

    def __init__(self, stream: str, word: int) -> None:
        self.stream = stream
        self.word = word


def stream_key(seed: int, *names: str) -> NDArray[np.uint64]:
    """Return the 128-bit Philox key of a named stream, as two words.

    BLAKE2b over the seed and the names, each with its length before it: stable between processes, Python
    versions and machines, unlike `hash()`.
    """
    digest = hashlib.blake2b(digest_size=16, person=b"lostlink draws")
    for part in (str(seed), *names):
        data = part.encode()
        digest.update(len(data).to_bytes(4, "little") + data)
    return np.frombuffer(digest.digest(), dtype="<u8").astype(np.uint64)


def uniform_from_words(words: NDArray[np.uint64]) -> FloatArray:
    """Return numbers of the open interval (0, 1) from 64-bit words: the middle of one of 2^52 equal cells."""
    return ((words >> np.uint64(12)).astype(np.float64) + 0.5) * 2.0**-52


class Draws:
    """All random numbers of one run.

    Blocks of 256 sequence numbers are kept per transmitter, receiver set and purpose: a speed-up that
    changes no number.

    Args:
        seed: the run's seed, any integer.
    """

    def __init__(self, seed: int) -> None:
        self.seed = seed
        self._philox = np.random.Philox(key=0)
        self._state = self._philox.state
        self._blocks: OrderedDict[tuple[str, tuple[str, ...], Purpose, int], FloatArray] = OrderedDict()
        self._normals: OrderedDict[tuple[str, tuple[str, ...], Purpose, int], FloatArray] = OrderedDict()
        self._normal_name: tuple[str, tuple[str, ...], Purpose, int] | None = None
        self._normal_block: FloatArray = np.empty((0, 0))
        self._keys: dict[tuple[str, ...], NDArray[np.uint64]] = {}

    def words(self, names: tuple[str, ...], first: int, count: int) -> NDArray[np.uint64]:
        """Return the words of `count` successive counter values from `first` on, shape (count, 4).

        Raises:
            ChannelInputError: a counter outside 0 .. 2^63 - 1.
        """
        if not 0 <= first <= MAX_SEQ:
            raise ChannelInputError("seq", first, f"an integer from 0 to {MAX_SEQ}")
        key = self._keys.get(names)
        if key is None:
            key = self._keys[names] = stream_key(self.seed, *names)
        state = self._state
        state["state"]["key"][:] = key
        # numpy steps the counter before it draws, so one less than `first`, with borrow over 256 bits.
        state["state"]["counter"][:] = (first - 1, 0, 0, 0) if first else (2**64 - 1,) * 4
        state["buffer_pos"] = WORDS_PER_COUNT
        state["has_uint32"] = 0
        self._philox.state = state
        return self._philox.random_raw(count * WORDS_PER_COUNT).reshape(count, WORDS_PER_COUNT)

    def uniform(self, purpose: Purpose, tx: str, rx: str, seq: int) -> float:
        """Return the draw of one packet on one link, in the open interval (0, 1)."""
        words = self.words((tx, rx, purpose.stream), seq, 1)
        return float(uniform_from_words(words[0, purpose.word]))

    def uniforms(self, purpose: Purpose, tx: str, receivers: Sequence[str], seq: int) -> FloatArray:
        """Return the draws of one packet to many receivers, shape (receivers,); equal to `uniform` of each."""
        block, offset = divmod(seq, BLOCK_PACKETS)
        row: FloatArray = self._block(purpose, tx, tuple(receivers), block)[offset]
        return row

    def normals(self, purpose: Purpose, tx: str, receivers: tuple[str, ...], seq: int) -> FloatArray:
        """Return `uniforms` through the normal law's quantile function, shape (receivers,)."""
        block, offset = divmod(seq, BLOCK_PACKETS)
        name = (tx, receivers, purpose, block)
        if self._normal_name != name:
            kept = self._normals.get(name)
            if kept is None:
                kept = self._normals[name] = np.asarray(ndtri(self._block(purpose, tx, receivers, block)))
                while len(self._normals) > MAX_BLOCKS:
                    self._normals.popitem(last=False)
            self._normal_name, self._normal_block = name, kept
        row: FloatArray = self._normal_block[offset]
        return row

    def series(self, purpose: Purpose, tx: str, rx: str, first_seq: int, count: int) -> FloatArray:
        """Return the draws of `count` successive packets of one link, shape (count,); equal to `uniform`."""
        return uniform_from_words(self.words((tx, rx, purpose.stream), first_seq, count)[:, purpose.word])

    def _block(self, purpose: Purpose, tx: str, receivers: tuple[str, ...], block: int) -> FloatArray:
        name = (tx, receivers, purpose, block)
        kept = self._blocks.get(name)
        if kept is None:
            kept = self._draw_block(purpose, tx, receivers, block)
            while len(self._blocks) > MAX_BLOCKS:
                self._blocks.popitem(last=False)
        return kept

    def _draw_block(self, purpose: Purpose, tx: str, receivers: tuple[str, ...], block: int) -> FloatArray:
        """Draw and keep the blocks of every purpose of the stream: they come out of the same words."""
        words = np.empty((BLOCK_PACKETS, len(receivers), WORDS_PER_COUNT), dtype=np.uint64)
        for column, rx in enumerate(receivers):
            words[:, column] = self.words((tx, rx, purpose.stream), block * BLOCK_PACKETS, BLOCK_PACKETS)
        for each in Purpose:
            if each.stream == purpose.stream:
                uniform = uniform_from_words(np.ascontiguousarray(words[:, :, each.word]))
                self._blocks[tx, receivers, each, block] = uniform
        return self._blocks[tx, receivers, purpose, block]


def check_seed(seed: int) -> int:
    """Return the seed if it is an integer.

    Raises:
        ChannelInputError: it is not.
    """
    if isinstance(seed, bool) or not isinstance(seed, int):
        raise ChannelInputError("seed", seed, "an integer")
    return seed
