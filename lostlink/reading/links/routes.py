"""By which nodes packets came, where nodes hand them on. Computed from the tables of routes and deliveries."""

from __future__ import annotations

from bisect import bisect_right
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bridge.radio.ledger_file import LEDGER, read_ledger
from bridge.record.tables.routes import read_routes
from lostlink.reading.rows import Deliveries

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


def routes_of(deliveries: Deliveries, ways: Mapping[str, Mapping[Ends, LinkWays]]) -> list[dict[str, Any]]:
    """A row per network and link: ``delivered``, ``hops_mean``, ``changes``, the most used ``way`` and its ``share``.

    Args:
        deliveries: of a run.
        ways: of the run.
    """
    nodes, found = deliveries.nodes, []
    for radio, by_link in ways.items():
        links = dict(sorted(by_link.items()))
        bounds = np.cumsum([0, *(len(each.nodes) for each in links.values())]).tolist()
        used = _times_used(deliveries, radio, links).tolist()
        for (tx, rx), each, begin, end in zip(links, links.values(), bounds, bounds[1:], strict=False):
            packets: Counter[Way] = Counter()
            for way, count in zip(each.nodes, used[begin:end], strict=True):
                packets[way] += count
            if not (total := packets.total()):
                continue  # of a record that broke off, or lost its deliveries
            [(most_used, most)] = packets.most_common(1)
            found.append(
                {
                    "radio": radio,
                    "tx": nodes[tx],
                    "rx": nodes[rx],
                    "delivered": total,
                    "hops_mean": sum(len(way) * count for way, count in packets.items()) / total,
                    "changes": len(each.nodes) - 1,
                    "way": [nodes[node] for node in most_used],
                    "share": most / total,
                }
            )
    return found


def _times_used(deliveries: Deliveries, radio: str, ways: Mapping[Ends, LinkWays]) -> NDArray[np.int64]:
    """How many packets came by each way, link by link."""
    nodes = len(deliveries.nodes)
    links = np.array([tx * nodes + rx for (tx, rx), each in ways.items() for _ in each.nodes])
    since_ns = np.array([at_ns for each in ways.values() for at_ns in each.since_ns])
    changes_ns = np.unique(since_ns)
    keys = links * (len(changes_ns) + 1) + np.searchsorted(changes_ns, since_ns, side="right")
    used = np.zeros(len(keys), dtype=np.int64)
    for rows in deliveries.parts("radio", "arrived_ns"):
        came = rows.at(rows.is_delivered & (rows.columns["radio"] == radio)).columns
        until = np.searchsorted(changes_ns, came["arrived_ns"], side="right")
        link = came["tx"] * nodes + came["rx"]  # of this network alone
        place = np.searchsorted(keys, link * (len(changes_ns) + 1) + until, side="right") - 1
        is_known = (place >= 0) & (links[place] == link)  # else its way was lost
        used += np.bincount(place[is_known], minlength=len(used))
    return used


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
