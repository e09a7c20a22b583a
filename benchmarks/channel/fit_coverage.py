"""How often `lostlink fit` covers the truth: fits of synthetic logs.

`python -m benchmarks.channel.fit_coverage --repeats 100`.

Each set is a radio that differs from the one it is fitted from in every parameter. Logs are drawn with numpy's own
generator, not with the draws of the medium: distances from 0.1 to 1.6 times the range of 50 % delivery, evenly at
random or flown out and back, and received powers of what arrived where the set has them, rounded to the set's step.
With `--correlated` the shadowing is correlated along the track: nine more radios, three of them with
Rician fading, drawn with numpy alone (`benchmarks/channel/correlated_logs.py`).
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

from benchmarks.channel.correlated_logs import FADED, TRUTHS, drawn
from channel.config import RadioConfig
from channel.fit.calibration import fit_radio
from channel.fit.flight_log import FlightLog
from channel.fit.result import Estimate, Fit
from channel.link.radio import Radio
from channel.presets import load_radio

CORRELATED = TRUTHS | FADED
PACKETS = 2000
LENGTH_BYTES = 40.0


@dataclass(frozen=True, slots=True)
class ParameterSet:
    """A radio to find again: what it is fitted from, its own values, what is measured and what is known."""

    base: str
    values: Mapping[str, Any]
    rssi: bool
    rssi_step_db: float = 1.0
    out_and_back: bool = False
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
    "paper-like": _set(
        "moon2020", 11.6, 1.5, 6.8, 0.1, rssi=True, floor_dbm=-337.0, rssi_step_db=0.0, out_and_back=True
    ),
    "one-sided, exponent 3.5": _set("moon2020", 3.5, -2.0, 3.2, 0.04, rssi=True, floor_dbm=-101.0),
    "open, no base loss": _set("corrected", 2.0, -3.0, 4.2, 0.0, rssi=True, floor_dbm=-91.5),
    "obstructed, out and back": _set(
        "corrected", 3.1, 2.5, 8.5, 0.2, rssi=True, floor_dbm=-99.0, rssi_step_db=0.5, out_and_back=True
    ),
    "no RSSI, sigma known": _set(
        "corrected", 2.6, 0.0, 3.5, 0.07, rssi=False, out_and_back=True, hold=("shadowing.sigma_db",)
    ),
    "no RSSI": _set("moon2020", 9.4, -4.0, 6.2, 0.1, rssi=False),
}


def synthetic_log(chosen: ParameterSet, packets: int, seed: Sequence[int]) -> FlightLog:
    """Draw a flight log of a radio with normal or one-sided shadowing."""
    rng = np.random.Generator(np.random.PCG64(np.random.SeedSequence(seed)))
    config = chosen.truth
    radio = Radio(config)
    range_m = half_range_m(config)
    share = np.abs((np.linspace(0.0, 4.0, packets) + 1.0) % 2.0 - 1.0)
    distance = range_m * (0.1 + 1.5 * (share if chosen.out_and_back else rng.uniform(size=packets)))
    loss_db = config.shadowing.loss_db(rng.standard_normal(packets))
    power = radio.mean_power_dbm(radio.path(distance)) - loss_db
    per = radio.per(power - radio.noise_floor_dbm, LENGTH_BYTES)
    delivered = (rng.uniform(size=packets) > per) & (rng.uniform(size=packets) > config.base_loss)
    step_db = chosen.rssi_step_db
    measured = np.round(power / step_db) * step_db if step_db > 0.0 else power
    known = delivered & chosen.rssi
    return FlightLog(distance, delivered, np.full(packets, LENGTH_BYTES), np.where(known, measured, np.nan))


def half_range_m(config: RadioConfig) -> float:
    """Return where half of what base loss leaves arrives, m."""
    distance_m = np.geomspace(1.0, 1e6, 2001)
    arrives = Radio(config).probability_of_delivery(distance_m) / (1.0 - config.base_loss)
    return float(distance_m[np.argmax(arrives < 0.5)])


def truth_of(config: RadioConfig) -> dict[str, float]:
    """Return the values that a fit looks for."""
    return {
        "propagation.exponent": getattr(config.propagation, "exponent", np.nan),
        "offset_db": config.offset_db,
        "shadowing.sigma_db": config.shadowing.spread_db,
        "base_loss": config.base_loss,
        "noise.floor_dbm": Radio(config).noise_floor_dbm,
    }


def one_fit(name: str, repeat: int, packets: int = PACKETS) -> tuple[Fit, float]:
    """Fit one log; return the fit and its CPU time in s."""
    chosen = SETS[name]
    seed = (list(SETS).index(name), repeat)
    log = synthetic_log(chosen, packets, seed)
    start = process_time()
    return fit_radio(log, chosen.known, chosen.hold), process_time() - start


def one_correlated_fit(name: str, repeat: int, packets: int = PACKETS) -> tuple[Fit, float]:
    """Fit one log with correlated shadowing; return the fit and its CPU time in s."""
    distance_m, delivered, rssi_dbm = drawn(
        CORRELATED[name], packets, (77, list(CORRELATED).index(name), repeat)
    )
    log = FlightLog(distance_m, delivered, np.full(packets, LENGTH_BYTES), rssi_dbm)
    start = process_time()
    return fit_radio(log, load_radio("corrected")), process_time() - start


def levels_held(name: str, fits: Sequence[Fit]) -> int:
    """Return how many intervals of the level at the log's mean distance hold the true mean."""
    levels = [
        (each.level, float(CORRELATED[name].mean_dbm(each.level.distance_m))) for each in fits if each.level
    ]
    return sum(level.low_dbm <= truth <= level.high_dbm for level, truth in levels)


