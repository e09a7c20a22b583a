"""Draws of a medium: each node's numbers hang on who it is and on which of its draws it is, and on nothing else."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from channel.checks import FloatArray
from channel.draws import Draws, stream_key
from channel.numbers.philox import WORDS_PER_COUNT

_BLOCK = 64
BLOCK_WORDS = _BLOCK * WORDS_PER_COUNT
_TO_UNIFORM = 2.0**-53


class WordStream:
    """64-bit words of one named stream, one after the other or by index.

    Args:
        draws: of the run.
        names: of the stream.
    """

    def __init__(self, draws: Draws, *names: str) -> None:
        self._draws, self._key = draws, stream_key(draws.seed, *names)
        self._block, self._words = -1, [0]
        self._next = 0

    def word(self, index: int) -> int:
        """The word at an index, 0 or more."""
        block, place = divmod(index, BLOCK_WORDS)
        if block != self._block:
            self._block = block
            self._words = self._draws.run(self._key, block * _BLOCK, _BLOCK).ravel().tolist()
        return self._words[place]

    def uniform(self, index: int) -> float:
        """The number in [0, 1) at an index."""
        return (self.word(index) >> 11) * _TO_UNIFORM

    def uniforms(self, block: int) -> FloatArray:
        """The numbers in [0, 1) of one of the blocks of BLOCK_WORDS."""
        words = self._draws.run(self._key, block * _BLOCK, _BLOCK).ravel()
        return (words >> np.uint64(11)).astype(np.float64) * _TO_UNIFORM

    def below(self, count: int) -> int:
        """The next word as an integer from 0 to ``count`` - 1; by the product, which for small counts has no bias."""
        found = self.coming_below(count)
        self._next += 1
        return found

    def coming_below(self, count: int) -> int:
        """What `below` will return."""
        return (self.word(self._next) * count) >> 64

    def next_uniform(self) -> float:
        """The next word as a number in [0, 1)."""
        self._next += 1
        return self.uniform(self._next - 1)


class FrameDraws:
    """One number in [0, 1) for each frame at each receiver, whoever else is on the air."""

    def __init__(self, seed: int) -> None:
        self._draws = Draws(seed)
        self._streams: dict[tuple[int, int], WordStream] = {}
        self._tables: dict[int, tuple[Sequence[int], int, FloatArray]] = {}
        """By transmitter: of which receivers, which block, and its numbers, a row for each frame."""

    def uniform(self, transmitter: int, receiver: int, number: int) -> float:
        """Of a transmitter's frame with this number."""
        return self._stream(transmitter, receiver).uniform(number)

    def uniforms(self, transmitter: int, receivers: Sequence[int], number: int) -> FloatArray:
        """Of a transmitter's frame at receivers, which are the same for all its frames."""
        block, row = divmod(number, BLOCK_WORDS)
        those, now, table = self._tables.get(transmitter, ((), -1, np.empty(0)))
        if block != now or those is not receivers:
            columns = [self._stream(transmitter, receiver).uniforms(block) for receiver in receivers]
            table = np.array(columns).reshape(-1, BLOCK_WORDS).T.copy()
            self._tables[transmitter] = receivers, block, table
        numbers: FloatArray = table[row]
        return numbers

    def _stream(self, transmitter: int, receiver: int) -> WordStream:
        link = (transmitter, receiver)
        stream = self._streams.get(link)
        if stream is None:
            names = (str(transmitter), str(receiver), "frame")
            stream = self._streams[link] = WordStream(self._draws, *names)
        return stream
