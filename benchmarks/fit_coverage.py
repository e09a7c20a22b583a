"""How often `lostlink fit` covers the truth: fits of synthetic logs, `python -m benchmarks.fit_coverage --repeats 100`.

Each set is a radio that differs from the one it is fitted from in every parameter. Logs are drawn with numpy's own
generator, not with the draws of the medium: distances evenly over 0.1 to 1.6 times the range of 50 % delivery,
received powers of what arrived rounded to whole dB, as a modem reports them, where the set has them.
A parameter is covered if its 95 % interval holds the truth; how many of the intervals had two ends is counted, too.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from time import process_time
from typing import Any

import numpy as np

from channel.calibration import Fit, fit_radio
from channel.config import RadioConfig
from channel.flight_log import FlightLog
from channel.presets import load_radio
from channel.radio import Radio
from channel.sweep import reach

PACKETS = 2000
LENGTH_BYTES = 40.0


@dataclass(frozen=True, slots=True)
class ParameterSet:
    """A radio to find again: what it is fitted from, its own values, what is measured and what is known."""

    base: str
    values: Mapping[str, Any]
    rssi: bool
    hold: tuple[str, ...] = ()

    @property
    def truth(self) -> RadioConfig:
        """The radio that draws the log."""
        return load_radio(self.base, self.values)

    @property
    def known(self) -> RadioConfig:
        """The radio to fit from: the base, with the true values of what is held."""
        held = {name.split(".")[0]: self.values[name.split(".")[0]] for name in self.hold}
        return load_radio(self.base, held)


def _set(
    base: str, exponent: float, offset_db: float, sigma_db: float, base_loss: float, **more: Any
) -> ParameterSet:
    values: dict[str, Any] = {
        "propagation": {"exponent": exponent},
        "offset_db": offset_db,
        "shadowing": {"sigma_db": sigma_db},
        "base_loss": base_loss,
    }
    if "floor_dbm" in more:
        values["noise"] = {"model": "fixed", "floor_dbm": more.pop("floor_dbm")}
    return ParameterSet(base, values, **more)


SETS = {
    "steep, much shadowing": _set("corrected", 3.4, -4.0, 7.0, 0.12, rssi=True, floor_dbm=-93.0),
    "nearly free space": _set("corrected", 2.15, 1.5, 2.5, 0.03, rssi=True, floor_dbm=-97.5),
    "one-sided, steep": _set("moon2020", 10.6, 3.0, 5.0, 0.08, rssi=True, floor_dbm=-331.0),
    "one-sided, less steep": _set("moon2020", 7.2, -6.0, 9.0, 0.01, rssi=True, floor_dbm=-270.0),
    "deliveries, sigma known": _set(
        "moon2020", 11.1, 2.0, 4.0, 0.1, rssi=False, hold=("shadowing.sigma_db",)
    ),
    "deliveries, exponent known": _set(
        "corrected", 2.8, -1.0, 4.5, 0.06, rssi=False, hold=("propagation.exponent",)
    ),
}


def synthetic_log(config: RadioConfig, packets: int, *, rssi: bool, seed: Sequence[int]) -> FlightLog:
    """Draw a flight log of a radio with normal or one-sided shadowing."""
    rng = np.random.Generator(np.random.PCG64(np.random.SeedSequence(seed)))
    radio = Radio(config)
    range_m = reach(config).range_50_m / (1.0 - config.base_loss)
    distance = rng.uniform(0.1 * range_m, 1.6 * range_m, packets)
    loss_db = config.shadowing.loss_db(rng.standard_normal(packets))
    power = radio.mean_power_dbm(radio.path(distance)) - loss_db
    per = radio.per(power - radio.noise_floor_dbm, LENGTH_BYTES)
    delivered = (rng.uniform(size=packets) > per) & (rng.uniform(size=packets) > config.base_loss)
    measured = np.where(delivered & rssi, np.round(power), np.nan)
    return FlightLog(distance, delivered, np.full(packets, LENGTH_BYTES), measured)


def truth_of(config: RadioConfig) -> dict[str, float]:
    """Return the values that a fit looks for."""
    return {
        "propagation.exponent": getattr(config.propagation, "exponent", np.nan),
        "offset_db": config.offset_db,
        "shadowing.sigma_db": config.shadowing.spread_db,
        "base_loss": config.base_loss,
        "noise.floor_dbm": Radio(config).noise_floor_dbm,
    }


def one_fit(name: str, repeat: int) -> tuple[Fit, float]:
    """Fit one log; return the fit and its CPU time in s."""
    chosen = SETS[name]
    seed = (list(SETS).index(name), repeat)
    log = synthetic_log(chosen.truth, PACKETS, rssi=chosen.rssi, seed=seed)
    start = process_time()
    return fit_radio(log, chosen.known, chosen.hold), process_time() - start


def coverage(name: str, fits: Sequence[Fit]) -> dict[str, tuple[int, int]]:
    """Return by parameter how many intervals hold the truth, and how many have two ends; held ones left out."""
    truth, chosen = truth_of(SETS[name].truth), SETS[name]
    rows: dict[str, tuple[int, int]] = {}
    for parameter, value in truth.items():
        if parameter in chosen.hold or (parameter == "noise.floor_dbm" and not chosen.rssi):
            continue
        found = [next(each for each in fit.estimates if each.name == parameter) for fit in fits]
        covered = sum(each.low <= value <= each.high for each in found)
        rows[parameter] = covered, sum(bool(np.isfinite([each.low, each.high]).all()) for each in found)
    return rows


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeats", type=int, default=10)
    parser.add_argument("--jobs", type=int, default=1)
    options = parser.parse_args(arguments)
    print(f"{'set':<28}{'parameter':<22}{'truth':>9}{'covered':>9}{'two ends':>10}   of {options.repeats}")
    with ProcessPoolExecutor(options.jobs) as pool:
        for name in SETS:
            results = list(pool.map(partial(one_fit, name), range(options.repeats)))
            truth = truth_of(SETS[name].truth)
            for parameter, (covered, finite) in coverage(name, [fit for fit, _ in results]).items():
                print(f"{name:<28}{parameter:<22}{truth[parameter]:>9.4g}{covered:>9}{finite:>10}")
            times = [seconds for _, seconds in results]
            print(
                f"{name:<28}CPU per fit: median {np.median(times):.2f} s, most {max(times):.2f} s", flush=True
            )


if __name__ == "__main__":
    main()
