"""Columns as Arrow takes them, from their bytes: `pyarrow.array` imports all of pandas first, if there is one."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import accumulate
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    import pyarrow as pa


def numbers(values: NDArray[Any]) -> pa.Array:
    """Numbers or truth values, none missing.

    Args:
        values: shape (n,).
    """
    import pyarrow as pa

    content = np.packbits(values, bitorder="little") if values.dtype == bool else np.ascontiguousarray(values)
    return pa.Array.from_buffers(
        pa.from_numpy_dtype(values.dtype), len(values), [None, pa.py_buffer(content)], null_count=0
    )


def name_type() -> pa.DataType:
    """Of columns of names: of nodes, say, by which tables are joined."""
    import pyarrow as pa

    return pa.dictionary(pa.int16(), pa.string())


def names(values: Sequence[str] | Sequence[bytes]) -> pa.DictionaryArray:
    """Texts of which few are different, in the order in which they come up."""
    import pyarrow as pa

    own: dict[str | bytes, int] = {}
    places = np.array([own.setdefault(value, len(own)) for value in values], dtype=np.int16)
    found = [value if isinstance(value, str) else value.decode(errors="replace") for value in own]
    return pa.DictionaryArray.from_arrays(numbers(places), texts(found))


def texts(values: Sequence[str]) -> pa.Array:
    """Texts, none missing."""
    import pyarrow as pa

    encoded = [value.encode() for value in values]
    ends = np.array([0, *accumulate(map(len, encoded))], dtype=np.int32)
    return pa.Array.from_buffers(
        pa.string(), len(encoded), [None, pa.py_buffer(ends), pa.py_buffer(b"".join(encoded))], null_count=0
    )


def values_of(column: pa.Array) -> NDArray[Any]:
    """Numbers or truth values of a column as numpy has them; not to be written to.

    Returns:
        Shape (n,), of the column's type; of float or object if some are missing.
    """
    import pyarrow as pa

    if column.null_count or not len(column):
        missing: NDArray[Any] = column.to_numpy(zero_copy_only=False)
        return missing
    content, end = column.buffers()[1], column.offset + len(column)
    if pa.types.is_boolean(column.type):
        bits = np.frombuffer(content, np.uint8)
        return np.unpackbits(bits, count=end, bitorder="little")[column.offset :].astype(bool)
    return np.frombuffer(content, column.type.to_pandas_dtype(), end)[column.offset :]
