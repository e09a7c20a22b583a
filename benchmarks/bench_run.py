"""How fast whole runs are, alternately with those of another checkout if one is given; medians of real-time factors.

    python -m benchmarks.bench_run [--rounds 5] [--against CHECKOUT] [--only NAME] [--json]

CHECKOUT has its own .venv (`make demo` makes it). With ARDUPILOT_HOME also real arducopters are flown.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml

from bridge.scenario.file import SCENARIOS

ROOT = Path(__file__).parents[1]
SLOT = 130
LONE = "lone"
"""Key of what is no part of the scenario: only the UA that flies."""
FLIGHTS: dict[str, dict[str, Any]] = {
    "stand-in pair": {},
    "arducopter pair": {"autopilot": "ardupilot"},
    "arducopter pair, parallel": {"autopilot": "ardupilot", "fdm": {"coupling": "parallel"}},
    "lone arducopter": {"autopilot": "ardupilot", LONE: True},
    "lone arducopter, parallel": {"autopilot": "ardupilot", "fdm": {"coupling": "parallel"}, LONE: True},
}


def scenario_of(changes: Mapping[str, Any], duration_s: float | None) -> dict[str, Any]:
    """`separation`, changed."""
    content: dict[str, Any] = yaml.safe_load((SCENARIOS / "separation.yaml").read_text(encoding="utf-8"))
    content |= {key: value for key, value in changes.items() if key != LONE}
    content["ports"] = {"zenoh": 0, "first_slot": SLOT}
    if LONE in changes:
        content["nodes"] = content["nodes"][1:]
    if duration_s is not None:
        content["duration_s"] = duration_s
    return content


def real_time_factor(checkout: Path, content: Mapping[str, Any]) -> float:
    """Of one run, flown by a checkout's own code."""
    with tempfile.TemporaryDirectory() as scratch:
        file = Path(scratch) / "scenario.yaml"
        file.write_text(yaml.safe_dump(dict(content)), encoding="utf-8")
        command = [str(checkout / ".venv" / "bin" / "lostlink"), "run", str(file), "--json", "--out", scratch]
        done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=checkout)
        if not done.stdout:
            raise RuntimeError(f"{checkout}: {done.stderr}")
        return float(json.loads(done.stdout)["real_time_factor"])


def measure(content: Mapping[str, Any], checkouts: Sequence[Path], rounds: int) -> dict[str, Any]:
    """Fly alternately; medians, and the ratio of the first checkout to the last."""
    factors: list[list[float]] = [[] for _ in checkouts]
    for _ in range(rounds):
        for index, checkout in enumerate(checkouts):
            factors[index].append(real_time_factor(checkout, content))
    medians = [statistics.median(each) for each in factors]
    return {
        "real_time_factor": round(medians[0], 2),
        "against": round(medians[-1], 2) if len(checkouts) > 1 else None,
        "ratio": round(medians[0] / medians[-1], 2) if len(checkouts) > 1 else None,
        "all": [[round(factor, 2) for factor in each] for each in factors],
    }


def main(arguments: Sequence[str]) -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--against", type=Path, help="another checkout")
    parser.add_argument("--only", default="", help="flights with this in their name")
    parser.add_argument("--duration", type=float, help="sim time of each run, s; else to its end")
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args(arguments)
    checkouts = [ROOT, *([options.against] if options.against else [])]
    rows: dict[str, dict[str, Any]] = {}
    for name, changes in FLIGHTS.items():
        if options.only not in name or ("autopilot" in changes and "ARDUPILOT_HOME" not in os.environ):
            continue
        rows[name] = measure(scenario_of(changes, options.duration), checkouts, options.rounds)
        if not options.json:
            row = rows[name]
            ratio = f", {row['ratio']} times the {row['against']} of the other" if options.against else ""
            print(f"{name:<28} real-time factor {row['real_time_factor']}{ratio}   {row['all']}", flush=True)
    if options.json:
        print(json.dumps(rows))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
