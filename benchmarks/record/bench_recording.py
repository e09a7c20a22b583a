"""What recording everything costs whole runs, and how large a record is.

Alternately flown: with the whole record (streams, tables, .tlog, and run.mcap with payloads), and with none (writers
replaced by functions that do nothing). Fleets of stand-ins that fly legs; medians of the ratios of pairs: of speed in
flight, of speed with the end of the record, and of sim time per CPU time of all processes, start and end included.

    python -m benchmarks.record.bench_recording [--ua 2 8 16] [--duration 60] [--rounds 3] [--json]
    python -m benchmarks.record.bench_recording --size [--ua 16] [--duration 625]  a million receptions, in MB by part
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from time import monotonic
from typing import Any

import yaml

from bridge.run.directory import RunDirectory
from bridge.scenario.file import parse_scenario
from lostlink.flight.flight import Flight, Watcher

ROOT = Path(__file__).parents[2]
SLOT = 140
SILENCED = """\
import bridge.record.streams, bridge.record.tables.journal
bridge.record.streams.StreamWriter.write = lambda *_: None
for name in ("append", "append_row"):
    setattr(bridge.record.tables.journal.TableWriter, name, lambda *_, **__: None)
"""
"""For every process of a run, as sitecustomize.py."""
LEGS = {"altitude_m": 30, "legs": 100, "radius_m": 600, "speed_mps": 15, "leg_s": 20}
AGENT = """\
from examples.agents.wander import Wander


class Flier(Wander):
    async def beacon(self):
        pass

    def on_tick(self, sim_time_ns):
        if sim_time_ns % 1_000_000_000 == 0:
            self.log("position_m", self.ua.state.position_ned_m.xyz if self.ua.state else [])
"""


class Watch(Watcher):
    """Notes when the flight is over and its end begins."""

    over_s = 0.0

    def on_phase(self, phase: str) -> None:
        if phase.startswith("ends"):
            self.over_s = monotonic()


def fly(
    ua: int, duration_s: float, folder: Path, *, is_recorded: bool, slot: int, every_ticks: int = 1
) -> dict[str, Any]:
    """One run: its real-time factor in flight, and with the end of its record."""
    (folder / "flier.py").write_text(AGENT)
    agent = {"type": "own", "class": "flier.py:Flier", "options": LEGS}
    content = {
        "schema": 1,
        "name": f"record{ua}",
        "speed": "max",
        "duration_s": duration_s,
        "origin": {"lat_deg": 40.1331, "lon_deg": -105.2404, "alt_amsl_m": 1690.0},
        "radio": "corrected",
        "transmit": {"every_ticks": every_ticks},
        "ports": {"zenoh": 0, "first_slot": slot},
        "mavlink": {"tlog": is_recorded},
        "mcap": {"write": is_recorded, "payloads": is_recorded and every_ticks == 1},
        "nodes": [{"id": i, "home": {"north_m": 10 * i}, "agent": agent} for i in range(ua)],
    }
    scenario = parse_scenario(yaml.safe_dump(content), "benchmark", folder)
    directory, watch = RunDirectory.create(folder, scenario.name), Watch()
    before_s = cpu_s()
    summary = Flight(scenario, directory, watch).fly(takes_signals=False)
    spent_s = cpu_s() - before_s
    end_s = monotonic() - watch.over_s
    if summary["error"] is not None:
        raise RuntimeError(summary["error"])
    sim_s, wall_s = summary["sim_duration_s"], summary["wall_duration_s"]
    return {
        "path": directory.path,
        "flight": sim_s / wall_s,
        "whole": sim_s / (wall_s + end_s),
        "cpu": sim_s / spent_s,
        "receptions": sum(link["sent"] for link in summary["links"]),
    }


def cpu_s() -> float:
    """CPU time of this process and of those that it has waited for: other programs beside it change it little."""
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system


@contextmanager
def silenced(folder: Path, *, is_silent: bool) -> Iterator[None]:
    """Processes started within write no record, if so."""
    before = os.environ.get("PYTHONPATH", "")
    hook = folder / "hook"
    hook.mkdir(exist_ok=True)
    (hook / "sitecustomize.py").write_text(SILENCED)
    os.environ["PYTHONPATH"] = os.pathsep.join(
        [*([str(hook)] if is_silent else []), str(ROOT), before]
    ).rstrip(":")
    try:
        yield
    finally:
        os.environ["PYTHONPATH"] = before


def measure(ua: int, duration_s: float, rounds: int, slot: int) -> dict[str, Any]:
    """Ratios of speed, recorded to not; 1 is free."""
    ratios: dict[str, list[float]] = {"flight": [], "whole": [], "cpu": []}
    speeds: list[float] = []
    for number in range(rounds):
        found = {}
        for is_recorded in (True, False) if number % 2 else (False, True):
            with tempfile.TemporaryDirectory() as text, silenced(Path(text), is_silent=not is_recorded):
                found[is_recorded] = fly(ua, duration_s, Path(text), is_recorded=is_recorded, slot=slot)
        speeds.append(found[True]["flight"])
        for name, values in ratios.items():
            values.append(found[True][name] / found[False][name])
    medians = {name: round(statistics.median(values), 3) for name, values in ratios.items()}
    return {"ua": ua, "real_time_factor": round(statistics.median(speeds), 1), **medians, "all": ratios}


def sizes(ua: int, duration_s: float, slot: int) -> dict[str, float]:
    """MB of each part of a record in which everybody transmits at every third tick."""
    with tempfile.TemporaryDirectory() as text, silenced(Path(text), is_silent=False):
        run = fly(ua, duration_s, Path(text), is_recorded=True, slot=slot, every_ticks=3)
        parts: dict[str, float] = {}
        for file in sorted(run["path"].rglob("*")):
            if file.is_file():
                part = file.relative_to(run["path"]).parts
                name = "/".join(part[:2]) if part[0] == "streams" else part[0]
                parts[name] = parts.get(name, 0.0) + file.stat().st_size / 1e6
    whole = sum(parts.values())
    shown = {name: round(size, 2) for name, size in parts.items() if size > 0.1}
    return {"receptions": run["receptions"], **shown, "all": round(whole, 1)}


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--ua", type=int, nargs="+")
    parser.add_argument("--duration", type=float, help="sim time, s")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--size", action="store_true")
    parser.add_argument("--first-slot", type=int, default=SLOT, help="where the ports of the fleet begin")
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args(arguments)
    for ua in options.ua or ([16] if options.size else [2, 8, 16]):
        if options.size:
            row: dict[str, Any] = sizes(ua, options.duration or 625.0, options.first_slot)
        else:
            row = measure(ua, options.duration or 60.0, options.rounds, options.first_slot)
        if options.json:
            print(json.dumps(row), flush=True)
        else:
            print(", ".join(f"{name} {value}" for name, value in row.items()), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