def coverage(name: str, fits: Sequence[Fit]) -> dict[str, tuple[int, int]]:
    """Return by parameter how many intervals hold the truth, and how many have two ends; held ones left out."""
    if name in CORRELATED:
        return _held(CORRELATED[name].by_name, fits)
    chosen = SETS[name]
    left_out = {*chosen.hold, *(() if chosen.rssi else ("noise.floor_dbm",))}
    return _held({key: value for key, value in truth_of(chosen.truth).items() if key not in left_out}, fits)


def _held(truth: Mapping[str, float], fits: Sequence[Fit]) -> dict[str, tuple[int, int]]:
    rows: dict[str, tuple[int, int]] = {}
    for parameter, value in truth.items():
        unknown = Estimate(parameter, None, -np.inf, np.inf)
        found = [next((each for each in fit.estimates if each.name == parameter), unknown) for fit in fits]
        covered = sum(each.low <= value <= each.high for each in found)
        rows[parameter] = covered, sum(bool(np.isfinite([each.low, each.high]).all()) for each in found)
    return rows


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeats", type=int, default=10)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--packets", type=int, default=PACKETS)
    parser.add_argument("--correlated", action="store_true", help="shadowing correlated along the track")
    parser.add_argument("--only", default="", metavar="TEXT", help="radios whose names have this in them")
    options = parser.parse_args(arguments)
    names, fit_one = (list(CORRELATED), one_correlated_fit) if options.correlated else (list(SETS), one_fit)
    print(f"{'set':<28}{'parameter':<22}{'truth':>9}{'covered':>9}{'two ends':>10}   of {options.repeats}")
    with ProcessPoolExecutor(options.jobs) as pool:
        for name in (each for each in names if options.only in each):
            results = list(pool.map(partial(fit_one, name, packets=options.packets), range(options.repeats)))
            fits = [fit for fit, _ in results]
            truth = CORRELATED[name].by_name if options.correlated else truth_of(SETS[name].truth)
            for parameter, (covered, finite) in coverage(name, fits).items():
                print(f"{name:<28}{parameter:<22}{truth[parameter]:>9.4g}{covered:>9}{finite:>10}")
            if options.correlated:
                taken = sum(fit.correlated for fit in fits)
                print(f"{name:<28}level held {levels_held(name, fits)}, taken for correlated {taken}")
            times = [seconds for _, seconds in results]
            print(
                f"{name:<28}CPU per fit: median {np.median(times):.2f} s, most {max(times):.2f} s", flush=True
            )


if __name__ == "__main__":
    main()
