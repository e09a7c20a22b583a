"""What the packets of a run show: links, causes over time, power and delivery over distance."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bridge.radio.ledger_file import BINS_OF_PACKETS
from bridge.record.tables.deliveries import FATES
from channel.medium.ledger import BIN_WIDTH_M
from lostlink.reading.ages import LinkTimes, link_ages, link_latencies
from lostlink.reading.links.counts import counts_of
from lostlink.reading.rows import Deliveries, counts_by_name, most_links, named_links
from lostlink.report.scales import nice_step, rows_of

PERIODS_MAX = 150
BOXES_MAX = 12
BOX_LEAST_M = 10.0
WHISKER = 1.5
"""Whiskers end at the last value within so many interquartile ranges of the box (Tukey)."""
LINKS_APART_MAX = 8
"""Of more links than this the ages over time are shown together."""


def links_of(deliveries: Deliveries, times: Sequence[LinkTimes], end_ns: int) -> list[dict[str, Any]]:
    """A row per directed link of a radio network: counts, ``delivery``, ``lost`` by cause, latency and age in s.

    Args:
        deliveries: of a run.
        times: of its links, in their order.
        end_ns: the end of the run.
    """
    counts, ages, latencies = counts_of(deliveries), link_ages(times, end_ns), link_latencies(times)
    told = ("radio", "tx", "rx", "sent", "delivered")
    causes = [name for name in counts if name not in told]
    found = []
    for count, age, latency in zip(rows_of(counts), rows_of(ages), rows_of(latencies), strict=True):
        found.append(
            {name: count[name] for name in told}
            | {"delivery": count["delivered"] / count["sent"] if count["sent"] else None}
            | {"lost": {cause: count[cause] for cause in causes if count[cause]}}
            | {f"latency_{name}": latency[name] for name in ("mean_s", "p95_s", "max_s")}
            | {f"age_{name}": age[name] for name in ("mean_s", "p95_s", "peak_s")}
        )
    return found


def totals_of(links: list[dict[str, Any]]) -> dict[str, Any]:
    """Sums over links: ``sent``, ``delivered``, ``delivery``, ``lost`` by cause; means and worst of what is timed."""
    sent, delivered = (sum(link[name] for link in links) for name in ("sent", "delivered"))
    lost: dict[str, int] = {}
    for link in links:
        for cause, count in link["lost"].items():
            lost[cause] = lost.get(cause, 0) + count
    return {
        "sent": sent,
        "delivered": delivered,
        "delivery": delivered / sent if sent else None,
        "lost": dict(sorted(lost.items())),
        "latency_mean_s": _mean(links, "latency_mean_s"),
        "latency_max_s": _most(links, "latency_max_s"),
        "age_mean_s": _mean(links, "age_mean_s"),
        "age_p95_s": _most(links, "age_p95_s"),
        "age_peak_s": _most(links, "age_peak_s"),
    }


def networks_of(links: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """A row per radio network that carried a packet: its name, ``radio``, and what `totals_of` its links has."""
    names = dict.fromkeys(link["radio"] for link in links)
    return [{"radio": name} | totals_of([link for link in links if link["radio"] == name]) for name in names]


def _mean(links: list[dict[str, Any]], name: str) -> float | None:
    values = [link[name] for link in links if np.isfinite(link[name])]
    return float(np.mean(values)) if values else None


def _most(links: list[dict[str, Any]], name: str) -> float | None:
    return max((link[name] for link in links if np.isfinite(link[name])), default=None)


def losses_of(deliveries: Deliveries, end_ns: int) -> dict[str, Any]:
    """Packets by fate in each period: ``period_s``, ``sim_time_s`` (begins), ``delivered``, ``lost`` by cause."""
    period_ns = period_of(end_ns)
    cells = np.zeros((end_ns // period_ns + 1, len(FATES)), dtype=np.int64)
    for rows in deliveries.parts("sim_time_ns"):
        period = rows.columns["sim_time_ns"] // period_ns
        cells.resize((max(len(cells), int(period.max(initial=0)) + 1), len(FATES)), refcheck=False)
        rows.add_to(cells, period)
    counts = counts_by_name(cells)
    del counts["sent"]
    return {
        "period_s": period_ns / 1e9,
        "sim_time_s": np.arange(len(cells)) * (period_ns / 1e9),
        "delivered": counts.pop("delivered"),
        "lost": counts,
    }


def period_of(end_ns: int) -> int:
    """A period of which up to PERIODS_MAX are a run, ns."""
    return round(nice_step(end_ns / 1e9, PERIODS_MAX, 0.1) * 1e9)


def link_name(tx: str, rx: str, radio: str, *, is_only: bool) -> str:
    """What a link is called; with the name of its radio network, unless the scenario has only one."""
    return f"{tx} to {rx}" if is_only else f"{radio}: {tx} to {rx}"


def ages_of(times: Sequence[LinkTimes], deliveries: Deliveries, end_ns: int) -> dict[str, Any]:
    """The greatest age in each period: of each link, or of many the median and the greatest of all of a radio network.

    ``deliveries`` are those of which the times are.
    ``period_s``, ``sim_time_s`` (begins), ``end_s`` (of the last) and ``series[]`` of ``name`` and ``age_s``.
    """
    period_ns = period_of(end_ns)
    edges = np.arange(0, end_ns + period_ns, period_ns, dtype=np.int64)
    edges = np.append(edges[edges < end_ns], end_ns)
    series = [link.sawtooth(end_ns).greatest(edges) for link in times]
    links = named_links(np.array([each.link for each in times], dtype=np.int64), deliveries)
    is_only = len(deliveries.networks) == 1
    names = [link_name(**row, is_only=is_only) for row in rows_of(links)]
    told = list(zip(names, series, strict=True))
    if len(series) > LINKS_APART_MAX:
        told = []
        for radio in dict.fromkeys(links["radio"].tolist()):
            together = np.array(series)[links["radio"] == radio]
            on = "" if is_only else f"{radio}: "
            told += [
                (f"{on}median of {len(together)} links", _across(together, np.nanmedian)),
                (f"{on}the oldest of all", _across(together, np.nanmax)),
            ]
    return {
        "period_s": period_ns / 1e9,
        "sim_time_s": edges[:-1] / 1e9,
        "end_s": end_ns / 1e9,
        "series": [{"name": name, "age_s": values} for name, values in told],
    }


def _across(series: NDArray[np.float64], figure: Callable[..., Any]) -> NDArray[np.float64]:
    """A figure of all series in each period; nan where none has a value."""
    has_any = np.isfinite(series).any(axis=0)
    found = np.full(series.shape[1], np.nan)
    found[has_any] = figure(series[:, has_any], axis=0)
    return found


def powers_of(deliveries: Deliveries) -> dict[str, Any]:
    """Received power by distance: ``width_m``, ``boxes[]``, and ``beyond``: packets farther off than any with a power.

    A box has ``distance_min_m`` (inside), ``distance_max_m``, ``packets``, ``without_power`` of them (no draw could
    have saved them, so none was made), and of the others ``low``, ``q1``, ``median``, ``q3``, ``high`` in dBm.
    """
    farthest_m = 0.0
    for distance_m, power_dbm in _powers(deliveries):
        farthest_m = float(distance_m[np.isfinite(power_dbm)].max(initial=farthest_m))
    width_m = nice_step(farthest_m, BOXES_MAX, BOX_LEAST_M)
    boxes = int(farthest_m // width_m) + 1
    packets, beyond = np.zeros(boxes, dtype=np.int64), 0
    inside: list[list[NDArray[np.float64]]] = [[] for _ in range(boxes)]
    for distance_m, power_dbm in _powers(deliveries):
        number = (distance_m // width_m).astype(np.int64)
        is_near = number < boxes
        packets += np.bincount(number[is_near], minlength=boxes)
        beyond += int(np.count_nonzero(~is_near))
        for box, powers in enumerate(inside):
            powers.append(power_dbm[(number == box) & np.isfinite(power_dbm)])
    return {
        "width_m": width_m,
        "beyond": beyond,
        "boxes": [
            {"distance_min_m": n * width_m, "distance_max_m": (n + 1) * width_m, **_box(count, powers)}
            for n, (count, powers) in enumerate(zip(packets.tolist(), inside, strict=True))
            if count
        ],
    }


def _powers(deliveries: Deliveries) -> Iterator[tuple[NDArray[np.float64], NDArray[np.float64]]]:
    """Distances that are known, and the powers received over them."""
    for rows in deliveries.parts("distance_m", "received_power_dbm"):
        known = np.isfinite(rows.columns["distance_m"])
        yield rows.columns["distance_m"][known], rows.columns["received_power_dbm"][known]


def _box(packets: int, powers: Sequence[NDArray[np.float64]]) -> dict[str, Any]:
    power_dbm = np.concatenate(powers)
    counts = {"packets": packets, "without_power": packets - len(power_dbm)}
    if not power_dbm.size:
        return counts | dict.fromkeys(("low", "q1", "median", "q3", "high"))
    q1, median, q3 = np.percentile(power_dbm, (25, 50, 75), overwrite_input=True)
    reach = WHISKER * (q3 - q1)
    low = power_dbm.min(initial=np.inf, where=power_dbm >= q1 - reach)
    high = power_dbm.max(initial=-np.inf, where=power_dbm <= q3 + reach)
    return counts | {"low": low, "q1": q1, "median": median, "q3": q3, "high": high}


def bins_of(deliveries: Deliveries) -> list[dict[str, Any]]:
    """Delivery by link and distance, as the ledger has it, but without what the model predicts."""
    links = most_links(deliveries)
    parts = [np.empty((3, 0), dtype=np.int64)]
    for rows in deliveries.parts("distance_m"):
        known = np.isfinite(rows.columns["distance_m"])
        number = (rows.columns["distance_m"][known] // BIN_WIDTH_M).astype(np.int64)
        keys = number * links + rows.link[known]
        parts.append(_summed(keys, np.ones(len(keys)), rows.is_delivered[known]))
    number_of_link, sent, delivered = _summed(*np.concatenate(parts, axis=1))
    number, link = np.divmod(number_of_link, links)
    low_m = number * BIN_WIDTH_M
    columns = {
        **named_links(link, deliveries),
        "distance_min_m": low_m,
        "distance_max_m": low_m + BIN_WIDTH_M,
    }
    shares = {"sent": sent, "delivered": delivered, "measured": delivered / np.maximum(sent, 1)}
    found = rows_of({name: values[np.lexsort((number, link))] for name, values in (columns | shares).items()})
    return [row | {"of": BINS_OF_PACKETS, "predicted": None, "ci99": None} for row in found]


def _summed(keys: NDArray[np.int64], *weights: NDArray[Any]) -> NDArray[np.int64]:
    """The keys that occur, rising, and sums of each one's weights."""
    found, place = np.unique(keys, return_inverse=True)
    sums = [np.bincount(place, each, len(found)).astype(np.int64) for each in weights]
    return np.stack([found, *sums])
