"""What the radio did: delivery and power over distance, losses over time, links as a matrix."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from lostlink.flight.figure import draw_measured
from lostlink.flight.summary import of_transmissions, shares_draws
from lostlink.report.pictures.theme import (
    FAINT,
    GOOD,
    LOSSES,
    SERIES,
    figure_of,
    legend_above,
    logarithmic,
    short,
    svg_of,
    themed,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from numpy.typing import NDArray

NUMBERS_MAX = 12
"""Matrices of more nodes have no numbers in their cells."""
TICKS_MAX = 17
RUN_NAME_MAX = 80
LABEL_MAX = 12
"""Characters of a node's id beside a matrix."""
DARK_BELOW = 0.55
"""Below this share of the colour scale numbers in cells are white."""


def draw_delivery(content: dict[str, Any]) -> str:
    """Fig. 6 of the run: measured probability of delivery, over the model's curve."""
    bins, model = content["bins"], content["model"]
    with themed():
        figure, axes = figure_of(8.0, 4.2)
        if model is not None:
            axes.plot(
                model["distance_m"],
                model["probability_of_delivery"],
                color=FAINT,
                lw=2,
                label="model",
                zorder=1,
            )
        draw_measured(axes, bins, SERIES[0])
        farthest_m = max(row["distance_max_m"] for row in bins)
        axes.set(
            xlabel="distance, m", ylabel="probability of delivery", ylim=(-0.03, 1.03), xlim=(0, farthest_m)
        )
        legend_above(axes)
        return svg_of(figure, "delivery", told_of_delivery(content))


def told_of_delivery(content: dict[str, Any]) -> str:
    """What the picture of delivery shows, and which intervals there are."""
    bins = content["bins"]
    width_m = bins[0]["distance_max_m"] - bins[0]["distance_min_m"]
    told = f"Measured probability of delivery in steps of {width_m:g} m"
    told += ", of first transmissions, each as if alone on the air" if of_transmissions(bins) else ""
    if shares_draws(bins):
        told += " (packets share shadowing, fading or the air: no intervals)"
    else:
        told += ", with 99 % binomial (Clopper-Pearson) intervals"
    if content["model"]:
        return told + ", over the model’s curve averaged over its random terms."
    return told + ". The model has no single curve here, or could not be computed."


def draw_powers(network: dict[str, Any], key: str) -> str:
    """Box plots of received power by distance on a network, as the paper has them (Moon et al. 2020, Fig. 6)."""
    width_m = network["powers"]["width_m"]
    boxes = [box for box in network["powers"]["boxes"] if box["median"] is not None]
    stats = [
        {
            "med": b["median"],
            "q1": b["q1"],
            "q3": b["q3"],
            "whislo": b["low"],
            "whishi": b["high"],
            "fliers": [],
        }
        for b in boxes
    ]
    at_m = [(b["distance_min_m"] + b["distance_max_m"]) / 2 for b in boxes]
    line = {"color": SERIES[0]}
    with themed():
        figure, axes = figure_of()
        axes.bxp(
            stats,
            positions=at_m,
            widths=0.5 * width_m,
            showfliers=False,
            manage_ticks=False,
            boxprops=line,
            whiskerprops=line,
            capprops=line,
            medianprops={"color": SERIES[1], "lw": 2},
        )
        axes.set(
            xlabel="distance, m",
            ylabel="received power, dBm",
            xlim=(0.0, network["powers"]["boxes"][-1]["distance_max_m"]),
        )
        return svg_of(
            figure,
            f"powers{key}",
            f"Box plots of received power in steps of {width_m:g} m; numbers in the table.",
        )


def draw_losses(network: dict[str, Any], key: str) -> str:
    """Packets on a network by what became of them, over time."""
    losses = network["losses"]
    with themed():
        figure, axes = figure_of()
        at_s = np.array([*losses["sim_time_s"], losses["sim_time_s"][-1] + losses["period_s"]])
        base = np.zeros(len(at_s))
        parts = [("delivered", losses["delivered"], GOOD)]
        parts += [
            (c.replace("_", " "), n, LOSSES[i % len(LOSSES)])
            for i, (c, n) in enumerate(losses["lost"].items())
        ]
        for name, counts, color in parts:
            top = base + np.append(counts, counts[-1])
            axes.fill_between(at_s, base, top, step="post", color=color, lw=0, label=name)
            base = top
        axes.set(xlabel="sim time, s", ylabel=f"packets per {losses['period_s']:g} s", xlim=(0, at_s[-1]))
        axes.set_ylim(bottom=0)
        legend_above(axes, 4)
        return svg_of(
            figure, f"losses{key}", f"Packets over time: {', '.join(name for name, _, _ in parts)}."
        )


