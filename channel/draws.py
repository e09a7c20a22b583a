"""Counter-based draws: a number depends on who asks for what, never on when or in which order.

Philox4x64-10 (Salmon et al. 2011, numpy's `Philox`) is keyed by (run seed, transmitter, receiver, stream); its
counter is the packet's sequence number. One counter step gives four 64-bit words, one per purpose. The scalar
and the vectorised functions read the same words.
"""

from __future__ import annotations

import hashlib
from collections import OrderedDict
from collections.abc import Callable, Sequence
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from channel.checks import ChannelInputError, FloatArray

WORDS_PER_COUNT = 4
BLOCK_PACKETS = 128
"""Sequence numbers drawn at once per link; a draw does not depend on it."""
KEPT_BLOCKS = 2
MAX_STREAMS = 20_000
"""Streams kept open; those that are closed and opened again draw the same numbers."""
BEFORE_ZERO = (2**64 - 1,) * 4
MAX_SEQ = 2**63 - 1


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
    uniform = (words >> np.uint64(12)).astype(np.float64)
    uniform += 0.5
    uniform *= 2.0**-52
    return uniform


class Table:
    """Rows of numbers by sequence number, made in blocks; the last two blocks are kept.

    Args:
        make: returns the rows of one block, shape (BLOCK_PACKETS, receivers), for the block's number.
    """

    def __init__(self, make: Callable[[int], FloatArray]) -> None:
        self._make = make
        self._blocks: OrderedDict[int, FloatArray] = OrderedDict()

    def row(self, seq: int) -> FloatArray:
        """Return the row of a sequence number, shape (receivers,)."""
        number, offset = divmod(seq, BLOCK_PACKETS)
        rows = self._blocks.get(number)
        if rows is None:
            rows = self._blocks[number] = self._make(number)
            if len(self._blocks) > KEPT_BLOCKS:
                self._blocks.popitem(last=False)
        row: FloatArray = rows[offset]
        return row


class Fan:
    """The draws of one transmitter's packets at its receivers: the numbers of `Draws.uniform`, ahead of need.

    Args:
        draws: the run's draws.
        tx: transmitting node.
        receivers: receiving nodes.
    """

    def __init__(self, draws: Draws, tx: str, receivers: Sequence[str]) -> None:
        self._draws = draws
        self._tx = tx
        self._receivers = tuple(receivers)
        self._uniforms: dict[Purpose, Table] = {}
        self._words: dict[str, tuple[int, NDArray[np.uint64]]] = {}

    def uniforms(self, purpose: Purpose) -> Table:
        """Return the draws for a purpose."""
        table = self._uniforms.get(purpose)
        if table is None:
            table = self._uniforms[purpose] = self.derived(purpose, lambda uniform: uniform)
        return table

    def derived(self, purpose: Purpose, law: Callable[[FloatArray], FloatArray]) -> Table:
        """Return what a function makes of the draws for a purpose, element by element."""
        return Table(lambda block: law(self._block(purpose, block)))

    def _block(self, purpose: Purpose, block: int) -> FloatArray:
        """Return a block of draws; the words of the last one are kept, for the other purposes of the stream."""
        number, words = self._words.get(purpose.stream, (-1, None))
        if words is None or number != block:
            words = np.empty((BLOCK_PACKETS, len(self._receivers), WORDS_PER_COUNT), dtype=np.uint64)
            for column, rx in enumerate(self._receivers):
                names = (self._tx, rx, purpose.stream)
                words[:, column] = self._draws.words(names, block * BLOCK_PACKETS, BLOCK_PACKETS)
            self._words[purpose.stream] = block, words
        return uniform_from_words(np.ascontiguousarray(words[:, :, purpose.word]))


class Draws:
    """All random numbers of one run.

    Args:
        seed: the run's seed, any integer.
    """

    def __init__(self, seed: int) -> None:
        self.seed = seed
        self._fans: dict[tuple[str, tuple[str, ...]], Fan] = {}
        self._streams: dict[tuple[str, ...], tuple[np.random.Philox, int]] = {}
        """Each with the counter that it draws next."""

    def words(self, names: tuple[str, ...], first: int, count: int) -> NDArray[np.uint64]:
        """Return the words of `count` successive counter values from `first` on, shape (count, 4).

        Raises:
            ChannelInputError: a counter outside 0 .. 2^63 - 1.
        """
        if not 0 <= first <= MAX_SEQ:
            raise ChannelInputError("seq", first, f"an integer from 0 to {MAX_SEQ}")
        philox, at = self._streams.get(names) or self._stream(names)
        if at != first:
            philox.advance(first - at)
        self._streams[names] = philox, first + count
        return philox.random_raw(count * WORDS_PER_COUNT).reshape(count, WORDS_PER_COUNT)

    def _stream(self, names: tuple[str, ...]) -> tuple[np.random.Philox, int]:
        """Return a stream before its counter 0: numpy steps the counter before it draws."""
        if len(self._streams) >= MAX_STREAMS:
            self._streams.clear()
        return np.random.Philox(key=stream_key(self.seed, *names), counter=BEFORE_ZERO), 0

    def uniform(self, purpose: Purpose, tx: str, rx: str, seq: int) -> float:
        """Return the draw of one packet on one link, in the open interval (0, 1)."""
        words = self.words((tx, rx, purpose.stream), seq, 1)
        return float(uniform_from_words(words[0, purpose.word]))

    def fan(self, tx: str, receivers: Sequence[str]) -> Fan:
        """Return the draws of one transmitter's packets at its receivers."""
        names = tx, tuple(receivers)
        fan = self._fans.get(names)
        if fan is None:
            fan = self._fans[names] = Fan(self, *names)
        return fan

    def uniforms(self, purpose: Purpose, tx: str, receivers: Sequence[str], seq: int) -> FloatArray:
        """Return the draws of one packet to many receivers, shape (receivers,); equal to `uniform` of each."""
        return self.fan(tx, receivers).uniforms(purpose).row(seq)


def check_seed(seed: int) -> int:
    """Return the seed if it is an integer.

    Raises:
        ChannelInputError: it is not.
    """
    if isinstance(seed, bool) or not isinstance(seed, int):
        raise ChannelInputError("seed", seed, "an integer")
    return seed
