"""What the radio settles becomes rows: one per reception, and one for packets that were lost together."""

from __future__ import annotations

import math
from pathlib import Path

from bridge.record.tables.deliveries import FATES, DeliveryWriter
from channel.medium.reception import Fate
from tests.unit.bridge.radio.core import MTU_BYTES, place, send, virtual_radio
from tests.unit.bridge.record.tables.rows import read

NODES = ("0", "1", "gcs")


def test_receptions_and_gaps_become_rows(tmp_path: Path) -> None:
    core = virtual_radio("disk", NODES)
    place(core, 7, n0=0.0, n1=30.0, ngcs=1e6)
    send(core, "0", 5, 7, b"four")
    send(core, "1", 0, 7, bytes(MTU_BYTES + 1), to="gcs")
    writer = DeliveryWriter(tmp_path, NODES, core.words)
    for settled in (core.settle(), core.settle()):
        writer.write(settled.columns, settled.gaps, settled.received_ns)
    writer.close()
    found = read(tmp_path)
    rows = list(zip(*(found[n] for n in ("tx", "rx", "seq", "packets", "fate")), strict=True))
    assert rows == [
        ("0", "1", 5, 1, "delivered"),
        ("0", "gcs", 5, 1, "out_of_range"),
        ("0", "all", 0, 5, "transport"),
        ("1", "gcs", 0, 1, "too_long"),
    ]
    assert found["sim_time_ns"].tolist() == [7] * 4
    assert found["distance_m"][:2].tolist() == [30.0, 1e6]
    assert math.isnan(found["per"][2])
    assert found["length_bytes"].tolist()[3] == MTU_BYTES + 1


def test_every_fate_of_the_channel_can_be_written() -> None:
    assert {fate.value for fate in Fate} < set(FATES)
    assert len(set(FATES)) == len(FATES)
