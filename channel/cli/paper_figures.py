"""The paper's figures 5 and 6, drawn by the code that runs flights: received power and probability of delivery."""

from __future__ import annotations

import csv
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from channel.checks import FloatArray
from channel.cli.plots import axes_of
from channel.draws import Draws
from channel.link.radio import Radio
from channel.medium.simulate import simulate
from channel.presets import load_radio

FREQUENCIES_HZ = (2412e6, 2462e6, 5180e6, 5815e6)
"""Ends of the paper's two bands (Table III: 2412-2462 and 5180-5815 MHz)."""
FREQUENCY_DISTANCE_M = 360.0
"""Where the axes of the upper half of Fig. 5 put it."""
DISTANCES_M = (120.0, 240.0, 360.0, 480.0)
BOX_DISTANCES_M = tuple(float(d) for d in range(60, 601, 60))
BIN_WIDTH_M = 20.0
FARTHEST_M = 600.0
PACKETS = 500
FLIGHT_LEVEL = 0.90
FLIGHT_RANGE_M = (100.0, 300.0)
"""What the text quotes of 21 flights: about 0.90 delivered between 100 and 300 m."""
RADIOS = ("moon2020", "moon2020-table3", "corrected")


@dataclass(frozen=True, slots=True)
class Figures:
    """The numbers behind the figures of one radio.

    Attributes:
        radio: its name.
        by_frequency: received power at 360 m for each frequency, shape (frequencies, packets), dBm.
        by_distance: received power at 2412 MHz for each of four distances, shape (distances, packets), dBm.
        boxes: received power for 60..600 m, shape (distances, packets), dBm.
        bin_centres_m: of the 20 m bins.
        simulated: share of delivered packets in each bin.
        curve_distance_m: of the closed curve.
        curve: probability of delivery averaged over the random terms.
    """

    radio: str
    by_frequency: FloatArray
    by_distance: FloatArray
    boxes: FloatArray
    bin_centres_m: FloatArray
    simulated: FloatArray
    curve_distance_m: FloatArray
    curve: FloatArray


def figure_data(name: str, seed: int = 1) -> Figures:
    """Return the numbers behind the figures of one radio, 500 packets each."""
    radio = Radio(load_radio(name))
    draws = Draws(seed)

    def powers(kind: str, distances: Iterable[float], frequency_hz: float) -> FloatArray:
        column = np.asarray(tuple(distances))[:, np.newaxis]
        links = [(f"{kind} {frequency_hz:.0f} {d:g}", "rx") for d in column[:, 0]]
        return simulate(
            radio, draws, links, column, packets=PACKETS, frequency_hz=frequency_hz
        ).received_power_dbm

    bins = np.arange(0.0, FARTHEST_M, BIN_WIDTH_M)
    along = bins[:, np.newaxis] + BIN_WIDTH_M * (np.arange(PACKETS) + 0.5) / PACKETS
    flown = simulate(radio, draws, [(f"bin {b:g}", "rx") for b in bins], along, packets=PACKETS)
    curve_distance_m = np.linspace(1.0, FARTHEST_M, 600)
    return Figures(
        radio=name,
        by_frequency=np.concatenate([powers("f", (FREQUENCY_DISTANCE_M,), f) for f in FREQUENCIES_HZ]),
        by_distance=powers("d", DISTANCES_M, FREQUENCIES_HZ[0]),
        boxes=powers("box", BOX_DISTANCES_M, FREQUENCIES_HZ[0]),
        bin_centres_m=bins + BIN_WIDTH_M / 2.0,
        simulated=flown.delivered.mean(axis=1),
        curve_distance_m=curve_distance_m,
        curve=radio.probability_of_delivery(curve_distance_m),
    )


def write_figures(directory: Path, radios: Iterable[str] = RADIOS, seed: int = 1) -> list[Path]:
    """Write `fig5-*.png`, `fig6-*.png` and the CSV behind each into a directory; return the files.

    Args:
        directory: made if it is not there.
        radios: presets with random terms that are drawn per packet.
        seed: of the draws.
    """
    directory.mkdir(parents=True, exist_ok=True)
    written: list[Path] = []
    for name in radios:
        data = figure_data(name, seed)
        written += [*_write_fig5(directory, data), *_write_fig6(directory, data)]
    return written


