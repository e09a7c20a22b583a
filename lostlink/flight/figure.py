"""The figure of a run: measured probability of delivery over the model's curve."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from textwrap import fill
from typing import TYPE_CHECKING, Any

import numpy as np

from bridge.scenario.document.files import YAML
from bridge.scenario.model import Scenario
from bridge.scenario.resolve.radio import common_radio
from bridge.scenario.resolve.sensing import emitters_of
from channel.link.radio import Radio
from channel.numbers.intervals import proportion_interval
from channel.own.methods import OwnModelError
from channel.validity import OutsideValidityError
from lostlink.flight.summary import networks_of_bins, of_transmissions, shares_draws
from lostlink.reading.lengths import recorded_payload_bytes
from lostlink.reading.network_names import are_named

if TYPE_CHECKING:
    from matplotlib.axes import Axes

FIGURE_FILE = "probability_of_delivery.png"
TITLE_LINE = 70
"""Characters for which the figure is wide enough."""
MARKERS = "os^vD<>Pp*"
LINKS_MAX = 8
"""Of more links than this the figure shows all together."""
CURVE_POINTS = 200
"""One for each five pixels; each may take 6 ms, where random terms are averaged over."""
SPREAD_COLORS = ("tab:orange", "tab:green", "tab:red")
"""Of further networks."""
SPREAD_SENT_MIN = 20
"""Bins with fewer packets say little of how far apart links are."""


def model_curve(
    bins: list[dict[str, Any]], radio: Radio, farthest_m: float, payload_bytes: int | None = None
) -> tuple[Any, Any]:
    """The model by distance; where a distance alone says too little, what it predicted for the packets of each bin.

    It says too little where the law asks for places, and where emitters or interferers stand somewhere.

    Args:
        bins: as `summary.json` has them; of those without a prediction there is no point.
        radio: of all nodes; it knows the emitters that it hears.
        farthest_m: where the curve ends.
        payload_bytes: of the packets; None: the radio's nominal one.

    Returns:
        Distances in m and probabilities of delivery, of one length.
    """
    distance_m = np.linspace(1.0, farthest_m, CURVE_POINTS)
    with suppress(OutsideValidityError, OwnModelError):
        if radio.is_by_distance:
            return distance_m, radio.probability_of_delivery(distance_m, payload_bytes)
    sums: dict[float, tuple[float, int]] = {}
    for row in bins:
        if row["predicted"] is not None:
            expected, sent = sums.get(_middle(row), (0.0, 0))
            sums[_middle(row)] = expected + row["sent"] * row["predicted"], sent + row["sent"]
    points = sorted((middle, expected / sent) for middle, (expected, sent) in sums.items())
    return [middle for middle, _ in points], [predicted for _, predicted in points]


def draw_probability_of_delivery(
    summary: dict[str, Any], radio: Radio | None, path: Path, payload_bytes: int | None = None
) -> None:
    """Measured probability of delivery over the model's curve, if all nodes have one radio; as Moon et al., Fig. 6."""
    from matplotlib.figure import Figure  # without pyplot, whose backend belongs to whoever calls us

    figure = Figure(figsize=(8, 4.5), layout="constrained")
    axes = figure.subplots()
    farthest_m = max((row["distance_max_m"] for row in summary["bins"]), default=100.0)
    if radio is not None:
        distance_m, closed = model_curve(summary["bins"], radio, farthest_m, payload_bytes)
        axes.plot(distance_m, closed, color="0.3", label="model", zorder=1)
    draw_measured(axes, summary["bins"])
    axes.set(xlabel="distance, m", ylabel="probability of delivery", ylim=(-0.03, 1.03), xlim=(0, farthest_m))
    radio_name = summary["radio"]
    if not isinstance(radio_name, str):
        radio_name = radio_name.get("preset", "own radio")
    name = Path(radio_name).stem if radio_name.endswith(YAML) else radio_name
    networks = networks_of_bins(summary["bins"])
    name = ", ".join(networks) if are_named(networks) else name
    how = "packets share shadowing or fading" if shares_draws(summary["bins"]) else "99 % binomial intervals"
    what = "first transmissions" if of_transmissions(summary["bins"]) else "measured"
    title = f"{summary['scenario']}: {name}, seed {summary['seed']} ({what}; {how})"
    axes.set_title(fill(title, TITLE_LINE))
    axes.grid(alpha=0.3)
    axes.legend()
    figure.savefig(path, dpi=120)


