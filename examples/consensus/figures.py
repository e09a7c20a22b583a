"""What a study of the mission measures of a run, and its figure: how far from the average the UA are, and meet."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from lostlink import Run

if TYPE_CHECKING:
    import pandas as pd

Floats = NDArray[np.float64]


def measure(run: Run) -> dict[str, Any]:
    """How far the estimates are from the average of what was proposed, and where the UA flew.

    ``times_s`` of the steps; ``error_m`` of the worst UA at each, and ``final_error_m``; ``average_m``: north and
    east; ``met_off_m``: how far from it the middle of the UA's true places is at the end; ``<node>_north_m``,
    ``<node>_east_m``: true places, each second; ``delivery_share`` of the mission's packets.
    """
    proposed = run.agent_values("proposal")
    average_m = np.mean(np.stack(proposed["value"].to_list()), axis=0)
    told = run.agent_values("estimate")
    away_m = np.hypot(*(np.stack(told["value"].to_list()) - average_m).T)
    worst = told.assign(away_m=away_m).groupby("sim_time_s")["away_m"].max()
    tracks = {str(node): _track_m(run, str(node)) for node in proposed["node"]}
    middle_m = np.mean([track[-1] for track in tracks.values()], axis=0)
    found: dict[str, Any] = {
        "times_s": worst.index.to_numpy(),
        "error_m": worst.to_numpy(),
        "final_error_m": float(worst.iloc[-1]),
        "average_m": average_m,
        "met_off_m": float(np.hypot(*(middle_m - average_m))),
        "delivery_share": float(run.links["delivered"].sum() / run.links["sent"].sum()),
    }
    for node, track in tracks.items():
        found |= {f"{node}_north_m": track[:, 0], f"{node}_east_m": track[:, 1]}
    return found


def _track_m(run: Run, node: str) -> Floats:
    """True places each second and at the end, north and east, shape (n, 2)."""
    truth = run.truth[run.truth["node"] == node]
    rows = [*range(0, len(truth), round(1.0 / run.scenario.tick_period_ns * 1e9)), len(truth) - 1]
    return truth[["position_north_m", "position_east_m"]].to_numpy()[rows]


def draw(table: pd.DataFrame, directory: Path) -> None:
    """Where the UA of the first seed flew in each case, and the worst UA's error over time in all runs."""
    flown = table[table["failure"] == ""]
    figure = Figure(figsize=(11, 4.8), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(1, 1.4))
    labels = {"running sums": "running sums", "naive": "naive averaging"}
    for colour, (case, label) in zip(("C0", "C3"), labels.items(), strict=True):
        rows = flown[flown["case"] == case]
        _map(left, rows.iloc[0], colour, label)
        errors = np.stack(rows["error_m"].to_list())
        times_s = rows["times_s"].iloc[0]
        right.plot(times_s, errors.T, color=colour, linewidth=0.6, alpha=0.4)
        right.plot(times_s, np.median(errors, axis=0), color=colour, linewidth=2, label=label)
    north_m, east_m = flown["average_m"].iloc[0]
    left.plot(east_m, north_m, "k+", markersize=12, label="average of where they were")
    left.set(xlabel="east, m", ylabel="north, m", aspect="equal")
    left.legend(fontsize=8)
    right.set(yscale="log", xlabel="sim time, s", ylabel="worst UA's distance from the average, m")
    right.legend(fontsize=8, title=f"median of {flown['seed'].nunique()} seeds", title_fontsize=8)
    right.grid(visible=True, alpha=0.3)
    figure.savefig(directory / "consensus.png", dpi=110)


def _map(axes: Any, row: pd.Series, colour: str, label: str) -> None:
    nodes = [name.removesuffix("_north_m") for name in row.index if name.endswith("_north_m")]
    for node in nodes:
        east, north = row[f"{node}_east_m"], row[f"{node}_north_m"]
        axes.plot(east, north, color=colour, linewidth=0.9, alpha=0.7)
        axes.plot(east[0], north[0], "o", color="grey", markersize=4, zorder=3)
        axes.plot(east[-1], north[-1], "o", color=colour, label=label if node == nodes[0] else None)
