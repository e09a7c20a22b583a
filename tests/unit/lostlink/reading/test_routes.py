"""Ways of packets from a run's tables: of each delivery that of the change before it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from bridge.record.tables.deliveries import DELIVERED
from bridge.record.tables.routes import RouteWriter
from channel.network.network import RadioRoute
from lostlink.reading.links.routes import routes_of, ways_of
from lostlink.reading.rows import DeliveryRows

NODES = ("0", "1", "2", "gcs")
NETWORKS = ("main", "mesh")


@pytest.mark.parametrize("radio", ["main", "mesh"])
def test_hops_and_the_most_used_way_are_counted_over_deliveries(tmp_path: Path, radio: str) -> None:
    """Five packets: one directly, then three over two others, then one that was lost, and one over one other."""
    writer = RouteWriter(tmp_path, NODES, NETWORKS)
    ways = ((10, (0,)), (20, (0, 1, 2)), (60, (0, 2)))
    writer.write([(radio, RadioRoute(0, 0, 3, 0, arrived_ns, nodes)) for arrived_ns, nodes in ways])
    writer.close()
    arrived_ns = np.array([10, 20, 30, 40, 50, 60])
    count = arrived_ns.size
    columns = {
        "tx": np.zeros(count, dtype=np.intp),
        "rx": np.full(count, 3),
        "packets": np.ones(count, dtype=np.int32),
        "fate": np.array([DELIVERED] * 4 + [DELIVERED + 1, DELIVERED]),
        "radio": np.full(count, radio, dtype=object),
        "arrived_ns": arrived_ns,
    }
    rows = DeliveryRows(NODES, columns, NETWORKS)
    assert routes_of(rows.at(columns["rx"] == 0), ways_of(tmp_path, NODES)) == []
    [found] = routes_of(rows, ways_of(tmp_path, NODES))
    assert found == {
        "radio": radio,
        "tx": "0",
        "rx": "gcs",
        "delivered": 5,
        "hops_mean": (1 + 3 * 3 + 2) / 5,
        "changes": 2,
        "way": ["0", "1", "2"],
        "share": 3 / 5,
    }
    earlier = DeliveryRows(NODES, columns | {"arrived_ns": arrived_ns - 10}, NETWORKS)
    [found] = routes_of(earlier, ways_of(tmp_path, NODES))
    assert found["delivered"] == 4, "the way of the first was lost"


def test_a_run_whose_nodes_hand_nothing_on_has_no_ways(tmp_path: Path) -> None:
    assert ways_of(tmp_path, NODES) == {}
