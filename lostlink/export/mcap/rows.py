"""Messages of one length in CDR, many at once: a row of a table becomes the bytes of a message by numpy alone."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

_HEADER: Final = np.frombuffer(b"\0\1\0\0", dtype=np.uint8)
_HEADER_BYTES: Final = 4
Part = str | tuple[str, str]
"""A text that all of the messages have, or the name of a column and its numpy type."""


class _Place(NamedTuple):
    name: str
    dtype: str
    offset: int


class Rows:
    """Messages that differ only in numbers.

    Args:
        parts: what a message consists of, in order: texts are the same in all of them.
    """

    def __init__(self, parts: Sequence[Part]) -> None:
        position = 0
        places: list[_Place] = []
        constants: dict[int, bytes] = {}
        for part in parts:
            if isinstance(part, str):
                position += -position % 4
                text = part.encode() + b"\0"
                constants[position] = len(text).to_bytes(4, "little") + text
                position += 4 + len(text)
            else:
                size = np.dtype(part[1]).base.itemsize
                position += -position % size
                places.append(_Place(*part, _HEADER_BYTES + position))
                position += np.dtype(part[1]).itemsize
        self.length = _HEADER_BYTES + position
        self._template = np.zeros(self.length, dtype=np.uint8)
        self._template[:_HEADER_BYTES] = _HEADER
        for offset, text in constants.items():
            self._template[_HEADER_BYTES + offset :][: len(text)] = np.frombuffer(text, dtype=np.uint8)
        self._dtype = np.dtype(
            {
                "names": [place.name for place in places],
                "formats": [place.dtype for place in places],
                "offsets": [place.offset for place in places],
                "itemsize": self.length,
            }
        )

    def messages(self, rows: int, **columns: ArrayLike) -> list[bytes]:
        """So many messages; every column has that length, or one value for all."""
        raw: NDArray[np.uint8] = np.tile(self._template, (rows, 1))
        fields: Any = raw.reshape(-1).view(self._dtype)
        for name, values in columns.items():
            fields[name] = values
        data = raw.tobytes()
        return [data[begin : begin + self.length] for begin in range(0, len(data), self.length)]


def header(frame_id: str) -> tuple[Part, ...]:
    """A std_msgs/Header, whose stamp is `stamps`."""
    return ("sec", "<i4"), ("nanosec", "<u4"), frame_id


def stamps(times_ns: NDArray[np.int64]) -> dict[str, NDArray[np.int64]]:
    """The columns of a stamp."""
    return {"sec": times_ns // 1_000_000_000, "nanosec": times_ns % 1_000_000_000}


def doubles(*names: str) -> tuple[Part, ...]:
    """Columns of float64."""
    return tuple((name, "<f8") for name in names)


def floats(*names: str) -> tuple[Part, ...]:
    """Columns of float32."""
    return tuple((name, "<f4") for name in names)
