"""Plots of the random terms, drawn as in a run, beside what theory says of them."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np

from channel.checks import FloatArray
from channel.cli.plots import axes_of
from channel.draws import Draws
from channel.fading.laws import Rayleigh, Rician
from channel.fading.link_words import LinkWords
from channel.fading.place_field import PlaceField
from channel.fading.scatter import Scatter
from channel.fading.terms import LastingFading
from channel.fading.waves import LinkPlaces, link_places
from channel.link.radio import Radio
from channel.numbers.units import SPEED_OF_LIGHT_MPS
from channel.presets import load_radio

CARRIER_HZ = 2.4e9
WAVELENGTH_M = SPEED_OF_LIGHT_MPS / CARRIER_HZ
START_NED_M = np.array([0.0, 800.0, -40.0])
TRACKS = 60
STEPS_PER_WAVE = 100
WAVES_LONG = 60
STILL_S = 1e4
"""Surroundings that stand still."""
DECORRELATION_M = 25.0


def write_random_plots(directory: Path, seed: int = 1) -> list[Path]:
    """Write `fading.png`, `shadowing.png` and `line-of-sight.png` into a directory; return the files."""
    directory.mkdir(parents=True, exist_ok=True)
    files = [directory / f"{name}.png" for name in ("fading", "shadowing", "line-of-sight")]
    for file, plot in zip(files, (_plot_fading, _plot_shadowing, _plot_line_of_sight), strict=True):
        plot(seed).savefig(file, dpi=120)
    return files


def _track(seed: int, link: int, along_m: FloatArray) -> LinkPlaces:
    """Return one link while its receiver flies north."""
    words = LinkWords(seed, ["tx", *(f"rx{k}" for k in range(TRACKS))], "fields")
    places = START_NED_M + along_m[:, np.newaxis] * np.array([1.0, 0.0, 0.0])
    tx, rx = np.zeros(along_m.size, dtype=np.intp), np.full(along_m.size, link + 1)
    return link_places(words, tx, rx, np.array([0.0, 0.0, -40.0]), places, 0)


def _plot_fading(seed: int) -> Any:
    figure, ((left, middle, right),) = axes_of(1, 3, (14.0, 4.0))
    waves = np.arange(WAVES_LONG * STEPS_PER_WAVE) / STEPS_PER_WAVE
    links = [_track(seed, k, waves * WAVELENGTH_M) for k in range(TRACKS)]
    none, still = np.zeros(waves.size), np.zeros(waves.size, dtype=np.int64)
    rayleigh, rician = (
        Rayleigh(coherence="doppler", max_coherence_s=STILL_S),
        Rician(k_db=10.0, coherence="doppler", max_coherence_s=STILL_S),
    )
    distance_m = np.hypot(START_NED_M[1], waves * WAVELENGTH_M)
    for model, label in ((rayleigh, "Rayleigh"), (rician, "Rician, K = 10 dB")):
        fading = LastingFading(model, Draws(seed), CARRIER_HZ)
        gain_db = fading.gain_db(links[0], still, distance_m, none, none)
        left.plot(waves[: 8 * STEPS_PER_WAVE], gain_db[: 8 * STEPS_PER_WAVE], label=label)
    left.set(xlabel="way [wavelengths]", ylabel="gain [dB]", ylim=(-35.0, 10.0))
    left.legend()
    from scipy.special import j0

    scatter = Scatter(Draws(seed), CARRIER_HZ, 0.0)
    fields = np.array([scatter.field(link) for link in links])
    lags = np.arange(3 * STEPS_PER_WAVE)
    found = [np.mean((fields[:, : waves.size - lag] * fields[:, lag:].conj()).real) for lag in lags]
    middle.plot(lags / STEPS_PER_WAVE, found, ".", ms=3, label=f"{TRACKS} links of one run")
    middle.plot(lags / STEPS_PER_WAVE, j0(2.0 * math.pi * lags / STEPS_PER_WAVE), color="0.3", label="J0")
    middle.set(xlabel="way [wavelengths]", ylabel="autocorrelation")
    middle.legend()
    power_db = 20.0 * np.log10(np.abs(fields))
    levels_db = np.arange(-25.0, 7.0)
    crossed = [
        np.sum((power_db[:, :-1] < v) & (power_db[:, 1:] >= v)) / TRACKS / WAVES_LONG for v in levels_db
    ]
    rho = 10.0 ** (levels_db / 20.0)
    right.semilogy(levels_db, crossed, ".", label=f"{TRACKS} links of one run")
    right.semilogy(levels_db, math.sqrt(2.0 * math.pi) * rho * np.exp(-rho * rho), color="0.3", label="Rice")
    right.set(xlabel="level over the mean power [dB]", ylabel="crossings per wavelength")
    right.legend()
    return figure


def _plot_shadowing(seed: int) -> Any:
    figure, ((left, right),) = axes_of(1, 2, (10.0, 4.0))
    along_m = np.arange(0.0, 2000.0, 1.0)
    lags_m = np.arange(0, 121, 3)
    products = np.zeros(lags_m.size)
    for run in range(seed, seed + 20):
        field = PlaceField(Draws(run), DECORRELATION_M, "shadow field")
        z = np.array([field.standard_normal(_track(run, k, along_m)) for k in range(10)])
        products += [np.mean(z[:, : along_m.size - lag] * z[:, lag:]) / 20.0 for lag in lags_m]
        if run == seed:
            left.plot(along_m[:500], z[:3, :500].T)
    left.set(xlabel="way [m]", ylabel="shadowing / sigma", title="three links of one run")
    right.plot(lags_m, products, ".", label="10 links of each of 20 runs")
    right.plot(lags_m, np.exp(-lags_m / DECORRELATION_M), color="0.3", label="exp(-d / 25 m)")
    right.set(xlabel="way [m]", ylabel="autocorrelation")
    right.legend()
    return figure


def _plot_line_of_sight(seed: int) -> Any:
    figure, ((left, right),) = axes_of(1, 2, (10.0, 4.0))
    ground_m = np.linspace(100.0, 3500.0, 120)
    for which, label in (
        ("drawn", "mixture of both states"),
        ("expected", "mean of both in dB"),
        ("always", "line of sight"),
        ("never", "no line of sight"),
    ):
        tree = {"propagation": {"model": "uma-av", "line_of_sight": which}}
        radio = Radio(load_radio("corrected", tree))
        chance = radio.probability_of_delivery(ground_distance_m=ground_m, height_tx_m=25.0, height_rx_m=60.0)
        left.plot(ground_m, chance, label=label)
    left.set(xlabel="distance over the ground [m]", ylabel="probability of delivery")
    left.legend()
    along_m = np.arange(0.0, 2000.0, 1.0)
    track = _track(seed, 0, along_m)
    field = PlaceField(Draws(seed), 50.0, "line of sight").standard_normal(track)
    right.plot(along_m, field, lw=0.8, label="field of the link")
    right.fill_between(along_m, -3.0, 3.0, where=field < 0.0, alpha=0.2, label="line of sight, P = 1/2")
    right.set(xlabel="way [m]", ylabel="z", ylim=(-3.0, 3.0))
    right.legend()
    return figure
