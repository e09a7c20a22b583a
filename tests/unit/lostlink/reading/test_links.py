"""Counts and series of links, against rows counted one by one."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from bridge.record.tables.deliveries import FATES, DeliveryWriter
from bridge.record.tables.every import finish_tables
from lostlink.reading.links.counts import link_counts, link_series

NODES = ("a", "b", "c")
LOST = ("channel_erasure", "out_of_range")


def write(run: Path, *, is_finished: bool) -> list[tuple[int, int, int, str]]:
    """Random fates of single packets, and 7 packets that node b lost together before the channel."""
    rng = np.random.default_rng(5)
    writer = DeliveryWriter(run, NODES)
    rows = []
    for tick in range(60):
        tx, rx = rng.choice(3, 2, replace=False)
        fate = str(rng.choice(["delivered", *LOST]))
        rows.append((tick * 50_000_000, int(tx), int(rx), fate))
        writer.append(
            1,
            sim_time_ns=rows[-1][0],
            tx=tx,
            rx=rx,
            seq=tick,
            length_bytes=40,
            distance_m=100.0 + tick,
            received_power_dbm=-70.0 - tick,
            snr_db=20.0,
            per=0.5,
            fate=FATES.index(fate),
            received_ns=0,
        )
    numbers = dict.fromkeys(("distance_m", "received_power_dbm", "snr_db", "per"), np.nan)
    writer.append(
        1,
        sim_time_ns=1_010_000_000,
        tx=1,
        rx=writer.everybody,
        seq=99,
        packets=7,
        length_bytes=40,
        fate=FATES.index("transport"),
        received_ns=0,
        **numbers,
    )
    writer.close()
    if is_finished:
        finish_tables(run)
    return rows


@pytest.mark.parametrize("is_finished", [True, False])
def test_counts_by_link_and_cause(tmp_path: Path, is_finished: bool) -> None:
    rows = write(tmp_path, is_finished=is_finished)
    found = link_counts(tmp_path, NODES)
    expected = Counter((NODES[tx], NODES[rx], fate) for _, tx, rx, fate in rows)
    for i, (tx, rx) in enumerate(zip(found["tx"], found["rx"], strict=True)):
        assert found["delivered"][i] == expected[tx, rx, "delivered"]
        for cause in LOST:
            assert found[cause][i] == expected[tx, rx, cause]
        assert found["transport"][i] == (7 if tx == "b" else 0)
        assert found["sent"][i] == sum(expected[tx, rx, f] for f in (*LOST, "delivered")) + (
            7 if tx == "b" else 0
        )
    assert list(zip(found["tx"], found["rx"], strict=True)) == sorted(
        {(t, r) for t, r, _ in expected} | {("b", "a"), ("b", "c")}
    )


def test_series_has_counts_and_means_of_each_period(tmp_path: Path) -> None:
    rows = write(tmp_path, is_finished=True)
    found = link_series(tmp_path, NODES, 1_000_000_000)
    assert found["sent"].sum() == 60 + 14
    for i, (begin, tx, rx) in enumerate(zip(found["sim_time_ns"], found["tx"], found["rx"], strict=True)):
        inside = [
            (t, f) for t, s, r, f in rows if t // 10**9 * 10**9 == begin and (NODES[s], NODES[r]) == (tx, rx)
        ]
        lost_together = 7 if tx == "b" and begin == 10**9 else 0
        assert found["sent"][i] == len(inside) + lost_together
        assert found["delivered"][i] == sum(f == "delivered" for _, f in inside)
        powers = [-70.0 - t / 50_000_000 for t, _ in inside]
        if powers:
            assert found["received_power_dbm"][i] == pytest.approx(np.mean(powers))
        else:
            assert np.isnan(found["received_power_dbm"][i])
    with pytest.raises(ValueError, match="above 0"):
        link_series(tmp_path, NODES, 0)


def test_a_run_without_packets_has_no_links(tmp_path: Path) -> None:
    DeliveryWriter(tmp_path, NODES).close()
    assert len(link_counts(tmp_path, NODES)["tx"]) == 0
    assert len(link_series(tmp_path, NODES, 10**9)["tx"]) == 0
