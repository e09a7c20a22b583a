"""`lostlink doctor`: what is installed, which autopilots are there, which ports are free."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import click

from bridge.fleet.autopilots.dirs import AutopilotDirs
from bridge.scenario.file import DEFAULT_SCENARIO, ScenarioError
from lostlink.cli.exits import fail
from lostlink.cli.scenario_options import px4_option, scenario_with
from lostlink.flight.shown.say import say
from lostlink.plan.machine import examine

MISSING = (
    "not found (--ardupilot-dir DIR, ARDUPILOT_HOME or PATH)",
    "not found (--px4-dir DIR, PX4_HOME or PATH)",
)


@click.command(short_help="Show what is installed, found and free.")
@click.argument("scenario", default=DEFAULT_SCENARIO)
@click.option(
    "--ardupilot-dir", type=click.Path(path_type=Path), help="Where to look for ArduPilot binaries first."
)
@px4_option
@click.option(
    "--first-slot", type=int, help="Move the ports of all UA by ten times this, as `lostlink run` does."
)
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
def doctor(
    scenario: str, ardupilot_dir: Path | None, px4_dir: Path | None, first_slot: int | None, as_json: bool
) -> None:
    """Show what is installed, which autopilots were found, and whether the ports of SCENARIO are free.

    Ends with status 1 if SCENARIO could not run here with the stand-in autopilot.

    \b
    Examples:
      lostlink doctor
      lostlink doctor my.yaml --first-slot 20 --json
    """
    try:
        chosen = scenario_with(scenario, {"ports.first_slot": first_slot})
        report = examine(chosen, AutopilotDirs(ardupilot_dir, px4_dir))
    except ScenarioError as error:
        fail(error)
    say(json.dumps(report, indent=1) if as_json else _as_text(report))
    sys.exit(0 if report["ok"] else 1)


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
    lines += [
        f"  {name:<14} {place or MISSING[name == 'px4']}" for name, place in report["autopilots"].items()
    ]
    if report["autopilots"]["px4"]:
        lines += _on_px4(report)
    lines += ["", f"Ports ({report['joined']})"]
    lines += [f"  taken: {line}" for line in report["ports_taken"]] or [
        f"  all {len(report['ports'])} are free",
        *(f"  {port}" for port in report["ports"]),
    ]
    return "\n".join(lines)


def _on_px4(report: dict[str, Any]) -> list[str]:
    """Which PX4 it is, and whether its flights repeat here."""
    reasons = [f"  px4 may not repeat here: {why}" for why in report["px4_may_not_repeat"]]
    return [
        f"  px4 version: {report['px4_version'] or 'not known, since the binary does not lie in its build'}",
        *(
            reasons
            or ["  px4 can repeat here: when its threads rest is shown, and they may be real-time threads"]
        ),
    ]
