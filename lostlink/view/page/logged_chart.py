"""One number that agents logged, over sim time: a line per node."""

from __future__ import annotations

from collections.abc import Sequence

from lostlink.view.page.charts import SERIES_COLOURS, Look, Options, axis, frame, points, thinned
from lostlink.view.picture.logged import Series

LINES_MAX = 12
SYMBOLS = ("circle", "rect", "triangle", "diamond")
"""Nodes are distinguished by these, too."""
FEW = 60
"""Points of a line of which each has its symbol."""


def logged_chart(label: str, lines: Sequence[tuple[int, str, Series]], look: Look) -> Options:
    """The chart; ``lines`` are place of a node, its title and what it logged; the first LINES_MAX are drawn."""
    options = frame(look)
    options |= {
        "grid": {"left": 70, "right": 16, "top": 40, "bottom": 48},
        "xAxis": axis("sim time, s", look) | {"min": "dataMin", "max": "dataMax"},
        "yAxis": axis(label, look) | {"scale": True, "nameGap": 52},
        "series": [],
    }
    for place, title, series in lines[:LINES_MAX]:
        time_s, value = series.points()
        shown = thinned(len(time_s))
        options["series"].append(
            {
                "name": title,
                "type": "line",
                "color": SERIES_COLOURS[place % len(SERIES_COLOURS)],
                "symbol": SYMBOLS[place % len(SYMBOLS)],
                "symbolSize": 5,
                "showSymbol": len(shown) <= FEW,
                "data": points(time_s[shown], value[shown]),
            }
        )
    return options


def drawn_words(lines: int) -> str:
    """How many of so many lines the chart has, if not all."""
    return (
        f"{LINES_MAX} of {lines} nodes that log it are drawn, the chosen one first"
        if lines > LINES_MAX
        else ""
    )
