"""What became of each link's packets: counts over a run, and over its time. Computed from the table of deliveries."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bridge.bus.keys import MAIN
from bridge.record.tables.deliveries import FATES, FIGURES
from bridge.record.tables.schema import Columns
from lostlink.reading.rows import (
    Deliveries,
    RecordedDeliveries,
    counts_by_name,
    link_rows,
    most_links,
    named_links,
)


def link_counts(run: Path, nodes: tuple[str, ...], networks: tuple[str, ...] = (MAIN,)) -> Columns:
    """A row per directed link of a radio network that had a packet, with a column per cause of loss.

    The others are ``radio``, ``tx``, ``rx``, ``sent`` and ``delivered``.

    Args:
        run: the run directory.
        nodes: ids of all its nodes, which is the order of rows.
        networks: names of the radio networks that links are told apart by.

    Raises:
        TableError, OSError: the deliveries cannot be read.
    """
    return counts_of(RecordedDeliveries(run, nodes, networks))


def counts_of(deliveries: Deliveries) -> Columns:
    """As `link_counts`, of any deliveries."""
    cells = np.zeros((most_links(deliveries), len(FATES)), dtype=np.int64)
    occurs = np.zeros(len(cells), dtype=np.bool_)
    for rows in deliveries.parts():
        rows.add_to(cells, rows.link)
        occurs[rows.link] = True
    links = np.flatnonzero(occurs)
    return {**named_links(links, deliveries), **counts_by_name(cells[links])}


def link_series(
    run: Path, nodes: tuple[str, ...], period_ns: int, networks: tuple[str, ...] = (MAIN,)
) -> Columns:
    """A row per period of sim time and directed link with packets in it, by time, then network, sender, receiver.

    ``sim_time_ns`` is the period's begin. ``distance_m``, ``received_power_dbm``, ``snr_db`` and ``per`` are means over
    the packets for which the channel computed them (of decibels: the mean of decibels); nan if there are none.

    Raises:
        ValueError: the period is not above 0.
        TableError, OSError: the deliveries cannot be read.
    """
    if period_ns <= 0:
        raise ValueError(f"a period of {period_ns} ns; it has to be above 0")
    rows = link_rows(run, nodes, ("sim_time_ns", *FIGURES), networks)
    columns, links = rows.columns, most_links(rows)
    bins, place = np.unique(columns["sim_time_ns"] // period_ns * links + rows.link, return_inverse=True)
    counts = counts_by_name(rows.cells(place, len(bins)))
    return {
        "sim_time_ns": bins // links * period_ns,
        **named_links(bins % links, rows),
        "sent": counts["sent"],
        "delivered": counts["delivered"],
        **{name: means(columns[name], place, len(bins)) for name in FIGURES},
    }


def means(values: NDArray[np.float64], place: NDArray[np.integer], groups: int) -> NDArray[np.float64]:
    """The mean of each group's finite values, shape (groups,); nan of none. ``place`` is each value's group."""
    known = np.isfinite(values)
    total = np.bincount(place[known], values[known], groups)
    count = np.bincount(place[known], minlength=groups)
    found = np.full(groups, np.nan)
    np.divide(total, count, out=found, where=count > 0)
    return found