def draw_figure_of(run: Path, scenario: Scenario, summary: dict[str, Any]) -> None:
    """Draw the figure of a run that is summed up, into its directory; the model's curve is that of its packets."""
    radio = common_radio(scenario, emitters_of(scenario))
    payload_bytes = None if radio is None else recorded_payload_bytes(run, scenario, radio)
    draw_probability_of_delivery(summary, radio, run / FIGURE_FILE, payload_bytes)


def draw_measured(axes: Axes, bins: list[dict[str, Any]], spread_color: str = "tab:blue") -> None:
    """A point per link and bin with its interval; of many links one for all, and how far apart they lie.

    Of several radio networks each has its own.
    """
    networks = networks_of_bins(bins)
    of = {name: f", {name}" if are_named(networks) else "" for name in networks}
    links = sorted({(name, row["tx"], row["rx"]) for name, rows in networks.items() for row in rows})
    if len(links) <= LINKS_MAX:
        for index, (name, tx, rx) in enumerate(links):
            rows = [row for row in networks[name] if (row["tx"], row["rx"]) == (tx, rx)]
            aside_m = 3.0 * (index - (len(links) - 1) / 2) / max(1, len(links) - 1)
            _draw_points(axes, rows, MARKERS[index % len(MARKERS)], f"{tx} to {rx}{of[name]}", aside_m)
        return
    colors = [spread_color, *SPREAD_COLORS]
    for index, (name, rows) in enumerate(networks.items()):
        count = sum(each == name for each, _, _ in links)
        judged = [row for row in rows if row["sent"] >= SPREAD_SENT_MIN]
        _draw_spread(axes, judged, f"{count} links{of[name]}", colors[index % len(colors)])
        _draw_points(axes, _together(rows), MARKERS[index % len(MARKERS)], f"all {count} links{of[name]}")


def _draw_points(
    axes: Axes, rows: list[dict[str, Any]], marker: str, label: str, aside_m: float = 0.0
) -> None:
    measured = np.array([row["delivered"] / row["sent"] for row in rows])
    low, high = proportion_interval([row["delivered"] for row in rows], [row["sent"] for row in rows])
    axes.errorbar(
        np.array([_middle(row) for row in rows]) + aside_m,
        measured,
        None if shares_draws(rows) else np.maximum([measured - low, high - measured], 0.0),
        fmt=marker,
        markersize=4,
        capsize=2,
        lw=1,
        label=label,
    )


def _draw_spread(axes: Axes, bins: list[dict[str, Any]], links: str, color: str) -> None:
    """From the worst to the best link at each distance."""
    spread: dict[float, list[float]] = {}
    for row in bins:
        spread.setdefault(_middle(row), []).append(row["measured"])
    at_m = sorted(spread)
    lowest, highest = ([pick(spread[each]) for each in at_m] for pick in (min, max))
    axes.vlines(at_m, lowest, highest, color=color, alpha=0.25, lw=4, label=f"worst to best of {links}")


def _together(bins: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Rows of all links, one for each distance."""
    found: dict[float, dict[str, Any]] = {}
    for row in bins:
        total = found.setdefault(row["distance_min_m"], {**row, "sent": 0, "delivered": 0})
        total["sent"] += row["sent"]
        total["delivered"] += row["delivered"]
    return [found[each] for each in sorted(found)]


def _middle(row: dict[str, Any]) -> float:
    return float(row["distance_min_m"] + row["distance_max_m"]) / 2
