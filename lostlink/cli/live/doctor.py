"""`lostlink doctor`: what is installed, which autopilots are there, which ports are free."""

from __future__ import annotations

import json
import os
import platform
import sys
from importlib import metadata
from pathlib import Path
from typing import Any

import click

from bridge.fleet.autopilots.ardupilot import BINARIES, ArduPilot
from bridge.fleet.autopilots.launcher import AutopilotError
from bridge.fleet.how import in_words
from bridge.fleet.ports import conflicts, ports_of
from bridge.scenario.file import DEFAULT_SCENARIO, ScenarioError
from lostlink.cli.exits import fail
from lostlink.cli.scenario_options import scenario_with

PACKAGES = (
    "lostlink",
    "eclipse-zenoh",
    "jsbsim",
    "pymavlink",
    "numpy",
    "scipy",
    "pyarrow",
    "pydantic",
    "matplotlib",
)


@click.command(short_help="Show what is installed, found and free.")
@click.argument("scenario", default=DEFAULT_SCENARIO)
@click.option(
    "--ardupilot-dir", type=click.Path(path_type=Path), help="Where to look for ArduPilot binaries first."
)
@click.option(
    "--first-slot", type=int, help="Move the ports of all UA by ten times this, as `lostlink run` does."
)
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
def doctor(scenario: str, ardupilot_dir: Path | None, first_slot: int | None, as_json: bool) -> None:
    """Show what is installed, which autopilots were found, and whether the ports of SCENARIO are free.

    Ends with status 1 if SCENARIO could not run here with the stand-in autopilot.

    \b
    Examples:
      lostlink doctor
      lostlink doctor my.yaml --first-slot 20 --json
    """
    try:
        report = examine(scenario, ardupilot_dir, first_slot)
    except ScenarioError as error:
        fail(error)
    click.echo(json.dumps(report, indent=1) if as_json else _as_text(report))
    sys.exit(0 if report["ok"] else 1)


def examine(scenario: str, ardupilot_dir: Path | None, first_slot: int | None = None) -> dict[str, Any]:
    """What `doctor` tells, in plain types.

    Args:
        scenario: whose ports to look at.
        ardupilot_dir: where to look for binaries first.
        first_slot: in place of the scenario's own.

    Raises:
        ScenarioError: if the scenario cannot be used.
    """
    packages = {name: _version(name) for name in PACKAGES}
    resolved = scenario_with(scenario, {"ports.first_slot": first_slot})
    uses = list(ports_of(resolved))
    taken = conflicts(uses)
    return {
        "python": platform.python_version(),
        "platform": platform.platform(),
        "cpu_count": os.cpu_count(),
        "packages": packages,
        "autopilots": {"standin": "ships with lostlink", **_binaries(ardupilot_dir)},
        "joined": in_words(resolved),
        "ports": [f"{use}" for use in uses],
        "ports_taken": taken,
        "ok": not taken and None not in packages.values(),
    }


def _version(package: str) -> str | None:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return None


def _binaries(ardupilot_dir: Path | None) -> dict[str, str | None]:
    launcher = ArduPilot(os.environ, ardupilot_dir)
    found: dict[str, str | None] = {}
    for name in BINARIES.values():
        try:
            found[name] = str(launcher.binary(name))
        except AutopilotError:
            found[name] = None
    return found


def _as_text(report: dict[str, Any]) -> str:
    lines = [
        f"Python {report['python']} on {report['platform']}, {report['cpu_count']} cores",
        "",
        "Packages",
    ]
    lines += [
        f"  {name:<14} {version or 'MISSING: run make demo'}" for name, version in report["packages"].items()
    ]
    lines += ["", "Autopilots"]
    missing = "not found (--ardupilot-dir DIR, ARDUPILOT_HOME or PATH)"
    lines += [f"  {name:<14} {place or missing}" for name, place in report["autopilots"].items()]
    lines += ["", f"Ports ({report['joined']})"]
    lines += [f"  taken: {line}" for line in report["ports_taken"]] or [
        f"  all {len(report['ports'])} are free",
        *(f"  {port}" for port in report["ports"]),
    ]
    return "\n".join(lines)
