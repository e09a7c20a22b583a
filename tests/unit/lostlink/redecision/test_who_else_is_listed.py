"""A run's record with nodes listed in another order, and with more of them far away."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import pytest

from bridge.bus.messages import Header, Quaternion, Truth, Vector3
from bridge.record.tables.deliveries import DELIVERIES
from bridge.record.tables.reader import read_columns
from tests.unit.lostlink.replay.flown import TICK_NS, Router, Sent, scenario_of

TICKS = 12
NODES = ("1", "b", "c", "d")
PLACES = {
    "1": (0.0, 0.0, -40.0),
    "b": (200.0, 0.0, -40.0),
    "c": (0.0, 300.0, -40.0),
    "d": (900.0, 100.0, -40.0),
    "0": (3e7, 0.0, -40.0),
    "away": (3.1e7, 0.0, -40.0),
}
LISTS = {
    "far ones last": (*NODES, "0", "away"),
    "far ones first": ("away", "0", *NODES),
    "turned": NODES[::-1],
}


def rows_of(path: Path, nodes: Sequence[str], radio: str) -> dict[tuple[str, int, str], tuple[object, ...]]:
    """Rows of a run between the four, by sender, number and receiver."""
    router = Router(path, scenario_of(radio, nodes, seed=5))
    for tick in range(TICKS):
        truths = [
            Truth(
                Header.at(tick * TICK_NS, node),
                position_ned_m=Vector3(*PLACES[node]),
                attitude=Quaternion(),
            )
            for node in nodes
        ]
        router.tick(tick * TICK_NS, truths, [Sent(node) for node in nodes if node in NODES for _ in range(3)])
    table = read_columns(router.close(), DELIVERIES)
    columns = ("fate", "started_ns", "ended_ns", "arrived_ns", "attempts", "received_power_dbm", "snr_db")
    rows = zip(*(table[name].tolist() for name in ("tx", "seq", "rx", *columns)), strict=True)
    return {(tx, seq, rx): tuple(map(repr, rest)) for tx, seq, rx, *rest in rows if rx in NODES}


@pytest.mark.slow
@pytest.mark.parametrize("radio", ["wifi-2.4", "lte-uav"])
def test_in_the_record_of_a_run_far_nodes_change_nothing_wherever_they_are_listed(
    radio: str, tmp_path: Path
) -> None:
    reach = f"{{preset: {radio}, max_range_m: 60000}}"
    alone = rows_of(tmp_path / "alone", NODES, reach)
    assert len(alone) == TICKS * 3 * 4 * 3
    for name, nodes in LISTS.items():
        assert rows_of(tmp_path / name.replace(" ", "-"), nodes, reach) == alone, name
