"""By which nodes packets came, where nodes hand them on. Computed from the tables of routes and deliveries."""

from __future__ import annotations

from bisect import bisect_right
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from bridge.radio.ledger_file import LEDGER, read_ledger
from bridge.record.tables.routes import read_routes
from lostlink.reading.rows import DeliveryRows

Way = tuple[int, ...]
"""Who transmitted a packet, from its sender on."""
Ends = tuple[int, int]
"""Of a link: places of sender and receiver."""


class LinkWays(NamedTuple):
    """The ways on one link as they changed.

    Attributes:
        since_ns: when the first packet came by each, rising.
        nodes: of each way.
    """

    since_ns: list[int]
    nodes: list[Way]

    def at(self, sim_time_ns: int) -> Way:
        """The way of the latest packet that had come by an instant; empty: none had."""
        place = bisect_right(self.since_ns, sim_time_ns)
        return self.nodes[place - 1] if place else ()


def ways_of(run: Path, nodes: Sequence[str]) -> dict[str, dict[Ends, LinkWays]]:
    """The ways on each link, by the name of the radio network; empty if no network hands packets on.

    Raises:
        TableError, OSError: the table is damaged, or cannot be read.
    """
    columns = read_routes(run, nodes)
    names = ("radio", "tx", "rx", "arrived_ns", "node")
    found: dict[str, dict[Ends, LinkWays]] = {}
    for radio, tx, rx, arrived_ns, node in zip(*(columns[name].tolist() for name in names), strict=True):
        ways = found.setdefault(radio, {}).setdefault((tx, rx), LinkWays([], []))
        if ways.since_ns and ways.since_ns[-1] == arrived_ns:
            ways.nodes[-1] = (*ways.nodes[-1], node)
        else:
            ways.since_ns.append(arrived_ns)
            ways.nodes.append((node,))
    return found


def routes_of(rows: DeliveryRows, ways: Mapping[str, Mapping[Ends, LinkWays]]) -> list[dict[str, Any]]:
    """A row per network and link: ``delivered``, ``hops_mean``, ``changes``, the most used ``way`` and its ``share``.

    Args:
        rows: one for each receiver, with ``radio`` and ``arrived_ns``.
        ways: of the run.
    """
    came = rows.at(rows.is_delivered)
    found = []
    for radio, by_link in ways.items():
        for (tx, rx), each in sorted(by_link.items()):
            c = came.columns
            mine = (c["radio"] == radio) & (c["tx"] == tx) & (c["rx"] == rx)
            places = np.searchsorted(each.since_ns, c["arrived_ns"][mine], side="right") - 1
            packets: Counter[Way] = Counter()
            for place, count in zip(*np.unique(places, return_counts=True), strict=True):
                packets[each.nodes[int(place)]] += int(count)
            if not packets:
                continue  # of a record that broke off, or lost its deliveries
            [(way, most)], total = packets.most_common(1), packets.total()
            found.append(
                {
                    "radio": radio,
                    "tx": rows.nodes[tx],
                    "rx": rows.nodes[rx],
                    "delivered": total,
                    "hops_mean": sum(len(nodes) * count for nodes, count in packets.items()) / total,
                    "changes": len(each.nodes) - 1,
                    "way": [rows.nodes[node] for node in way],
                    "share": most / total,
                }
            )
    return found


def on_air_ns(run: Path) -> dict[str, int]:
    """How long frames were on the air on each network that has routing, added up; errors as of `routing_counts`."""
    return {each["radio"]: each["packet_air_ns"] + each["notice_air_ns"] for each in routing_counts(run)}


def routing_counts(run: Path) -> list[dict[str, Any]]:
    """What routing cost each network that has it, as the run's counters say; empty of a run without an end.

    Raises:
        OSError, ValueError: the file cannot be read, or is damaged.
    """
    counts: list[dict[str, Any]] = read_ledger(run / LEDGER).get("routing", [])
    return counts