def draw_ages(content: dict[str, Any]) -> str:
    """The greatest age of information in each period."""
    ages = content["ages"]
    at_s = [*ages["sim_time_s"], ages["end_s"]]
    with themed():
        figure, axes = figure_of()
        for series in ages["series"]:
            values = [np.nan if value is None else value for value in series["age_s"]]
            axes.step(at_s, [*values, values[-1]], where="post", label=series["name"])
        axes.set(xlabel="sim time, s", ylabel="age of information, s")
        logarithmic(axes)
        legend_above(axes, 4)
        return svg_of(
            figure, "ages", "Age of the newest packet received, over time; its greatest values per period."
        )


def draw_matrix(content: dict[str, Any], radio: str, name: str, title: str, *, key: str, share: bool) -> str:
    """A figure of each link of a radio network as a matrix, senders down, receivers across.

    Args:
        content: of the report.
        radio: the network's name.
        name: of the figure.
        title: what it is.
        key: that names of the network's pictures end with.
        share: from 0 to 1, where more is better; else less is better, from 0 on.
    """
    links = [link for link in content["links"] if link["radio"] == radio]
    ids = [node["id"] for node in content["nodes"]] or sorted({link["tx"] for link in links})
    ids = [each for each in ids if any(each in (link["tx"], link["rx"]) for link in links)]
    place = {node: at for at, node in enumerate(ids)}
    values = np.full((len(ids), len(ids)), np.nan)
    for link in links:
        if link[name] is not None:
            values[place[link["tx"]], place[link["rx"]]] = link[name]
    side_in = min(4.4, max(2.6, 0.8 * len(ids)))
    with themed():
        figure, axes = figure_of(side_in + 1.4, side_in)
        most = 1.0 if share else float(np.nanmax(values, initial=0.0)) or 1.0
        image = axes.imshow(
            values, cmap="viridis" if share else "viridis_r", vmin=0.0, vmax=most, interpolation="none"
        )
        _label(axes, ids)
        if len(ids) <= NUMBERS_MAX:
            _write(axes, values / most if share else 1.0 - values / most, values)
        figure.colorbar(image, ax=axes, shrink=0.8, label=title).outline.set_visible(False)
        told = (
            f"Matrix of links, senders down, receivers across: {title}; the table of links has the numbers."
        )
        return svg_of(figure, f"matrix-{name.replace('_', '-')}{key}", told)


def _label(axes: Axes, ids: list[str]) -> None:
    every = -(-len(ids) // TICKS_MAX)
    at = list(range(0, len(ids), every))
    names = [short(ids[i], LABEL_MAX) for i in at]
    turned = 90 if max(map(len, names)) * len(ids) > 4 * 3 else 0
    axes.set_xticks(at, names, rotation=turned)
    axes.set_yticks(at, names)
    axes.set(xlabel="to", ylabel="from")
    axes.grid(visible=False)
    axes.spines[:].set_visible(False)
    axes.tick_params(length=0)


def _write(axes: Axes, bright: NDArray[np.float64], values: NDArray[np.float64]) -> None:
    """Numbers into cells, in what can be read on them."""
    for row, column in np.argwhere(np.isfinite(values)):
        color = "#ffffff" if bright[row, column] < DARK_BELOW else "#000000"
        text = f"{values[row, column]:.2f}" if values[row, column] < 10 else f"{values[row, column]:.0f}"
        axes.text(
            column,
            row,
            text,
            ha="center",
            va="center",
            color=color,
            fontsize=9 if values.shape[0] <= 6 else 7,
        )


def draw_comparison(columns: list[dict[str, Any]]) -> str:
    """Measured delivery over distance of several runs: of each all links of a radio network together."""
    is_only = len({radio for column in columns for radio in column["radio_networks"]}) == 1
    lines = [
        (column["name"] if is_only else f"{column['name']}, {each['radio']}", each["delivery_by_distance"])
        for column in columns
        for each in column["networks"]
    ]
    with themed():
        figure, axes = figure_of(8.0, 4.2)
        for place, (name, points) in enumerate(lines):
            at_m = [(p["distance_min_m"] + p["distance_max_m"]) / 2 for p in points]
            shares = [p["delivered"] / p["sent"] for p in points]
            axes.plot(
                at_m,
                shares,
                marker="os^vD<>P"[place % 8],
                linestyle=("-", "--")[place % 2],
                ms=4,
                color=SERIES[place % 8],
                label=name,
            )
        axes.set(xlabel="distance, m", ylabel="measured delivery", ylim=(-0.03, 1.03))
        axes.set_xlim(left=0)
        legend_above(axes, 2, RUN_NAME_MAX)
        names = ", ".join(name for name, _ in lines)
        return svg_of(
            figure, "comparison", f"Measured delivery over distance, all links together, of {names}."
        )
