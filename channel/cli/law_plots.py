"""Plots of the laws in `docs/reference/channel-models.md`, drawn by the code that runs flights."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from channel.antenna import HalfWaveDipole, Sector
from channel.checks import FloatArray
from channel.cli.plots import axes_of
from channel.link.radio import Radio
from channel.phy.error_model import Band, ErfcBytes, ErrorModel, UncodedAwgn
from channel.phy.ofdm import OfdmNist, OfdmYans
from channel.presets import load_radio

LENGTH_BYTES = 100.0
BAND = Band(20e6, 20e6)
AIR_TO_AIR: dict[str, dict[str, Any]] = {
    "free-space": {},
    "log-distance": {"exponent": 2.5},
    "two-ray": {},
    "two-slope": {},
}
TO_THE_GROUND: dict[str, dict[str, Any]] = {
    "free-space": {},
    "okumura-hata": {"outside": "warn"},
    "al-hourani": {"environment": "urban"},
    "uma-av": {},
    "rma-av": {},
}


def _loss_db(
    law: dict[str, Any], ground_m: FloatArray, tx_m: float, rx_m: float, hz: float, **more: Any
) -> FloatArray:
    """Return what the way takes, horizon included, dB."""
    radio = Radio(load_radio("perfect", {"propagation": law, "frequency_hz": hz, **more}))
    link = radio.link(ground_distance_m=ground_m, height_tx_m=tx_m, height_rx_m=rx_m, base="rx")
    return np.asarray(
        -sum(
            np.asarray(each.contribution)
            for each in link.terms
            if each.name in ("path_loss_db", "horizon_db")
        )
    )


def _propagation(axes: Any) -> None:
    left, right = axes
    distance = np.geomspace(20.0, 20e3, 4000)
    for model, keys in AIR_TO_AIR.items():
        left.semilogx(
            distance, _loss_db({"model": model} | keys, distance, 40.0, 40.0, 2.4e9), label=model, lw=1
        )
    left.set(title="40 m and 40 m, 2.4 GHz", xlabel="distance, m", ylabel="loss, dB")
    distance = np.geomspace(1e3, 4e3, 400)
    for model, keys in TO_THE_GROUND.items():
        right.plot(
            distance, _loss_db({"model": model} | keys, distance, 100.0, 1.5, 900e6), label=model, lw=1
        )
    right.set(title="100 m and 1.5 m, 900 MHz", xlabel="distance over the ground, m", ylabel="loss, dB")


def _two_rays(axes: Any) -> None:
    left, right = axes
    distance = np.geomspace(50.0, 10e3, 8000)
    free = _loss_db({"model": "free-space"}, distance, 40.0, 40.0, 2.4e9)
    for keys in ({"polarisation": "horizontal"}, {"polarisation": "vertical"}, {"roughness_m": 0.2}):
        law = {"model": "two-ray"} | keys
        label = ", ".join(f"{key} {value}" for key, value in keys.items())
        left.semilogx(distance, free - _loss_db(law, distance, 40.0, 40.0, 2.4e9), label=label, lw=0.7)
    left.set(title="two-ray over free space, 40 m and 40 m, 2.4 GHz", xlabel="distance, m", ylabel="gain, dB")
    distance = np.linspace(1e3, 120e3, 2000)
    for height in (10.0, 40.0, 120.0):
        curved = _loss_db({"model": "free-space"}, distance, height, height, 915e6)
        flat = _loss_db({"model": "free-space"}, distance, height, height, 915e6, earth_radius_factor=None)
        right.plot(distance / 1e3, curved - flat, label=f"{height:g} m and {height:g} m")
    right.set(title="horizon, 4/3 earth, 915 MHz", xlabel="distance, km", ylabel="loss, dB")


def _antennas(axes: Any) -> None:
    left, right = axes
    angle = np.radians(np.arange(-180.0, 181.0))
    upright = np.stack((np.cos(angle), np.zeros_like(angle), -np.sin(angle)), axis=-1)
    level = np.stack((np.cos(angle), np.sin(angle), np.zeros_like(angle)), axis=-1)
    for axis, ways, title in ((left, upright, "elevation"), (right, level, "azimuth")):
        for label, antenna in (("dipole", HalfWaveDipole()), ("sector", Sector())):
            axis.plot(np.degrees(angle), antenna.towards_db(ways), label=label)
        axis.set(title=f"gain by {title}", xlabel=f"{title}, degrees", ylabel="gain, dB")


def _error_models(axes: Any) -> None:
    left, right = axes
    snr = np.linspace(-5.0, 30.0, 701)
    models: dict[str, ErrorModel] = {"erfc-bytes": ErfcBytes()}
    for name in ("bpsk", "qpsk", "16qam", "64qam"):
        models[name] = UncodedAwgn.model_validate({"modulation": name})
    for label, model in models.items():
        left.plot(snr, model.per(snr, LENGTH_BYTES, BAND), label=label)
    left.set(title="100 bytes, B = R = 20 MHz", xlabel="SNR, dB", ylabel="packet error rate")
    for rate in (6, 24, 54):
        keys = {"rate_mbps": rate}
        laws: dict[str, ErrorModel] = {
            "nist": OfdmNist.model_validate(keys),
            "yans": OfdmYans.model_validate(keys),
        }
        for name, law in laws.items():
            style = "-" if name == "nist" else "--"
            right.plot(snr, law.per(snr, LENGTH_BYTES, BAND), style, label=f"{name}, {rate} Mb/s")
    right.set(title="802.11a, 100 bytes", xlabel="SNR, dB", ylabel="packet error rate")


PLOTS: dict[str, Callable[[Any], None]] = {
    "propagation": _propagation,
    "two-ray-and-horizon": _two_rays,
    "antennas": _antennas,
    "error-models": _error_models,
}


def write_law_plots(directory: Path) -> list[Path]:
    """Write one PNG per group of laws into a directory, made if it is not there; return the files."""
    directory.mkdir(parents=True, exist_ok=True)
    files = []
    for name, draw in PLOTS.items():
        figure, (axes,) = axes_of(1, 2, (11.0, 4.2))
        draw(axes)
        for axis in axes:
            axis.grid(visible=True, alpha=0.3)
            axis.legend(fontsize="small")
        files.append(directory / f"{name}.png")
        figure.savefig(files[-1], dpi=120)
    return files
