"""The table of a study that cannot be written."""

from __future__ import annotations

import errno
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from lostlink.study.model import StudyError
from lostlink.study.table import write_table

DRAWN = """
import psutil
from pathlib import Path
from lostlink.study.study import Study

ours = Study({"schema": 1, "name": "s", "scenario": "separation", "seeds": [1], "figures": "own.py:draw"}, Path())
rows = [{"seed": 1, "x": [0.5]}]
ours.directory.mkdir()
ours.write(rows)
before = psutil.Process().num_threads()
assert not list(ours.draw(rows))
assert psutil.Process().num_threads() == before
"""


def test_figures_have_the_table_and_no_threads_of_arrow(tmp_path: Path) -> None:
    """Which can abort a process that ends."""
    own = "def draw(table, folder): (folder / 'table').write_text(f'{table.seed[0]} {table.x[0].tolist()}')\n"
    (tmp_path / "own.py").write_text(own)
    subprocess.run([sys.executable, "-c", DRAWN], check=True, cwd=tmp_path, timeout=60)
    assert (tmp_path / "s" / "table").read_text() == "1 [0.5]"


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
