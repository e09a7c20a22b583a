"""The tables of distance bins that `lostlink run` prints."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from rich import box
from rich.table import Table

from channel.numbers.intervals import binomial_interval
from lostlink.flight.summary import (
    BIN_SENT_MIN,
    is_outside,
    networks_of_bins,
    of_transmissions,
    shares_draws,
)
from lostlink.reading.named import named
from lostlink.reading.network_names import are_named
from lostlink.reading.spans import spans_of

LINKS_MAX = 3
"""Of a row, that are named."""


def bins_tables(summary: dict[str, Any]) -> Iterator[Table]:
    """The tables for people, of each radio network: a row per distance bin, or of a long flight per few of them.

    All directed links are taken together. A link of which a bin lies outside its own interval is named in the last
    column. Where packets share their draws there are no intervals.
    """
    networks = networks_of_bins(summary["bins"])
    for network, bins in networks.items():
        yield _table(bins, f"{network}: " if are_named(networks) else "")


def _table(bins: list[dict[str, Any]], network: str) -> Table:
    shared = shares_draws(bins)
    title = f"{network}Probability of delivery by distance, all links"
    if of_transmissions(bins):
        title += ", of first transmissions, as if alone on the air"
    if shared:
        title += " (packets share shadowing or fading: no intervals)"
    table = Table(box=box.SIMPLE_HEAD, title=title, title_justify="left")
    for name in (
        "distance, m",
        "sent",
        "delivered",
        "measured",
        "predicted",
        *([] if shared else ["99 % interval"]),
    ):
        table.add_column(name, justify="right", no_wrap=True)
    if any(is_outside(row) for row in bins):
        table.add_column("outside", overflow="fold")
    for start_m, end_m in spans_of((row["distance_min_m"], row["distance_max_m"]) for row in bins):
        rows = [row for row in bins if start_m <= row["distance_min_m"] < end_m]
        sent, delivered = (sum(row[key] for row in rows) for key in ("sent", "delivered"))
        predicted = min(1.0, sum(row["predicted"] * row["sent"] for row in rows) / sent)
        low, high = binomial_interval(sent, predicted)
        outside = list(dict.fromkeys(f"{row['tx']} -> {row['rx']}" for row in rows if is_outside(row)))
        table.add_row(
            f"{start_m:.0f}-{end_m:.0f}",
            str(sent),
            str(delivered),
            f"{delivered / sent:.3f}",
            f"{predicted:.3f}",
            *([] if shared else [f"{low:.3f}-{high:.3f}"]),
            *([named(outside, most=LINKS_MAX)] if outside else []),
            style="red" if outside else ("" if sent >= BIN_SENT_MIN else "dim"),
        )
    return table
