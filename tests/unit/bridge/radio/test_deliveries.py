"""Rows of the radio become columns, and its fates are those of the channel and its own."""

from __future__ import annotations

import math
from pathlib import Path

from bridge.radio.deliveries import FATES, DeliveryColumns, DeliveryRow
from channel.medium.reception import Fate
from tests.unit.bridge.record.tables.rows import read

ROW = DeliveryRow(50_000_000, "0", "1", 7, 40, 123.456, -330.25, 9.75, 1.25e-5, "delivered")
LOST = DeliveryRow(1, "0", "gcs", 8, 0, math.nan, math.nan, math.nan, math.nan, "transport")


def test_rows_come_back(tmp_path: Path) -> None:
    writer = DeliveryColumns(tmp_path, ("0", "1", "gcs"))
    writer.write([ROW, LOST])
    writer.write([])
    writer.close()
    found = read(tmp_path)
    assert tuple(values[0] for values in found.values()) == tuple(
        getattr(ROW, n) for n in DeliveryRow.__slots__
    )
    assert (found["rx"][1], found["fate"][1], math.isnan(found["per"][1])) == ("gcs", "transport", True)


def test_every_fate_of_the_channel_can_be_written() -> None:
    assert {fate.value for fate in Fate} < set(FATES)
    assert len(set(FATES)) == len(FATES)
