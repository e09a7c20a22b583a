"""Does a run repeat? Flies each line of a table again and again, and compares all digests.

Each line is a scenario, flown once as the reference and then ``--repeats`` times in some way that must not matter:
under load, at another speed, with another split over processes, on other cores or ports. A line holds if every digest
of every repeat is equal, and every run came to its end.

    python -m benchmarks.repeat                       # with ARDUPILOT_HOME and PX4_HOME also the real ones
    python -m benchmarks.repeat --short --repeats 1   # a few seconds of sim time each: what the test suite runs
    python -m benchmarks.repeat --only loaded --keep runs/repeat
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

from bridge.record.ending import WHOLE
from bridge.run.px4 import find_px4
from bridge.scenario.file import SCENARIOS
from lostlink.compare.compare import compare

ROOT = Path(__file__).parents[1]
EXAMPLES = ROOT / "examples"
SHORT_S = 5.0
"""Sim time of a run in short form: boot, and the first seconds on the air."""
SILENT = {"mavlink.tlog": False, "mavlink.udp_out": [], "api": False}
TELLING = {"mavlink.tlog": True, "mavlink.udp_out": ["127.0.0.1:9"], "api": True}
"""Outputs of every kind; whether anybody listens, UDP does not mind."""
GUSTY = {"wind": "gusty", "fdm.sensor_noise": {"gyro_sigma_radps": 0.002, "accel_sigma_mps2": 0.05}}
MANY = {"processes": "many"}


@dataclass(frozen=True, slots=True)
class Line:
    """One line of the table.

    Attributes:
        name: for ``--only`` and the table.
        scenario: the file.
        base: what the reference has that the file has not, by dotted key.
        other: what the repeats have besides.
        moved: by how many slots the ports of the repeats are others.
        loaded: whether both cores are kept busy during the repeats.
        real: whether it needs real ArduPilot.
        px4: whether it needs real PX4.
    """

    name: str
    scenario: Path
    base: Mapping[str, Any] = field(default_factory=dict)
    other: Mapping[str, Any] = field(default_factory=dict)
    moved: int = 0
    loaded: bool = False
    real: bool = False
    px4: bool = False


class BrokenRun(RuntimeError):
    """A run did not come to its end: what it recorded shows nothing, however equal."""


def lines() -> list[Line]:
    """The table."""
    separation, mixed = (Path(str(SCENARIOS / f"{name}.yaml")) for name in ("separation", "mixed"))
    standin = [
        Line("standin quiet", separation),
        Line("standin loaded", separation, loaded=True),
        Line("standin many loaded", separation, MANY, loaded=True),
        Line("standin speed 1", separation, {"duration_s": 60}, {"speed": 1}),
        Line("standin workers 2", separation, {"fdm.workers": 1}, {"fdm.workers": 2}),
        Line("standin hosts 1", separation, {"hosts": "per-ua"}, {"hosts": 1}),
        Line("standin shared", separation, MANY | {"fdm.placement": "spread"}, {"fdm.placement": "shared"}),
        Line("standin ports", separation, moved=2),
        Line("standin parallel", separation, {"fdm.coupling": "parallel"}, {"fdm.workers": 2}),
        Line("standin mavlink 100 Hz", separation, {"mavlink_rate_hz": 100}, loaded=True),
        Line("standin gusty", separation, GUSTY, {"fdm.workers": 2}, loaded=True),
        Line("standin outputs", separation, SILENT, TELLING),
        Line("wander", EXAMPLES / "agents" / "wander.yaml", {}, {"hosts": 1}, loaded=True),
    ]
    copters = {"autopilot": "ardupilot"}
    real = [
        Line("copters quiet", separation, copters, real=True),
        Line("copters loaded", separation, copters, loaded=True, real=True),
        Line("copters speed 1", separation, copters | {"duration_s": 100}, {"speed": 1}, real=True),
        Line("copters parallel", separation, copters | {"fdm.coupling": "parallel"}, loaded=True, real=True),
        Line("copters outputs", separation, copters | SILENT, TELLING, real=True),
        Line("plane and copter gusty", mixed, GUSTY, loaded=True, real=True),
        Line(
            "wander copters",
            EXAMPLES / "agents" / "wander.yaml",
            copters,
            {"hosts": 1},
            loaded=True,
            real=True,
        ),
    ]
    px4 = {"autopilot": "px4"}
    fly_px4 = [
        Line("px4 quiet", separation, px4, px4=True),
        Line("px4 loaded", separation, px4, loaded=True, px4=True),
        Line("px4 speed 1", separation, px4 | {"duration_s": 60}, {"speed": 1}, px4=True),
        Line("px4 many processes", separation, px4, MANY, px4=True),
    ]
    return standin + real + fly_px4


def fly(line: Line, changes: Mapping[str, Any], out: Path, slot: int) -> tuple[Path, dict[str, Any]]:
    """Fly once; returns the run's directory and its summary.

    Raises:
        BrokenRun: the run did not come to its end.
    """
    content = yaml.safe_load(line.scenario.read_text(encoding="utf-8"))
    for key, value in {**changes, "ports.zenoh": 0, "ports.first_slot": slot}.items():
        *path, last = key.split(".")
        part = content
        for step in path:
            part = part.setdefault(step, {})
        part[last] = value
    for ua in content["nodes"]:
        if "class" in ua["agent"]:
            ua["agent"]["class"] = str(line.scenario.parent / ua["agent"]["class"])
    out.mkdir(parents=True, exist_ok=True)
    (out / "scenario.yaml").write_text(yaml.safe_dump(content), encoding="utf-8")
    command = [sys.executable, "-m", "lostlink.cli.main", "run", str(out / "scenario.yaml"), "--json"]
    done = subprocess.run(
        [*command, "--out", str(out / "runs")], capture_output=True, text=True, cwd=ROOT, check=False
    )
    if done.returncode not in (0, 1) or not done.stdout:
        raise BrokenRun(f"the run ended with status {done.returncode}: {done.stderr}")
    summary = json.loads(done.stdout)
    if summary["ending"] not in WHOLE:
        raise BrokenRun(f"the run ended as {summary['ending']!r}: {summary['error']}")
    (directory,) = (out / "runs").iterdir()
    return directory, summary


@contextlib.contextmanager
def load(wanted: bool) -> Iterator[None]:
    """Two busy processes per core, if wanted."""
    count = 2 * (os.cpu_count() or 1) if wanted else 0
    busy = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(count)]
    try:
        yield
    finally:
        for process in busy:
            process.kill()
            process.wait()


def check(line: Line, repeats: int, short: bool, out: Path, slot: int) -> dict[str, Any]:
    """Fly a line; returns its row of the table."""
    base = dict(line.base)
    if short:
        base["duration_s"] = SHORT_S
    row: dict[str, Any] = {
        "line": line.name,
        "sim_s": 0.0,
        "streams": 0,
        "real_time_factors": [],
        "identical": 0,
        "repeats": repeats,
        "remarks": [],
    }
    try:
        reference, summary = fly(line, base, out / "reference", slot)
    except BrokenRun as error:
        row["remarks"].append(f"reference: {error}")
        return row
    row["sim_s"], row["streams"] = summary["sim_duration_s"], len(summary["digests"])
    row["real_time_factors"].append(round(summary["real_time_factor"], 2))
    row["remarks"] += summary["may_not_repeat"]
    for number in range(repeats):
        try:
            with load(line.loaded):
                directory, again = fly(
                    line, base | dict(line.other), out / f"repeat-{number}", slot + line.moved
                )
        except BrokenRun as error:
            row["remarks"].append(f"repeat {number}: {error}")
            continue
        row["real_time_factors"].append(round(again["real_time_factor"], 2))
        row["remarks"] += again["may_not_repeat"]
        if again["digests"] == summary["digests"]:
            row["identical"] += 1
        else:
            row["remarks"].append(f"repeat {number}: {compare(reference, directory)}")
    return row


def table(rows: Sequence[Mapping[str, Any]]) -> str:
    """The table as text."""
    head = f"{'line':<26}{'sim s':>8}{'streams':>9}{'identical':>11}   real-time factors"
    return "\n".join(
        [head]
        + [
            f"{r['line']:<26}{r['sim_s']:>8.1f}{r['streams']:>9}{r['identical']:>6} of {r['repeats']}   "
            + " ".join(map(str, r["real_time_factors"]))
            + "".join(f"\n    {remark}" for remark in dict.fromkeys(r["remarks"]))
            for r in rows
        ]
    )


def main(arguments: Sequence[str]) -> int:
    """Fly the table; status 0 if all of it holds."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--repeats", type=int, default=5, help="per line, besides the reference")
    parser.add_argument("--short", action="store_true", help=f"{SHORT_S:g} s of sim time per run")
    parser.add_argument("--only", default="", help="lines with this in their name")
    parser.add_argument("--slot", type=int, default=40, help="first slot of the ports")
    parser.add_argument("--keep", type=Path, help="keep the runs here")
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args(arguments)
    have_real, have_px4 = "ARDUPILOT_HOME" in os.environ, find_px4(os.environ) is not None
    chosen = [
        line
        for line in lines()
        if options.only in line.name and (have_real or not line.real) and (have_px4 or not line.px4)
    ]
    with tempfile.TemporaryDirectory() as scratch:
        out = options.keep or Path(scratch)
        rows = []
        for line in chosen:
            rows.append(
                check(line, options.repeats, options.short, out / line.name.replace(" ", "-"), options.slot)
            )
            print(table(rows[-1:]).split("\n", 1)[1], file=sys.stderr, flush=True)
    print(json.dumps(rows) if options.json else table(rows))
    if not have_real:
        print("without real ArduPilot: ARDUPILOT_HOME is not set", file=sys.stderr)
    if not have_px4:
        print("without real PX4: neither PX4_HOME nor PATH leads to one", file=sys.stderr)
    return 0 if all(row["identical"] == row["repeats"] for row in rows) else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
