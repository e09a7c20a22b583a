"""What a UA costs in memory, and how long a run takes to its first tick.

    python -m benchmarks.bench_memory [--sizes 2 20] [--rounds 5] [--autopilot standin] [--hosts auto]

Memory is the unique set size (what would be free if the process ended: private pages of /proc/PID/smaps_rollup), summed
over all processes of the run but real autopilots, while all hover. Per further UA: the largest fleet less the smallest,
over the UA that it has more. Linux only.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import psutil
import yaml

ROOT = Path(__file__).parents[1]
SLOT = 170
HOVERS_FROM_S = 12.0
"""Sim time from which memory is looked at: stand-ins are in the air."""
REAL = ("arducopter", "arduplane")
PRIVATE = re.compile(rb"^Private_(?:Clean|Dirty): +(\d+) kB$", re.MULTILINE)
SIM_TIME = re.compile(rb"sim time +([\d.]+) s")


def scenario_of(size: int, slot: int, changes: Mapping[str, Any]) -> dict[str, Any]:
    """`size` UA that hover beside each other until the run is interrupted."""
    agent = {"type": "hold", "altitude_m": 15}
    return {
        "schema": 1,
        "name": "memory",
        "description": "UA that hover.",
        "speed": "max",
        "duration_s": 3600.0,
        "origin": {"lat_deg": 40.1331, "lon_deg": -105.2404, "alt_amsl_m": 1690.0},
        "radio": "corrected",
        "ports": {"zenoh": 0, "first_slot": slot},
        "nodes": [{"id": i, "home": {"north_m": 20.0 * i}, "agent": agent} for i in range(size)],
        **changes,
    }


def unique_bytes(process: psutil.Process) -> int:
    """Memory that would be free if the process ended."""
    rollup = Path(f"/proc/{process.pid}/smaps_rollup").read_bytes()
    return 1024 * sum(int(match) for match in PRIVATE.findall(rollup))


def memory_of(pid: int) -> dict[str, int]:
    """Unique bytes of each process of a run, by pid and name; real autopilots are left out."""
    supervisor = psutil.Process(pid)
    found = {}
    for process in (supervisor, *supervisor.children(recursive=True)):
        if process.name() not in REAL:
            found[f"{process.pid} {process.name()}"] = unique_bytes(process)
    return found


def measure(content: Mapping[str, Any], hovers_from_s: float) -> tuple[float, dict[str, int]]:
    """Start a run, and interrupt it once it is in the air.

    Returns:
        Wall time from the command to the first tick, s, and the memory of its processes.
    """
    with tempfile.TemporaryDirectory() as scratch:
        file = Path(scratch) / "scenario.yaml"
        file.write_text(yaml.safe_dump(dict(content)), encoding="utf-8")
        command = [sys.executable, "-u", "-m", "lostlink.cli.main", "run", str(file), "--out", scratch]
        start_s = time.monotonic()
        with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.STDOUT) as run:
            assert run.stdout is not None
            first_tick_s, memory, said = 0.0, {}, b""
            for line in run.stdout:
                said += line
                found = SIM_TIME.search(line)
                if found is None or memory:
                    continue
                first_tick_s = first_tick_s or time.monotonic() - start_s
                if float(found[1]) >= hovers_from_s:
                    memory = memory_of(run.pid)
                    run.send_signal(signal.SIGINT)
        if not memory:
            raise RuntimeError(said.decode())
    return first_tick_s, memory


def table(rows: Sequence[Mapping[str, Any]]) -> str:
    """The rows in Markdown."""
    lines = ["| UA | processes | first tick, s | unique set size, MB |", "|---:|---:|---:|---:|"]
    lines += [
        f"| {row['ua']} | {row['processes']} | {row['first_tick_s']:.2f} | {row['unique_mb']:.0f} |"
        for row in rows
    ]
    return "\n".join(lines)


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure, print the table and one line of JSON."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--sizes", type=int, nargs="+", default=[2, 20])
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--autopilot", choices=["standin", "ardupilot"], default="standin")
    parser.add_argument("--hosts", default="auto", help="as in a scenario")
    parser.add_argument("--slot", type=int, default=SLOT, help="first slot of the ports")
    parser.add_argument("--from-sim", type=float, default=HOVERS_FROM_S, help="when memory is looked at, s")
    options = parser.parse_args(arguments)
    hosts = int(options.hosts) if options.hosts.isdigit() else options.hosts
    changes = {"autopilot": options.autopilot, "hosts": hosts}
    rows: list[dict[str, Any]] = []
    for size in options.sizes:
        rounds = [
            measure(scenario_of(size, options.slot, changes), options.from_sim) for _ in range(options.rounds)
        ]
        rows.append(
            {
                "ua": size,
                "processes": len(rounds[0][1]),
                "first_tick_s": round(statistics.median(first for first, _ in rounds), 2),
                "unique_mb": round(statistics.median(sum(memory.values()) for _, memory in rounds) / 1e6, 1),
                "unique_mb_by_process": {k: round(v / 1e6, 1) for k, v in rounds[-1][1].items()},
            }
        )
    print(table(rows))
    first, last = rows[0], rows[-1]
    more = last["ua"] - first["ua"]
    per_ua_mb = round((last["unique_mb"] - first["unique_mb"]) / more, 1) if more else None
    print(f"memory: {per_ua_mb} MB per further UA")
    print(
        json.dumps({"bench": "memory", "cores": os.cpu_count(), "per_further_ua_mb": per_ua_mb, "rows": rows})
    )


if __name__ == "__main__":
    main()
