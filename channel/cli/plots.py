"""Plots of what commands print."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from channel.checks import FloatArray
from channel.config import PayloadLength, RadioConfig
from channel.link.gain_law import chance_of_less
from channel.link.radio import Radio
from channel.numbers.intervals import proportion_interval

if TYPE_CHECKING:
    from channel.fit.flight_log import FlightLog

BIN_WIDTH_M = 20.0
GAINS_DB = (-80.0, 40.0)
"""Among which the middle 90 % of a received power lies."""


def axes_of(rows: int, columns: int, size: tuple[float, float]) -> tuple[Any, Any]:
    """Return a figure that needs no display, and its axes by row and column."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=size, layout="constrained")
    FigureCanvasAgg(figure)
    return figure, figure.subplots(rows, columns, squeeze=False)


def plot_fit(log: FlightLog, fitted: RadioConfig, file: Path) -> None:
    """Draw a log over the fitted radio: readings, if it has any, and the share of delivered packets by distance.

    The radio's curve is an average over places and packets. In a log whose shadowing is correlated, packets of one
    place are shadowed alike: their share may lie far from it, where neighbours do, too.
    """
    heard = log.delivered & np.isfinite(log.rssi_dbm)
    figure, axes = axes_of(1 + bool(heard.any()), 1, (7.0, 7.5 if heard.any() else 4.2))
    radio = Radio(fitted.model_copy(update={"length": PayloadLength()}))  # a log's lengths are the model's
    distance_m = np.linspace(max(log.distance_m.min(), 1.0), log.distance_m.max(), 300)
    if heard.any():
        _draw_readings(axes[0, 0], radio, distance_m, log.part(heard))
    _draw_deliveries(axes[-1, 0], radio, distance_m, log)
    figure.savefig(file, dpi=120)


def _draw_readings(axis: Any, radio: Radio, distance_m: FloatArray, heard: FlightLog) -> None:
    """Draw readings over the mean power and the middle 90 % of what shadowing and fading make of it."""
    mean_dbm = radio.mean_power_dbm(radio.path(distance_m))
    gains_db = np.linspace(*GAINS_DB, 1601)
    below = chance_of_less(radio, radio.path(np.full(gains_db.size, distance_m[-1])), gains_db)
    low_db, high_db = (gains_db[np.argmax(below >= level)] for level in (0.05, 0.95))
    axis.fill_between(
        distance_m, mean_dbm + low_db, mean_dbm + high_db, color="0.85", label="90 % of all packets"
    )
    axis.plot(distance_m, mean_dbm, color="0.3", label="mean power, of lost packets, too")
    axis.plot(heard.distance_m, heard.rssi_dbm, ".", ms=2, label="readings: of packets that arrived")
    axis.axhline(radio.noise_floor_dbm, color="0.3", ls=":", label="noise floor")
    axis.set(xlabel="distance [m]", ylabel="received power [dBm]")
    axis.legend()


def _draw_deliveries(axis: Any, radio: Radio, distance_m: FloatArray, log: FlightLog) -> None:
    """Draw the share delivered in bins, with 95 % intervals, over the curve averaged over all random terms."""
    filled, index = np.unique(log.distance_m // BIN_WIDTH_M, return_inverse=True)
    sent, arrived = np.bincount(index), np.bincount(index, weights=log.delivered)
    low, high = proportion_interval(arrived, sent, 0.95)
    share = arrived / sent
    centres = (filled + 0.5) * BIN_WIDTH_M
    axis.errorbar(centres, share, yerr=(share - low, high - share), fmt="o", ms=3, label="log, 20 m bins")
    lengths, counts = np.unique(log.length_bytes, return_counts=True)
    curve = sum(
        count * radio.probability_of_delivery(distance_m, float(length))
        for length, count in zip(lengths, counts / counts.sum(), strict=True)
    )
    axis.plot(distance_m, curve, color="0.3", label="fitted radio, averaged over shadowing and fading")
    axis.set(xlabel="distance [m]", ylabel="probability of delivery", ylim=(-0.02, 1.02))
    axis.legend()


def plot_sweep(rows: list[dict[str, float]], key: str, file: Path) -> None:
    """Draw received power and probability of delivery of a sweep against its key."""
    figure, ((left, right),) = axes_of(1, 2, (10.0, 4.0))
    values = [row[key] for row in rows]
    for axis, column in ((left, "received_power_dbm"), (right, "probability_of_delivery")):
        axis.plot(values, [row[column] for row in rows])
        axis.set(xlabel=key, ylabel=column)
    figure.savefig(file, dpi=120)
