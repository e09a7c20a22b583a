"""deliveries.csv reads back as it was written, and a broken one is refused with its line."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from bridge.radio.deliveries import COLUMNS, DeliveriesWriter, DeliveryRow, read_deliveries

ROW = DeliveryRow(50_000_000, "0", "1", 7, 40, 123.456, -330.25, 9.75, 1.25e-5, "delivered")
LOST = DeliveryRow(1, "0", "gcs", 8, 0, math.nan, math.nan, math.nan, math.nan, "transport")


def test_rows_come_back(tmp_path: Path) -> None:
    writer = DeliveriesWriter(tmp_path / "d.csv")
    writer.write([ROW, LOST])
    writer.close()
    first, second = read_deliveries(tmp_path / "d.csv")
    assert first == ROW
    assert (second.rx, second.fate, math.isnan(second.per)) == ("gcs", "transport", True)
    assert (tmp_path / "d.csv").read_text().splitlines()[0] == ",".join(COLUMNS)


@pytest.mark.parametrize(
    ("text", "line"),
    [("a,b\n", 1), (",".join(COLUMNS) + "\n1,0,1\n", 2), (",".join(COLUMNS) + "\n" + "x," * 10, 2)],
)
def test_broken_file_is_refused_with_its_line(tmp_path: Path, text: str, line: int) -> None:
    (tmp_path / "d.csv").write_text(text)
    with pytest.raises(ValueError, match=rf"d\.csv:{line}: "):
        list(read_deliveries(tmp_path / "d.csv"))