def _write_fig5(directory: Path, data: Figures) -> list[Path]:
    figure, axes = axes_of(2, 4, (12.0, 5.5))
    titles = [f"{f / 1e6:.0f} MHz, {FREQUENCY_DISTANCE_M:g} m" for f in FREQUENCIES_HZ]
    for row, samples, names in (
        (axes[0], data.by_frequency, titles),
        (axes[1], data.by_distance, [f"{d:g} m, {FREQUENCIES_HZ[0] / 1e6:.0f} MHz" for d in DISTANCES_M]),
    ):
        for axis, powers, name in zip(row, samples, names, strict=True):
            axis.hist(powers, bins=20, color="tab:blue", edgecolor="white")
            axis.set(title=name, xlabel="received power [dBm]", ylabel="packets")
    for axis in axes[0]:
        axis.set_xlim(data.by_frequency.min() - 1.0, data.by_frequency.max() + 1.0)
    figure.suptitle(f"{data.radio}: received power of {PACKETS} packets (cf. Fig. 5)")
    png, table = directory / f"fig5-{data.radio}.png", directory / f"fig5-{data.radio}.csv"
    figure.savefig(png, dpi=120)
    rows = [
        (f, FREQUENCY_DISTANCE_M, power)
        for f, powers in zip(FREQUENCIES_HZ, data.by_frequency, strict=True)
        for power in powers
    ]
    rows += [
        (FREQUENCIES_HZ[0], d, power)
        for d, powers in zip(DISTANCES_M, data.by_distance, strict=True)
        for power in powers
    ]
    _write_csv(table, ("frequency_hz", "distance_m", "received_power_dbm"), rows)
    return [png, table]


def _write_fig6(directory: Path, data: Figures) -> list[Path]:
    figure, ((left, right),) = axes_of(1, 2, (11.0, 4.2))
    left.boxplot(data.boxes.T, positions=BOX_DISTANCES_M, widths=30.0)
    left.set(xlabel="distance [m]", ylabel="received power [dBm]", xlim=(30.0, 630.0))
    right.plot(data.curve_distance_m, data.curve, color="0.3", label="model, closed")
    right.plot(data.bin_centres_m, data.simulated, "x", color="tab:blue", label="simulated, 20 m bins")
    right.plot(
        FLIGHT_RANGE_M, (FLIGHT_LEVEL,) * 2, color="tab:red", lw=3, label="flights, as the text quotes them"
    )
    right.set(
        xlabel="distance [m]", ylabel="probability of delivery", xlim=(0.0, FARTHEST_M), ylim=(-0.02, 1.02)
    )
    right.legend(loc="lower left")
    figure.suptitle(f"{data.radio} (cf. Fig. 6)")
    png = directory / f"fig6-{data.radio}.png"
    figure.savefig(png, dpi=120)
    boxes, delivery = (
        directory / f"fig6-{data.radio}-power.csv",
        directory / f"fig6-{data.radio}-delivery.csv",
    )
    powers = [(d, p) for d, row in zip(BOX_DISTANCES_M, data.boxes, strict=True) for p in row]
    _write_csv(boxes, ("distance_m", "received_power_dbm"), powers)
    closed = np.interp(data.bin_centres_m, data.curve_distance_m, data.curve)
    rows = zip(data.bin_centres_m, data.simulated, closed, strict=True)
    _write_csv(delivery, ("distance_m", "simulated", "closed"), rows)
    return [png, boxes, delivery]


def _write_csv(file: Path, header: tuple[str, ...], rows: Iterable[tuple[float, ...]]) -> None:
    with file.open("w", newline="", encoding="utf-8") as out:
        writer = csv.writer(out, lineterminator="\n")
        writer.writerow(header)
        writer.writerows([f"{value:.6g}" for value in row] for row in rows)
