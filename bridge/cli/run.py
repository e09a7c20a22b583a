"""`lostlink run`: fly a scenario."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any, get_args

import click
from rich.console import Console

from bridge.cli.flight import Flight
from bridge.cli.report import bins_table
from bridge.fleet.supervisor import FleetError, preflight
from bridge.run.directory import RunDirectory
from bridge.scenario.file import DEFAULT_SCENARIO, ScenarioError, read_scenario, with_changes
from fdm.exchange.settings import Coupling

EXIT_USAGE = 2


class SpeedType(click.ParamType[float | str]):
    """A real-time factor, or max."""

    name = "X|max"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Leave the range to the scenario, which knows it."""
        try:
            return value if value == "max" else float(value)
        except ValueError:
            self.fail(f"{value!r} is neither a number nor 'max'", param, ctx)


@click.command(short_help="Fly a scenario and record what its radio delivered.")
@click.argument("scenario", default=DEFAULT_SCENARIO)
@click.option("--autopilot", type=click.Choice(["standin", "ardupilot", "external"]), help="Who flies.")
@click.option(
    "--ardupilot-dir",
    type=click.Path(path_type=Path, exists=True, file_okay=False),
    help="Where real ArduPilot binaries are; else ARDUPILOT_HOME, else PATH.",
)
@click.option("--speed", type=SpeedType(), help="Real-time factor, or max: as fast as this machine can.")
@click.option(
    "--coupling",
    type=click.Choice(get_args(Coupling)),
    help="Autopilot and physics compute alternately, or at the same time: faster with few UA, servos one frame later.",
)
@click.option("--duration", type=float, metavar="SECONDS", help="Longest sim time.")
@click.option("--seed", type=int, help="Seed of all random draws: channel, wind, sensor noise, agents.")
@click.option(
    "--out",
    type=click.Path(path_type=Path, file_okay=False),
    default=Path("runs"),
    help="Where runs are kept.",
)
@click.option("--first-slot", type=int, help="Move the ports of all UA by ten times this.")
@click.option("--zenoh-port", type=int, help="TCP port of the Zenoh router; 0: any free one.")
@click.option("--api", is_flag=True, default=None, help="Serve each UA's HTTP API, from port 8760 on.")
@click.option(
    "--udp-out",
    multiple=True,
    metavar="HOST:PORT|none",
    help="Send every UA's MAVLink there, too. Repeatable. Without it 127.0.0.1:14550 and 14540 + I at --speed 1.",
)
@click.option(
    "--digest",
    is_flag=True,
    help="Print one line last: the digest of all that repeats. Not with --json, which has it under digest.",
)
@click.option(
    "--json", "as_json", is_flag=True, help="Print summary.json instead of text: nothing else is on stdout."
)
@click.option("--quiet", is_flag=True, help="Print the verdict only.")
def run(
    scenario: str,
    autopilot: str | None,
    ardupilot_dir: Path | None,
    speed: float | str | None,
    coupling: Coupling | None,
    duration: float | None,
    seed: int | None,
    out: Path,
    first_slot: int | None,
    zenoh_port: int | None,
    api: bool | None,
    udp_out: tuple[str, ...],
    digest: bool,
    as_json: bool,
    quiet: bool,
) -> None:
    """Fly SCENARIO (a shipped scenario's name, or a YAML file) and record what its radio delivered.

    Writes OUT/<time>-<scenario>/ with summary.json, deliveries.parquet, truth.parquet, a figure, the scenario as
    resolved, what happened at each tick (streams/, inputs/) and a log per process. Ends with status 0 if the measured
    deliveries agree with the channel's model (also when --duration ends the run before its tasks: summary.json names
    the unfinished ones), 1 if not or if the run broke off, 2 if it could not start.

    \b
    Examples:
      lostlink run
      lostlink run --autopilot ardupilot --ardupilot-dir ~/ardupilot
      lostlink run my.yaml --speed 1 --seed 7
      lostlink run --duration 60 --json | jq .verdict
      lostlink run --quiet --digest                  run it twice: the digest is the same
    """
    if as_json and digest:
        raise click.UsageError(
            "--digest and --json: choose one; the JSON has the digest under its key digest"
        )
    changes: dict[str, Any] = {"autopilot": autopilot, "speed": speed, "duration_s": duration, "seed": seed}
    changes["api"] = api
    changes |= {"ports.first_slot": first_slot, "ports.zenoh": zenoh_port, "fdm.coupling": coupling}
    changes["mavlink.udp_out"] = [place for place in udp_out if place != "none"] if udp_out else None
    try:
        resolved = with_changes(read_scenario(scenario), {k: v for k, v in changes.items() if v is not None})
        preflight(resolved, ardupilot_dir)
        directory = RunDirectory.create(out, resolved.name)
    except (ScenarioError, FleetError) as error:
        _fail(str(error), EXIT_USAGE)
    except OSError as error:
        _fail(f"{out}: cannot make a directory for the run there: {error}", EXIT_USAGE)
    if resolved.autopilot == "standin" and (resolved.parameters or any(ua.parameters for ua in resolved.ua)):
        click.echo("lostlink: the stand-in autopilot does not take the scenario's parameters", err=True)
    console = Console(stderr=as_json or quiet)
    flight = Flight(resolved, directory, console, quiet=as_json or quiet)
    summary = flight.fly(ardupilot_dir)
    _tell(flight, summary, as_json=as_json, quiet=quiet, digest=digest)
    sys.exit(flight.exit_status(summary))


def _fail(text: str, status: int) -> Any:
    click.echo(f"lostlink: {text}", err=True)
    sys.exit(status)


def _tell(
    flight: Flight, summary: dict[str, Any] | None, *, as_json: bool, quiet: bool, digest: bool
) -> None:
    """Print what came of the run."""
    if summary is None:
        return
    if as_json:
        click.echo(json.dumps(summary))
    elif quiet:
        click.echo(summary["verdict"])
    else:
        if summary["bins"]:
            flight.console.print(bins_table(summary))
        flight.console.print(f"{flight.directory.path}", highlight=False, soft_wrap=True)
        for reason in summary["may_not_repeat"]:
            flight.console.print(f"may not repeat: {reason}", highlight=False, soft_wrap=True)
        flight.console.print(summary["verdict"], highlight=False, soft_wrap=True, style="bold")
    if digest:
        click.echo(summary["digest"])
