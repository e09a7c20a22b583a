"""What the packets of a run show: links, causes over time, power and delivery over distance."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bridge.radio.ledger_file import BINS_OF_PACKETS
from channel.medium.ledger import BIN_WIDTH_M
from lostlink.reading.ages import NEEDED, LinkTimes, link_ages, link_latencies
from lostlink.reading.links.counts import counts_of
from lostlink.reading.rows import DeliveryRows
from lostlink.report.scales import nice_step, rows_of

COLUMNS = (*NEEDED, "radio", "distance_m", "received_power_dbm")
"""Of the deliveries, that all this is made of."""
PERIODS_MAX = 150
BOXES_MAX = 12
BOX_LEAST_M = 10.0
WHISKER = 1.5
"""Whiskers end at the last value within so many interquartile ranges of the box (Tukey)."""
LINKS_APART_MAX = 8
"""Of more links than this the ages over time are shown together."""


def links_of(rows: DeliveryRows, times: Sequence[LinkTimes], end_ns: int) -> list[dict[str, Any]]:
    """A row per directed link of a radio network: counts, ``delivery``, ``lost`` by cause, latency and age in s.

    Args:
        rows: with `COLUMNS`.
        times: of its links, in their order.
        end_ns: the end of the run.
    """
    counts, ages, latencies = counts_of(rows), link_ages(times, end_ns), link_latencies(times)
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


def _mean(links: list[dict[str, Any]], name: str) -> float | None:
    values = [link[name] for link in links if np.isfinite(link[name])]
    return float(np.mean(values)) if values else None


def _most(links: list[dict[str, Any]], name: str) -> float | None:
    return max((link[name] for link in links if np.isfinite(link[name])), default=None)


def losses_of(rows: DeliveryRows, end_ns: int) -> dict[str, Any]:
    """Packets by fate in each period: ``period_s``, ``sim_time_s`` (begins), ``delivered``, ``lost`` by cause."""
    period_ns = period_of(end_ns)
    periods = int(max(end_ns, rows.columns["sim_time_ns"].max(initial=0)) // period_ns) + 1
    counts = rows.counts(rows.columns["sim_time_ns"] // period_ns, periods)
    del counts["sent"]
    return {
        "period_s": period_ns / 1e9,
        "sim_time_s": np.arange(periods) * (period_ns / 1e9),
        "delivered": counts.pop("delivered"),
        "lost": counts,
    }


def period_of(end_ns: int) -> int:
    """A period of which up to PERIODS_MAX are a run, ns."""
    return round(nice_step(end_ns / 1e9, PERIODS_MAX, 0.1) * 1e9)


def link_name(tx: str, rx: str, radio: str, *, is_only: bool) -> str:
    """What a link is called; with the name of its radio network, unless there is only one."""
    return f"{tx} to {rx}" if is_only else f"{radio}: {tx} to {rx}"


def ages_of(times: Sequence[LinkTimes], rows: DeliveryRows, end_ns: int) -> dict[str, Any]:
    """The greatest age in each period: of each link, or of many the median and the greatest of all.

    ``rows`` are those of which the times are.
    ``period_s``, ``sim_time_s`` (begins), ``end_s`` (of the last) and ``series[]`` of ``name`` and ``age_s``.
    """
    period_ns = period_of(end_ns)
    edges = np.arange(0, end_ns + period_ns, period_ns, dtype=np.int64)
    edges = np.append(edges[edges < end_ns], end_ns)
    series = [link.sawtooth(end_ns).greatest(edges) for link in times]
    names = [
        link_name(row["tx"], row["rx"], row["radio"], is_only=len(rows.networks) == 1)
        for row in rows_of(rows.named(rows.links))
    ]
    told = list(zip(names, series, strict=True))
    if len(series) > LINKS_APART_MAX:
        together = np.array(series)
        told = [
            (f"median of {len(series)} links", _across(together, np.nanmedian)),
            ("the oldest of all", _across(together, np.nanmax)),
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


def powers_of(rows: DeliveryRows) -> dict[str, Any]:
    """Received power by distance: ``width_m``, ``boxes[]``, and ``beyond``: packets farther off than any with a power.

    A box has ``distance_min_m`` (inside), ``distance_max_m``, ``packets``, ``without_power`` of them (no draw could
    have saved them, so none was made), and of the others ``low``, ``q1``, ``median``, ``q3``, ``high`` in dBm.
    """
    distance_m, power_dbm = rows.columns["distance_m"], rows.columns["received_power_dbm"]
    known = np.isfinite(distance_m)
    distance_m, power_dbm = distance_m[known], power_dbm[known]
    farthest_m = float(distance_m[np.isfinite(power_dbm)].max(initial=0.0))
    width_m = nice_step(farthest_m, BOXES_MAX, BOX_LEAST_M)
    bins = (distance_m // width_m).astype(np.int64)
    is_near = bins <= farthest_m // width_m
    bins, power_dbm, beyond = bins[is_near], power_dbm[is_near], int(np.count_nonzero(~is_near))
    order = np.argsort(bins, kind="stable")
    numbers, first = np.unique(bins[order], return_index=True)
    parts = np.split(power_dbm[order], first[1:]) if len(numbers) else []
    return {
        "width_m": width_m,
        "beyond": beyond,
        "boxes": [
            {"distance_min_m": n * width_m, "distance_max_m": (n + 1) * width_m, **_box(part)}
            for n, part in zip(numbers.tolist(), parts, strict=True)
        ],
    }


def _box(power_dbm: NDArray[np.float64]) -> dict[str, Any]:
    known = power_dbm[np.isfinite(power_dbm)]
    counts = {"packets": len(power_dbm), "without_power": len(power_dbm) - len(known)}
    if not known.size:
        return counts | dict.fromkeys(("low", "q1", "median", "q3", "high"))
    q1, median, q3 = np.percentile(known, (25, 50, 75))
    reach = WHISKER * (q3 - q1)
    low, high = known[known >= q1 - reach].min(), known[known <= q3 + reach].max()
    return counts | {"low": low, "q1": q1, "median": median, "q3": q3, "high": high}


def bins_of(rows: DeliveryRows) -> list[dict[str, Any]]:
    """Delivery by link and distance, as the ledger has it, but without what the model predicts."""
    known = np.isfinite(rows.columns["distance_m"])
    number = (rows.columns["distance_m"][known] // BIN_WIDTH_M).astype(np.int64)
    link, arrived = rows.link[known], rows.is_delivered[known]
    span = int(number.max(initial=0)) + 1
    keys, place = np.unique(link * span + number, return_inverse=True)
    sent, delivered = np.bincount(place), np.bincount(place, arrived).astype(np.int64)
    low_m = keys % span * BIN_WIDTH_M
    columns = {**rows.named(keys // span), "distance_min_m": low_m, "distance_max_m": low_m + BIN_WIDTH_M}
    shares = {"sent": sent, "delivered": delivered, "measured": delivered / np.maximum(sent, 1)}
    return [
        row | {"of": BINS_OF_PACKETS, "predicted": None, "ci99": None} for row in rows_of(columns | shares)
    ]
