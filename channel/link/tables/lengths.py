"""Lengths of the packets on many links: few of them differ, so that what depends on a length is made once for each."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from channel.checks import FloatArray


class Lengths(NamedTuple):
    """Lengths in bytes, as the error model counts them.

    Attributes:
        distinct: the lengths that occur.
        which: of each link, its place in `distinct`, shape (L,); 0 if all links have the one length.
    """

    distinct: tuple[int, ...]
    which: int | NDArray[np.intp]

    @classmethod
    def same(cls, length_bytes: int) -> Lengths:
        """Return one length for all links."""
        return cls((length_bytes,), 0)

    @classmethod
    def of(cls, length_bytes: NDArray[np.int64], packet: NDArray[np.intp]) -> Lengths:
        """Return the lengths of links, from those of packets, at least one, and the row of each link's packet."""
        first = int(length_bytes[0])
        if length_bytes.size == 1 or np.count_nonzero(length_bytes == first) == length_bytes.size:
            return cls((first,), 0)
        distinct, which = np.unique(length_bytes, return_inverse=True)
        return cls(tuple(distinct.tolist()), which[packet])

    def at(self, links: NDArray[np.intp]) -> Lengths:
        """Return the lengths of some of the links."""
        return self if isinstance(self.which, int) else self._replace(which=self.which[links])

    def each(self, values: FloatArray) -> FloatArray | float:
        """Return a value per distinct length as one per link, or as a number if there is one length."""
        if isinstance(self.which, int):
            return float(values[self.which])
        per_link: FloatArray = values[self.which]
        return per_link

    @property
    def bytes_each(self) -> FloatArray | float:
        """The length of each link's packet."""
        return self.each(np.array(self.distinct, dtype=np.float64))
