"""What a study measures and draws: how far the link from UA 1 to UA 0 carried, by radio."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from lostlink import Run

if TYPE_CHECKING:
    import pandas as pd


def measure(run: Run) -> dict[str, object]:
    """The farthest packet that arrived, and the share of packets that arrived by 50 m of distance."""
    rows = run.columns("deliveries", ["tx", "distance_m", "fate"])
    ours = rows["tx"] == "1"
    distance_m, arrived = rows["distance_m"][ours], rows["fate"][ours] == "delivered"
    place = (distance_m // 50).astype(int)
    sent, got = np.bincount(place, minlength=13), np.bincount(place, weights=arrived, minlength=13)
    return {
        "farthest_m": float(distance_m[arrived].max(initial=0.0)),
        "delivery_by_50_m": np.where(sent > 0, got / np.maximum(sent, 1), np.nan),
    }


def draw(table: pd.DataFrame, directory: Path) -> None:
    """A curve per radio: mean over the seeds."""
    figure = Figure(layout="constrained")
    axes = figure.subplots()
    for radio, runs in table.groupby("radio"):
        share = np.nanmean(np.stack([row[:13] for row in runs["delivery_by_50_m"]]), axis=0)
        axes.plot(25 + 50 * np.arange(13), share, marker="o", label=f"{radio} ({len(runs)} seeds)")
    axes.set(xlabel="distance, m", ylabel="probability of delivery", ylim=(-0.03, 1.03))
    axes.legend()
    figure.savefig(directory / "range.png", dpi=120)
