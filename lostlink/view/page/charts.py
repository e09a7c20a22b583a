"""Charts as options of ECharts, from what the view knows: plain functions, no browser."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from channel.numbers.intervals import proportion_interval
from lostlink.view.picture.air_history import AirSeries
from lostlink.view.picture.link_history import DistanceBins, LinkSeries

POINTS_MAX = 400
LABELS_MAX = 25
"""Of an axis of nodes: of more only each second, third and so on has its name."""
Options = dict[str, Any]
SERIES_COLOURS = ("#2b7bba", "#d95f02", "#5a9e6f", "#8e6bbf", "#b5893a", "#c2497c")
CAUSE_COLOURS = {
    "channel_erasure": "#d95f02",
    "out_of_range": "#7570b3",
    "base_loss": "#b5893a",
    "burst": "#c2497c",
    "below_preamble": "#e6ab02",
    "no_position": "#888888",
    "radio_off": "#4d4d4d",
    "queue_full": "#1f78b4",
    "expired": "#6baed6",
    "replaced": "#9ecae1",
    "too_long_for_a_slot": "#08519c",
    "half_duplex": "#b2df8a",
    "collided": "#e31a1c",
    "retries_exhausted": "#fb9a99",
    "no_peer": "#a6761d",
    "no_lock": "#cab2d6",
    "outage": "#6a3d9a",
    "run_ended": "#bdbdbd",
    "no_route": "#ff7f00",
    "hop_limit": "#fdbf6f",
    "partitioned": "#8c6d31",
    "interfered": "#e7298a",
    "transport": "#1b9e77",
    "too_long": "#66a61e",
}


@dataclass(frozen=True, slots=True)
class Look:
    """Colours of a theme."""

    ink: str
    faint: str


LIGHT, DARK = Look("#1c2733", "#d5dce3"), Look("#e4e9ee", "#3a444e")


@dataclass(frozen=True, slots=True)
class ModelCurve:
    """The model's probability of delivery by distance, shape (D,) each; empty if a distance alone says too little.

    ``shares_draws``: whether packets share shadowing, fading or the air: there are no binomial intervals then.
    """

    distance_m: NDArray[np.float64]
    probability: NDArray[np.float64]
    shares_draws: bool = False


def link_chart(series: LinkSeries, look: Look) -> Options:
    """Power, SNR and delivery of one link over sim time."""
    thin = thinned(len(series.time_s))
    time_s = series.time_s[thin]
    rows = (
        ("received power, dBm", [("received power", series.received_power_dbm)]),
        ("SNR, dB", [("SNR", series.snr_db)]),
        ("delivery", [("measured", series.measured), ("model (1 - PER)", series.probability)]),
    )
    options = frame(look)
    options["legend"]["data"] = ["measured", "model (1 - PER)"]
    options |= {"grid": [], "xAxis": [], "yAxis": [], "series": []}
    for row, (name, lines) in enumerate(rows):
        options["grid"].append({"left": 62, "right": 16, "top": f"{8 + 31 * row}%", "height": "21%"})
        options["xAxis"].append(axis("", look) | {"gridIndex": row, "min": "dataMin", "max": "dataMax"})
        options["yAxis"].append(
            axis(name, look) | {"gridIndex": row, "scale": row < 2, **_unit_range(row == 2)}
        )
        for number, (label, values) in enumerate(lines):
            options["series"].append(
                {
                    "name": label,
                    "type": "line",
                    "showSymbol": False,
                    "xAxisIndex": row,
                    "yAxisIndex": row,
                    "data": points(time_s, values[thin]),
                    "color": SERIES_COLOURS[number],
                    "lineStyle": {"width": 2, "type": "dashed" if number else "solid"},
                }
            )
    options["xAxis"][-1]["name"] = "sim time, s"
    return options


def delivery_chart(bins: DistanceBins, model: ModelCurve, look: Look) -> Options:
    """Probability of delivery against distance, measured and by the model: Moon et al. 2020, Fig. 6, as it grows."""
    measured = bins.delivered / np.maximum(bins.sent, 1)
    options = frame(look)
    options |= {
        "grid": {"left": 62, "right": 16, "top": 40, "bottom": 48},
        "xAxis": axis("distance, m", look) | {"min": 0},
        "yAxis": axis("probability of delivery", look) | _unit_range(True),
        "series": [
            {
                "name": "measured",
                "type": "scatter",
                "symbolSize": 7,
                "color": SERIES_COLOURS[0],
                "data": points(bins.distance_m, measured),
            },
            *([] if model.shares_draws else [_whiskers(bins)]),
            {
                "name": "model",
                "type": "line",
                "showSymbol": False,
                "color": SERIES_COLOURS[1],
                "lineStyle": {"type": "dashed", "width": 2},
                "data": points(model.distance_m, model.probability),
            },
        ],
    }
    return options


def _whiskers(bins: DistanceBins) -> Options:
    """The intervals of what is measured, as one broken line: a gap after each."""
    data: list[list[float | None] | str] = []
    if bins.sent.size:
        low, high = (np.asarray(each) for each in proportion_interval(bins.delivered, bins.sent))
        for x, bottom, top in zip(bins.distance_m.tolist(), low.tolist(), high.tolist(), strict=True):
            data += [[x, _short(bottom)], [x, _short(top)], "-"]
    return {
        "name": "99 % interval",
        "type": "line",
        "showSymbol": False,
        "color": SERIES_COLOURS[0],
        "lineStyle": {"width": 1},
        "data": data,
    }


def losses_chart(time_s: NDArray[Any], shares: dict[str, NDArray[Any]], look: Look) -> Options:
    """Share of packets that were lost to each cause, over sim time."""
    thin = thinned(len(time_s))
    options = frame(look)
    options |= {
        "grid": {"left": 62, "right": 16, "top": 40, "bottom": 48},
        "xAxis": axis("sim time, s", look) | {"min": "dataMin", "max": "dataMax"},
        "yAxis": axis("share lost", look) | _unit_range(True),
        "series": [
            {
                "name": cause.replace("_", " "),
                "type": "line",
                "stack": "lost",
                "areaStyle": {"opacity": 0.5},
                "showSymbol": False,
                "color": CAUSE_COLOURS.get(cause, "#888888"),
                "data": points(time_s[thin], share[thin]),
            }
            for cause, share in sorted(shares.items())
        ],
    }
    return options


def air_chart(networks: Mapping[str, AirSeries], look: Look) -> Options:
    """Share of the time in which each network's air is in use, where it is known, and the mean delay on it."""
    series = []
    for number, (name, air) in enumerate(networks.items()):
        thin = thinned(len(air.time_s))
        line = {"type": "line", "showSymbol": False, "color": SERIES_COLOURS[number % len(SERIES_COLOURS)]}
        series += [
            *(
                [line | {"name": f"{name}: in use", "data": points(air.time_s[thin], air.use[thin])}]
                if np.isfinite(air.use).any()
                else []
            ),
            line
            | {
                "name": f"{name}: delay",
                "yAxisIndex": 1,
                "lineStyle": {"type": "dashed"},
                "data": points(air.time_s[thin], air.delay_s[thin]),
            },
        ]
    options = frame(look)
    options |= {
        "grid": {"left": 62, "right": 62, "top": 40, "bottom": 48},
        "xAxis": axis("sim time, s", look) | {"min": "dataMin", "max": "dataMax"},
        "yAxis": [
            axis("share of the time in use", look) | {"min": 0},
            axis("delay, s", look) | {"min": 0, "splitLine": {"show": False}},
        ],
        "series": series,
    }
    return options


