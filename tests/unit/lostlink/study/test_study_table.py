"""The table of a study that cannot be written."""

from __future__ import annotations

import errno
import re
from pathlib import Path
from typing import Any

import pytest

from lostlink.study.model import StudyError
from lostlink.study.table import write_table


def test_a_full_disk_is_told_with_the_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object, **__: object) -> None:
        raise OSError(errno.ENOSPC, "Error writing bytes to file")

    path = tmp_path / "metrics.parquet"
    monkeypatch.setattr("pyarrow.parquet.write_table", full)
    with pytest.raises(StudyError, match=f"^{re.escape(str(path))}: .*bytes to file; no table was written$"):
        write_table([{"x": 1}], path)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("values", [(1, "one"), (1, 1 << 70)])
def test_a_table_of_before_is_told_of_and_stays(tmp_path: Path, values: tuple[Any, ...]) -> None:
    path = tmp_path / "metrics.parquet"
    rows = [{"x": value} for value in values]
    with pytest.raises(StudyError, match=r"; no table was written(: a metric has|$)"):
        write_table(rows, path)
    assert not list(tmp_path.iterdir())
    write_table([{"x": 1}], path)
    before = path.read_bytes()
    with pytest.raises(
        StudyError, match=f"; no table was written, and {re.escape(str(path))} is that of before"
    ):
        write_table(rows, path)
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]
