"""Plots of what commands print."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from channel.config import RadioConfig
from channel.fit.flight_log import FlightLog
from channel.intervals import proportion_interval
from channel.link.radio import Radio

BIN_WIDTH_M = 20.0


def axes_of(rows: int, columns: int, size: tuple[float, float]) -> tuple[Any, Any]:
    """Return a figure that needs no display, and its axes by row and column."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=size, layout="constrained")
    FigureCanvasAgg(figure)
    return figure, figure.subplots(rows, columns, squeeze=False)


def plot_fit(log: FlightLog, fitted: RadioConfig, file: Path) -> None:
    """Draw a log's share of delivered packets in 20 m bins, with 95 % intervals, over the fitted curve."""
    figure, ((axis,),) = axes_of(1, 1, (7.0, 4.2))
    filled, index = np.unique(log.distance_m // BIN_WIDTH_M, return_inverse=True)
    sent, arrived = np.bincount(index), np.bincount(index, weights=log.delivered)
    low, high = proportion_interval(arrived, sent, 0.95)
    share = arrived / sent
    centres = (filled + 0.5) * BIN_WIDTH_M
    axis.errorbar(centres, share, yerr=(share - low, high - share), fmt="o", ms=3, label="log, 20 m bins")
    distance = np.linspace(max(log.distance_m.min(), 1.0), log.distance_m.max(), 300)
    lengths = int(np.median(log.length_bytes))
    axis.plot(
        distance, Radio(fitted).probability_of_delivery(distance, lengths), color="0.3", label="fitted model"
    )
    axis.set(xlabel="distance [m]", ylabel="probability of delivery", ylim=(-0.02, 1.02))
    axis.legend()
    figure.savefig(file, dpi=120)


def plot_sweep(rows: list[dict[str, float]], key: str, file: Path) -> None:
    """Draw received power and probability of delivery of a sweep against its key."""
    figure, ((left, right),) = axes_of(1, 2, (10.0, 4.0))
    values = [row[key] for row in rows]
    for axis, column in ((left, "received_power_dbm"), (right, "probability_of_delivery")):
        axis.plot(values, [row[column] for row in rows])
        axis.set(xlabel=key, ylabel=column)
    figure.savefig(file, dpi=120)