def matrix_chart(nodes: list[str], share: NDArray[Any], look: Look) -> Options:
    """Share of packets that arrived, from each node (column) to each (row)."""
    data = [
        [tx, rx, _short(share[tx, rx])]
        for tx in range(len(nodes))
        for rx in range(len(nodes))
        if np.isfinite(share[tx, rx])
    ]
    options = frame(look, legend=False)
    names = {
        "type": "category",
        "data": nodes,
        "axisLabel": {"color": look.ink, "interval": -(-len(nodes) // LABELS_MAX) - 1},
        "splitArea": {"show": False},
    }
    options |= {
        "grid": {"left": 62, "right": 16, "top": 16, "bottom": 92},
        "xAxis": names
        | {"name": "from", "nameLocation": "middle", "nameGap": 26, "nameTextStyle": {"color": look.ink}},
        "yAxis": names
        | {
            "name": "to",
            "nameLocation": "middle",
            "nameGap": 40,
            "nameTextStyle": {"color": look.ink},
            "inverse": True,
        },
        "visualMap": {
            "min": 0,
            "max": 1,
            "calculable": False,
            "orient": "horizontal",
            "left": "center",
            "bottom": 8,
            "text": ["all arrive", "none"],
            "textStyle": {"color": look.ink},
            "inRange": {"color": STEPS},
        },
        "series": [
            {
                "name": "delivered",
                "type": "heatmap",
                "progressive": 0,  # drawn bit by bit, it would begin anew before it is done
                "data": data,
                "label": {"show": len(nodes) <= 8, "formatter": "{@[2]}"},
            }
        ],
    }
    return options


STEPS = [
    *("#c62828", "#cf4a1f", "#d66616", "#db800f", "#dd9810", "#c7a329"),
    *("#9aa14f", "#6f9b72", "#488f92", "#2f80ac", "#2069b8"),
]
"""From nothing arrives to everything does: red, amber, blue, which the colour-blind distinguish, too."""


def frame(look: Look, *, legend: bool = True) -> Options:
    """What all charts have in common."""
    return {
        "animation": False,
        "aria": {"enabled": False},  # it would put its own name in place of the page's
        "backgroundColor": "transparent",
        "textStyle": {"color": look.ink},
        "tooltip": {"trigger": "item"},
        "legend": {"show": legend, "type": "scroll", "top": 0, "textStyle": {"color": look.ink}},
    }


def axis(name: str, look: Look) -> Options:
    """An axis with numbers."""
    return {
        "type": "value",
        "name": name,
        "nameLocation": "middle",
        "nameGap": 40 if name and not name.startswith(("sim", "dist")) else 24,
        "nameTextStyle": {"color": look.ink},
        "axisLabel": {"color": look.ink},
        "axisLine": {"lineStyle": {"color": look.faint}},
        "splitLine": {"lineStyle": {"color": look.faint}},
    }


def _unit_range(is_share: bool) -> Options:
    return {"min": 0, "max": 1} if is_share else {}


def thinned(length: int) -> NDArray[np.intp]:
    """Places of at most POINTS_MAX points, evenly; the newest is one of them."""
    step = -(-length // POINTS_MAX) if length else 1
    return np.arange(length - 1, -1, -step)[::-1]


def points(x: NDArray[Any], y: NDArray[Any]) -> list[list[float | None]]:
    """Pairs; None for what is not finite."""
    return [[_short(a), _short(b)] for a, b in zip(x.tolist(), y.tolist(), strict=True)]


def _short(value: float) -> float | None:
    """To three decimals, or three digits of what is less than 1; None for what is not finite."""
    if not np.isfinite(value):
        return None
    return round(float(value), 3) if abs(value) >= 1.0 else float(f"{value:.3g}")
