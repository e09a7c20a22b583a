"""Does it pay to keep autopilot and physics on one core? Real arducopters at full speed, placed and left alone in turn.

Each figure is the real-time factor over that of ``--placement spread`` in the same round; medians of the rounds.
Without an arducopter (ARDUPILOT_HOME, PATH) the stand-in flies.
"""

from __future__ import annotations

import argparse
import itertools
import json
import os
import statistics
from collections.abc import Sequence
from typing import get_args

from benchmarks.fdm.bench_fdm import load
from benchmarks.fdm.bench_fdm_ardupilot import (
    arducopter_command,
    factor_with_physics,
    find_arducopter,
    running,
)
from benchmarks.fdm.bench_fdm_fleet import standin_commands
from fdm.exchange.aircraft_spec import default_port
from fdm.exchange.settings import Coupling, Placement

FIRST_INSTANCE = 170


def measure_round(ua: int, coupling: Coupling, instance: int, seconds: float) -> dict[str, float]:
    """Real-time factors of `ua` autopilots by placement; `auto` is measured after it has decided."""
    binary, factors = find_arducopter(), {}
    instances = range(instance, instance + ua)
    for placement in get_args(Placement):
        warm_up_s = 4.0 if placement == "auto" and ua == 1 and coupling == "serial" else 1.0
        with running(
            lambda i: arducopter_command(binary, i) if binary else standin_commands([i], 1)[0], instances
        ):
            factors[placement], _ = factor_with_physics(
                [default_port(i) for i in instances],
                min(warm_up_s, 4.0 * seconds),
                seconds,
                coupling=coupling,
                placement=placement,
            )
    return factors


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure, print people's lines and one line of JSON."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--seconds", type=float, default=2.0, help="wall time of each measure")
    parser.add_argument("--instance", type=int, default=FIRST_INSTANCE, help="of ArduPilot, below 250")
    parser.add_argument("--ua", type=int, nargs="+", default=[1, 2])
    parser.add_argument("--coupling", choices=get_args(Coupling), nargs="+", default=get_args(Coupling))
    options = parser.parse_args(arguments)
    who = "arducopter" if find_arducopter() else "the stand-in"
    print(f"fdm placement with {who}: load average {load()} on {os.cpu_count()} cores")
    result = {}
    for ua, coupling in itertools.product(options.ua, options.coupling):
        rounds = [
            measure_round(ua, coupling, options.instance, options.seconds) for _ in range(options.rounds)
        ]
        ratios = {
            placement: statistics.median(each[placement] / each["spread"] for each in rounds)
            for placement in get_args(Placement)
        }
        spread = statistics.median(each["spread"] for each in rounds)
        print(
            f"  {ua} UA, {coupling}: real-time factor {spread:.1f} as the system places them; "
            f"shared {ratios['shared']:.2f}, auto {ratios['auto']:.2f} times that",
            flush=True,
        )
        result[f"{ua} UA, {coupling}"] = {"rounds": rounds, "ratios": ratios}
    print(json.dumps({"bench": "fdm_placement", "autopilot": who, "load": load(), "cases": result}))


if __name__ == "__main__":
    main()
