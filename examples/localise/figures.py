"""The study's figure: error against time for each channel, with intervals, beside the delivery rates."""

from __future__ import annotations

from pathlib import Path

import matplotlib as mpl
import numpy as np

mpl.use("Agg")
import matplotlib.pyplot as plt
import pandas as pd
from numpy.typing import NDArray
from scipy import stats

Floats = NDArray[np.float64]


def curves(table: pd.DataFrame, directory: Path) -> None:
    """Draw per case the median error of the worst UA over sim time, its 95 % interval, and what of messages arrived."""
    flown = table[table["failure"] == ""]
    figure, (left, right) = plt.subplots(1, 2, figsize=(11, 4.6), width_ratios=(2.4, 1), layout="constrained")
    cases = list(dict.fromkeys(flown["case"]))
    for colour, case in enumerate(cases):
        rows = flown[flown["case"] == case]
        times_s = np.asarray(rows["times_s"].iloc[0])
        low, middle, high = median_interval(np.stack(rows["error_m"].to_list()))
        left.fill_between(times_s, low, high, color=f"C{colour}", alpha=0.15, linewidth=0)
        left.plot(times_s, middle, color=f"C{colour}", label=f"{case} ({len(rows)} runs)")
        share = rows["told"].to_numpy(dtype=float)  # NaN without sharing: no bar
        right.barh(colour, np.mean(share), color=f"C{colour}")
        right.plot(share, np.full(len(share), colour), "k|", markersize=7)
    bounds = np.stack(flown[flown["case"] == "perfect"]["bound_m"].to_list())
    left.plot(times_s, np.median(bounds, axis=0), "k--", linewidth=1, label="Cramér-Rao, perfect")
    left.axhline(15.0, color="grey", linewidth=0.8, linestyle=":")
    left.set(
        yscale="log", ylim=(2, 500), xlabel="sim time, s", ylabel="error of the worst UA, m (median, 95 %)"
    )
    left.legend(fontsize=8)
    right.set(yticks=range(len(cases)), yticklabels=cases, xlim=(0, 1), xlabel="messages that arrived, share")
    right.invert_yaxis()
    figure.savefig(directory / "error.png", dpi=130)
    plt.close(figure)


def median_interval(values: Floats, level: float = 0.95) -> tuple[Floats, Floats, Floats]:
    """Lower end, median and upper end of an interval for the median over the first axis, from order statistics.

    With n values the ends are those of ranks that a binomial of n draws with chance 1/2 leaves out with less than
    (1 - level) / 2 each (David and Nagaraja, Order Statistics, 7.1): right for any distribution.
    """
    ordered = np.sort(values, axis=0)
    count = len(ordered)
    rank = max(0, int(stats.binom(count, 0.5).ppf((1.0 - level) / 2.0)) - 1)
    return ordered[rank], np.median(ordered, axis=0), ordered[count - 1 - rank]
