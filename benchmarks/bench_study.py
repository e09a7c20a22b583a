"""How fast a study of the localisation mission is: sim time per CPU time of all processes, with start and record.

    python -m benchmarks.bench_study [--rounds 3] [--seeds 2] [--json]

Settings are flown alternately, each as a study of its own, one run at a time; medians. A factor of 6 means six seconds
of sim time for each second of a core, whatever the number of lanes.
"""

from __future__ import annotations

import argparse
import json
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import yaml

from benchmarks.record.bench_recording import cpu_s

STUDY = Path(__file__).parents[1] / "examples" / "localise" / "study.yaml"
WHOLE = {"hosts": "auto", "mcap.write": True, "mavlink.tlog": True}
"""What `lostlink run` has and a study leaves out."""


def settings() -> dict[str, dict[str, Any]]:
    """What is compared: the study as it is shipped, and with less and less of what makes it fast."""
    shipped: dict[str, Any] = yaml.safe_load(STUDY.read_text(encoding="utf-8"))["set"]
    frames = {key: value for key, value in shipped.items() if key != "tick_rate_hz"}
    return {
        "as shipped": shipped,
        "ticks by default": frames,
        "ticks and frames by default": {},
        "and hosts and files of a lone run": WHOLE,
    }


def flown(changes: Mapping[str, Any], seeds: int, duration_s: float | None) -> dict[str, float]:
    """One study: sim time over CPU time and over wall time."""
    content: dict[str, Any] = yaml.safe_load(STUDY.read_text(encoding="utf-8"))
    content["scenario"] = str((STUDY.parent / content["scenario"]).resolve())
    content["metrics"] = (
        [str(STUDY.parent / text) for text in content["metrics"]] if duration_s is None else []
    )
    content |= {"cases": {"perfect": content["cases"]["perfect"]}, "figures": []}
    content |= {"seeds": {"first": 1, "count": seeds}, "set": dict(changes), "keep": "none"}
    if duration_s is not None:
        content["set"]["duration_s"] = duration_s
    with tempfile.TemporaryDirectory() as scratch:
        file = Path(scratch) / "study.yaml"
        file.write_text(yaml.safe_dump(content), encoding="utf-8")
        command = [
            sys.executable,
            "-m",
            "lostlink",
            "study",
            str(file),
            "--out",
            scratch,
            "--lanes",
            "1",
        ]
        before_s, begin_s = cpu_s(), time.perf_counter()
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        wall_s, spent_s = time.perf_counter() - begin_s, cpu_s() - before_s
        if done.returncode:
            raise RuntimeError(f"{done.stdout}{done.stderr}")
        table = pq.read_table(Path(scratch) / "localise" / "metrics.parquet")
    sim_s = float(sum(table["sim_duration_s"].to_pylist()))
    return {"per_cpu": sim_s / spent_s, "per_wall": sim_s / wall_s, "cpu_s": spent_s / seeds}


def main(arguments: Sequence[str]) -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--seeds", type=int, default=2, help="runs of each study")
    parser.add_argument("--duration", type=float, help="sim time of each run, s; else to its end")
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args(arguments)
    rounds = [
        {name: flown(each, options.seeds, options.duration) for name, each in settings().items()}
        for _ in range(options.rounds)
    ]
    rows = {
        name: {
            key: round(statistics.median(each[name][key] for each in rounds), 2) for key in rounds[0][name]
        }
        for name in rounds[0]
    }
    if options.json:
        print(json.dumps(rows))
        return 0
    for name, row in rows.items():
        print(
            f"{name:<28} {row['per_cpu']:5.2f} times real time per core, {row['cpu_s']:5.1f} s of CPU time per run, "
            f"{row['per_wall']:5.2f} times real time by the wall clock"
        )
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
