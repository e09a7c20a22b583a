"""`lostlink fit` on radios drawn at random, one log each: `python -m benchmarks.channel.fit_random --radios 200`.

Counts by kind of reading how many of all 95 % intervals hold the truth. Exponents 2 to 12, sigma 0 to 10 dB, base loss
0 to 0.3, other offsets and floors than the radio to start from; distances evenly or out and back; received powers
exact, in steps of 1 dB, with an error of 1 dB as well, or none at all, with or without exponent or sigma being known.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from time import process_time

import numpy as np

from benchmarks.channel.fit_coverage import PACKETS, ParameterSet, synthetic_log, truth_of
from channel.fit.calibration import fit_radio
from channel.fit.flight_log import FlightLog
from channel.link.radio import Radio
from channel.presets import load_radio

BASES = {"moon2020": (6.0, 12.0), "gazebo-classic": (3.0, 8.0), "corrected": (2.0, 3.8)}
READINGS = ("exact", "1 dB", "1 dB, error 1 dB", "none, exponent known", "none, sigma known", "none")
HELD = {"none, exponent known": ("propagation.exponent",), "none, sigma known": ("shadowing.sigma_db",)}


def random_set(rng: np.random.Generator, reading: str) -> ParameterSet:
    """Draw a radio and how it is flown."""
    base = str(rng.choice(list(BASES)))
    floor_dbm = Radio(load_radio(base)).noise_floor_dbm
    values = {
        "propagation": {"exponent": float(rng.uniform(*BASES[base]))},
        "offset_db": float(rng.uniform(-6.0, 6.0)),
        "shadowing": {"sigma_db": float(rng.uniform(0.0, 10.0))},
        "base_loss": float(rng.choice([0.0, rng.uniform(0.0, 0.3)])),
        "earth_radius_factor": None,  # some reach beyond the horizon, where a fit's law ends
    }
    rssi = not reading.startswith("none")
    if rssi:
        values["noise"] = {"model": "fixed", "floor_dbm": floor_dbm + float(rng.uniform(-6.0, 6.0))}
    step_db = 0.0 if reading == "exact" else 1.0
    return ParameterSet(
        base,
        values,
        rssi,
        rssi_step_db=step_db,
        out_and_back=bool(rng.integers(2)),
        hold=HELD.get(reading, ()),
    )


def random_log(chosen: ParameterSet, reading: str, seed: int, rng: np.random.Generator) -> FlightLog:
    """Draw its log."""
    if "error" not in reading:
        return synthetic_log(chosen, PACKETS, (seed,))
    log = synthetic_log(replace(chosen, rssi_step_db=0.0), PACKETS, (seed,))
    return replace(log, rssi_dbm=np.round(log.rssi_dbm + rng.normal(0.0, 1.0, PACKETS)))


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--radios", type=int, default=60)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args(arguments)
    total, held, closed, times = Counter[str](), Counter[str](), Counter[str](), []
    for k in range(options.radios):
        rng = np.random.Generator(np.random.PCG64((options.seed, k)))
        reading = READINGS[k % len(READINGS)]
        chosen = random_set(rng, reading)
        log = random_log(chosen, reading, options.seed * 1_000_000 + k, rng)
        start = process_time()
        fit = fit_radio(log, chosen.known, chosen.hold)
        times.append(process_time() - start)
        truth = truth_of(chosen.truth)
        for estimate in fit.estimates:
            if estimate.name in chosen.hold or (estimate.name == "noise.floor_dbm" and not chosen.rssi):
                continue
            total[reading] += 1
            held[reading] += estimate.low <= truth[estimate.name] <= estimate.high
            closed[reading] += estimate.value is not None
    print(f"{'RSSI':<24}{'intervals':>10}{'hold':>8}{'two ends':>10}")
    for name in total:
        print(
            f"{name:<24}{total[name]:>10}{held[name] / total[name]:>8.3f}{closed[name] / total[name]:>10.2f}"
        )
    print(f"all: {held.total() / total.total():.3f} of {total.total()}")
    print(f"CPU per fit: median {np.median(times):.2f} s, most {max(times):.1f} s")


if __name__ == "__main__":
    main()
