"""Routes in the live view: of the latest packet by the instant that is shown, from what is written so far."""

from __future__ import annotations

import asyncio
from pathlib import Path

from bridge.record.tables.every import finish_tables
from bridge.record.tables.routes import RouteWriter
from channel.network.network import RadioRoute
from lostlink.view.sources.routes import RoutesOfRun

NODES = ("0", "1", "2", "gcs")


def test_the_way_is_that_of_the_latest_packet_by_then(tmp_path: Path) -> None:
    now_ns = 0
    told: list[str] = []
    routes = RoutesOfRun(tmp_path, NODES, lambda: now_ns, told.append)
    asyncio.run(routes.read())
    assert routes.of("main", 0, 3) == ()
    writer = RouteWriter(tmp_path, NODES, ["main", "mesh"])
    writer.write([("main", RadioRoute(5, 0, 3, 7, 10, (0,))), ("mesh", RadioRoute(5, 0, 3, 8, 12, (0, 2)))])
    writer.write([("main", RadioRoute(15, 0, 3, 9, 20, (0, 1, 2)))])
    writer.flush()
    asyncio.run(routes.read())
    shown = {}
    for now_ns in (9, 10, 19, 20, 99):
        shown[now_ns] = routes.of("main", 0, 3)
    assert routes.of("mesh", 0, 3) == (0, 2)
    assert shown == {9: (), 10: (0,), 19: (0,), 20: (0, 1, 2), 99: (0, 1, 2)}
    assert routes.of("main", 3, 0) == ()
    writer.write([("main", RadioRoute(25, 0, 3, 11, 30, (0, 2)))])
    writer.close()
    finish_tables(tmp_path)
    asyncio.run(routes.read())
    assert routes.of("main", 0, 3) == (0, 2)
    assert not told
