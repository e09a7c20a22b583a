"""Columns from bytes are those that pyarrow makes, and no pandas comes with them."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pyarrow as pa
from hypothesis import given
from hypothesis import strategies as st

from bridge.record.tables.columns import numbers, texts, values_of

KINDS = ["?", "i1", "<i2", "<i4", "<i8", "<u4", "<f4", "<f8"]


@given(kind=st.sampled_from(KINDS), bits=st.binary(max_size=200), start=st.integers(0, 20))
def test_numbers_there_and_back(kind: str, bits: bytes, start: int) -> None:
    dtype = np.dtype(kind)
    values = np.frombuffer(bits[: len(bits) // dtype.itemsize * dtype.itemsize], np.uint8)
    values = values % 2 == 1 if kind == "?" else values.view(dtype)
    column = numbers(values)
    column.validate(full=True)
    assert column.type == pa.array(values).type
    assert column.null_count == 0
    assert values_of(column).tobytes() == values.tobytes()
    assert values_of(column.slice(start)).tobytes() == values[start:].tobytes()


@given(st.lists(st.text(st.characters(exclude_categories=["Cs"]), max_size=20)))
def test_texts_are_those_of_pyarrow(values: list[str]) -> None:
    column = texts(values)
    column.validate(full=True)
    assert column.equals(pa.array(values, pa.string()))


def test_what_is_missing_is_seen() -> None:
    assert np.isnan(values_of(pa.array([1.0, None]))[1])


def test_a_table_is_written_and_read_without_pandas(tmp_path: Path) -> None:
    script = f"""
import sys
import numpy as np, pyarrow as pa, pyarrow.parquet as pq
from bridge.record.tables.columns import numbers, texts, values_of
table = pa.table([numbers(np.arange(3.0)), numbers(np.array([True, False, True])),
    pa.DictionaryArray.from_arrays(numbers(np.array([0, 1, 0], np.int16)), texts(["a", "b"]))], names=["x", "y", "z"])
pq.write_table(table, "{tmp_path}/table.parquet")
with open("{tmp_path}/table.parquet", "rb") as source:
    (batch,) = pq.ParquetFile(source).iter_batches(10, use_threads=False)
assert values_of(batch.column("x")).tolist() == [0.0, 1.0, 2.0]
assert values_of(batch.column("y")).tolist() == [True, False, True]
assert values_of(batch.column("z").indices).tolist() == [0, 1, 0]
print("pandas" in sys.modules)
"""
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    assert (done.stdout.strip(), done.returncode) == ("False", 0), done.stderr
