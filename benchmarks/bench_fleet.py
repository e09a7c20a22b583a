"""How fast whole runs are beside their physics and autopilots alone, over the number of UA; medians of rounds.

    python -m benchmarks.bench_fleet [--autopilot arducopter] [--sizes 1 2 4 8 16] [--modes one many one+1]

Each UA hovers at 40 m (alone: arducopters stand on the ground, stand-ins hover), 60 m from the next, transmits at 20 Hz
to all over `corrected`, and everything is recorded. A mode is a value of the scenario's ``processes``, with ``+1`` for
``lookahead_ticks: 1``. CPU time of all processes of the run, autopilots included, is per second of sim time.
"""

from __future__ import annotations

import argparse
import json
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import yaml

from benchmarks.record.bench_recording import cpu_s

ROOT = Path(__file__).parents[1]
SLOT = 100
ALTITUDE_M = 40.0
SPACING_M = 60.0
MODES = ("one", "many", "one+1", "many+1")


def scenario(autopilot: str, size: int, mode: str, duration_s: float, slot: int = SLOT) -> dict[str, Any]:
    """Some UA that hover."""
    processes, _, lookahead = mode.partition("+")
    agent = {"type": "hold", "altitude_m": ALTITUDE_M}
    return {
        "schema": 1,
        "name": "fleet",
        "autopilot": "standin" if autopilot == "standin" else "ardupilot",
        "speed": "max",
        "duration_s": duration_s,
        "processes": processes,
        "lookahead_ticks": int(lookahead or 0),
        "figure": False,
        "origin": {"lat_deg": 40.1331, "lon_deg": -105.2404, "alt_amsl_m": 1690.0},
        "radio": "corrected",
        "ports": {"zenoh": 0, "first_slot": slot},
        "nodes": [
            {"id": number, "home": {"north_m": SPACING_M * number}, "agent": agent} for number in range(size)
        ],
    }


def flown(content: dict[str, Any], command: Sequence[str], cwd: Path = ROOT) -> dict[str, float]:
    """One run: its real-time factor, and CPU time per sim time with start and record."""
    with tempfile.TemporaryDirectory() as scratch:
        file = Path(scratch) / "scenario.yaml"
        file.write_text(yaml.safe_dump(content), encoding="utf-8")
        before_s = cpu_s()
        done = subprocess.run(
            [*command, "run", str(file), "--json", "--out", scratch],
            capture_output=True,
            text=True,
            check=False,
            cwd=cwd,
        )
        if not done.stdout:
            raise RuntimeError(done.stderr)
        summary = json.loads(done.stdout)
        if summary["error"] is not None:
            raise RuntimeError(summary["error"])
        per_sim_s = (cpu_s() - before_s) / summary["sim_duration_s"]
    return {"factor": summary["real_time_factor"], "cpu": per_sim_s}


def alone(autopilot: str, size: int, wall_s: float = 5.0, slot: int = SLOT) -> float:
    """The real-time factor of physics and autopilots alone, over ``wall_s`` (`benchmarks.fdm.bench_fdm_fleet`)."""
    command = [
        sys.executable,
        "-m",
        "benchmarks.fdm.bench_fdm_fleet",
        "--autopilot",
        autopilot,
        "--speed",
        "max",
    ]
    command += ["--sizes", str(size), "--coupling", "serial", "--instance", str(slot)]
    command += ["--seconds", str(wall_s)]
    command += ["--hover"] if autopilot == "standin" else []
    done = subprocess.run(command, capture_output=True, text=True, check=True, cwd=ROOT)
    (curve,) = json.loads(done.stdout.splitlines()[-1])["curves"].values()
    return float(curve[str(size)][0])


def measure(options: argparse.Namespace, size: int) -> dict[str, Any]:
    """Medians of alternated rounds."""
    autopilot, slot = options.autopilot, options.first_slot
    bare: list[float] = []
    runs: dict[str, list[dict[str, float]]] = {mode: [] for mode in options.modes}
    lostlink = [sys.executable, "-m", "lostlink.cli.main"]
    for _ in range(options.rounds):
        bare.append(alone(autopilot, size, options.seconds, slot))
        for mode in options.modes:
            content = scenario(autopilot, size, mode, options.duration, slot)
            runs[mode].append(flown(content, lostlink))
    row: dict[str, Any] = {"ua": size, "alone": round(statistics.median(bare), 2)}
    for mode, found in runs.items():
        factor = statistics.median(each["factor"] for each in found)
        ratio = statistics.median(each["factor"] / other for each, other in zip(found, bare, strict=True))
        cpu = statistics.median(each["cpu"] for each in found)
        row[mode] = {"factor": round(factor, 2), "ratio": round(ratio, 2), "cpu": round(cpu, 3)}
    return row


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--autopilot", choices=("arducopter", "standin"), default="standin")
    parser.add_argument("--sizes", type=int, nargs="+", default=[1, 2, 4, 8, 16])
    parser.add_argument("--modes", choices=MODES, nargs="+", default=["one", "many"])
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--duration", type=float, default=60.0, help="sim time of each run, s")
    parser.add_argument("--seconds", type=float, default=5.0, help="wall time of each measure alone")
    parser.add_argument("--first-slot", type=int, default=SLOT, help="where the ports of the fleet begin")
    options = parser.parse_args(arguments)
    rows = []
    for size in options.sizes:
        rows.append(measure(options, size))
        print(rows[-1], file=sys.stderr, flush=True)
    print(json.dumps(rows))
    return 0


if __name__ == "__main__":
    sys.exit(main())
