"""`lostlink run`: fly a scenario."""

from __future__ import annotations

import json
import sys
from collections.abc import AsyncIterator
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any, get_args

import click

from bridge.fleet.autopilots.dirs import AutopilotDirs
from bridge.fleet.course import FleetError
from bridge.fleet.preflight.preflight import preflight
from bridge.run.directory import RunDirectory
from bridge.scenario.file import DEFAULT_SCENARIO, ScenarioError
from bridge.scenario.model import Scenario
from bridge.scenario.nodes import AutopilotName
from fdm.exchange.settings import Coupling
from lostlink.cli.exits import fail, tell
from lostlink.cli.number_or_word import SPEED
from lostlink.cli.ports import at_ports, first_slot_option, slot_asked
from lostlink.cli.scenario_options import (
    OPTIONS,
    ardupilot_option,
    px4_option,
    scenario_with,
    setting_options,
)
from lostlink.cli.shown_flight import ShownFlight
from lostlink.flight.shown.bins_table import bins_tables
from lostlink.flight.shown.console import plain_console
from lostlink.flight.shown.say import say
from lostlink.flight.signals import signals_held
from lostlink.flight.summary import expectation_lines
from lostlink.plan.untaken import untaken
from lostlink.view.beside import PORT, NoView, ViewProcess


@click.command(short_help="Fly a scenario and record what its radio delivered.")
@click.argument("scenario", default=DEFAULT_SCENARIO)
@click.option("--autopilot", type=click.Choice(get_args(AutopilotName)), help="Who flies.")
@ardupilot_option
@px4_option
@click.option("--speed", type=SPEED, help="Real-time factor, or max: as fast as this machine can.")
@click.option(
    "--coupling",
    type=click.Choice(get_args(Coupling)),
    help="Autopilot and physics compute alternately, or at the same time: faster with few UA, servos one frame later.",
)
@click.option("--duration", type=float, metavar="SECONDS", help="Longest sim time.")
@click.option("--seed", type=int, help="Seed of all random draws: channel, wind, sensor noise, agents.")
@setting_options
@click.option(
    "--out",
    type=click.Path(path_type=Path, file_okay=False),
    default=Path("runs"),
    help="Where runs are kept.",
)
@first_slot_option
@click.option("--zenoh-port", type=int, help="TCP port of the Zenoh router; 0: any free one.")
@click.option(
    "--zenoh/--no-zenoh",
    default=None,
    help="Whether programs beside the run may join it; they may at any speed but max.",
)
@click.option(
    "--processes",
    type=click.Choice(["auto", "one", "many"]),
    help="All parts in one process, or joined by Zenoh in many; no result depends on it.",
)
@click.option("--api", is_flag=True, default=None, help="Serve each UA's HTTP API, from port 8760 on.")
@click.option(
    "--mcap/--no-mcap",
    default=None,
    help="Whether to write run.mcap at the end; it does by default.",
)
@click.option(
    "--figure/--no-figure",
    default=None,
    help="Whether to draw the probability of delivery at the end; it is by default.",
)
@click.option(
    "--udp-out",
    multiple=True,
    metavar="HOST:PORT|none",
    help="Send every UA's MAVLink there, too. Repeatable. Without it 127.0.0.1:14550 and 14540 + I at --speed 1.",
)
@click.option(
    "--view", is_flag=True, help=f"Serve a page that shows the run, on port {PORT} of this machine."
)
@click.option("--control", is_flag=True, help="With --view: viewers may command aircraft.")
@click.option(
    "--view-port", type=click.IntRange(0, 65535), default=PORT, show_default=True, help="0: any free one."
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
    ardupilot_dir: Path | None,
    px4_dir: Path | None,
    settings: tuple[str, ...],
    out: Path,
    view: bool,
    control: bool,
    view_port: int,
    digest: bool,
    as_json: bool,
    quiet: bool,
    **asked: Any,
) -> None:
    """Fly SCENARIO (a shipped scenario's name, or a YAML file) and record what its radio delivered.

    Writes OUT/<time>-<scenario>/ with summary.json, deliveries.parquet, truth.parquet, a figure, the scenario as
    resolved, what happened at each tick (streams/, inputs/) and a log per process.

    \b
    Ends with status
      0  the measured deliveries agree with the channel's model, and all expectations of the scenario are met
         (also when --duration ends the run before its tasks: summary.json names the unfinished ones)
      1  they disagree with the model, or the run broke off
      2  it could not start
      3  they agree with the model, but an expectation of the scenario failed
      128 + signal if it was interrupted (141: nobody read what it prints any more)

    \b
    Examples:
      lostlink run
      lostlink run --autopilot ardupilot --ardupilot-dir ~/ardupilot
      lostlink run my.yaml --speed 1 --seed 7
      lostlink run --radio wifi-2.4 --set nodes.1.home.north_m=100 --set radio.base_loss=0.1
      lostlink run --duration 60 --json | jq .verdict
      lostlink run --speed 1 --view
      lostlink run --quiet --digest                  run it twice: the digest is the same
    """
    dirs = AutopilotDirs(ardupilot_dir, px4_dir)
    _check(as_json=as_json, digest=digest, control=control, view=view, zenoh=asked["zenoh"])
    with ExitStack() as beside, ExitStack() as ports:
        try:
            resolved = scenario_with(scenario, _changes(view=view, **asked), settings)
            viewing = ViewProcess(view_port, control=control) if view else None
            placed = ports.enter_context(at_ports(resolved, asked["first_slot"]))
            flight = _flight(placed, dirs, out, quiet=as_json or quiet)
        except (ScenarioError, FleetError, NoView) as error:
            fail(error)
        except OSError as error:
            fail(f"{out}: cannot make a directory for the run there: {error}")
        if viewing is not None:
            beside.enter_context(viewing).start(flight.directory)
            failures = viewing.failures(flight.directory, lambda: flight.is_flying)
            flight.view = _announced(viewing.address, failures, err=as_json or quiet)
        summary = flight.fly_and_tell(dirs)
        ports.close()
        _tell(flight, summary, as_json=as_json, quiet=quiet, digest=digest)
        if viewing is not None and flight.signal is None:
            _keep(viewing, flight.directory)
    sys.exit(flight.exit_status(summary))


async def _announced(address: str, failures: AsyncIterator[str], *, err: bool) -> AsyncIterator[str]:
    """What goes wrong with a view; its address is printed once it serves."""
    async for failure in failures:
        if not failure:
            say(f"view: {address}", err=err)
        yield failure


def _flight(scenario: Scenario, dirs: AutopilotDirs, out: Path, *, quiet: bool) -> ShownFlight:
    """A flight that has all it needs, and its directory, which no signal leaves without a summary."""
    preflight(scenario, dirs)
    for line in untaken(scenario):
        tell(line)
    with signals_held():
        directory = RunDirectory.create(out, scenario.name)
        return ShownFlight(scenario, directory, plain_console(stderr=quiet), quiet=quiet)


def _check(*, as_json: bool, digest: bool, control: bool, view: bool, zenoh: bool | None) -> None:
    if as_json and digest:
        raise click.UsageError(
            "--digest and --json: choose one; the JSON has the digest under its key digest"
        )
    if view and zenoh is False:
        raise click.UsageError("--view looks at the run over Zenoh: leave out --no-zenoh")
    if control and not view:
        raise click.UsageError("--control is what viewers may do: it needs --view")


def _changes(*, view: bool, udp_out: tuple[str, ...], **asked: Any) -> dict[str, Any]:
    """What the options of the scenario ask for, by its keys; None where nothing is asked for."""
    places = [place for place in udp_out if place != "none"] if udp_out else None
    given = asked | {
        "udp_out": places,
        "zenoh": True if view else asked["zenoh"],
        "first_slot": slot_asked(asked["first_slot"]),
    }
    return {key: given[option.removeprefix("--").replace("-", "_")] for key, option in OPTIONS.items()}


def _keep(viewing: ViewProcess, run: RunDirectory) -> None:
    """Let the view go on after the run, as long as somebody looks."""
    if viewing.is_open:
        with suppress(SystemExit):  # a signal ends the view: the run was over
            say("the view stays as long as somebody looks; Ctrl-C ends it", err=True)
            viewing.wait()
    elif failure := viewing.failure(run):
        tell(failure)


def _tell(
    flight: ShownFlight, summary: dict[str, Any] | None, *, as_json: bool, quiet: bool, digest: bool
) -> None:
    """Print what came of the run."""
    if summary is None:
        return
    if as_json:
        click.echo(json.dumps(summary))
    elif quiet:
        say(summary["verdict"])
    else:
        for table in bins_tables(summary):
            flight.console.print(table)
        for line in expectation_lines(summary):
            style = "red" if line.startswith("FAILED") else ""
            flight.console.print(line, soft_wrap=True, style=style)
        flight.console.print(f"{flight.directory.path}", soft_wrap=True)
        for warning in summary["warnings"]:
            line = f"warning: {warning}"
            flight.console.print(line, soft_wrap=True, style="yellow")
        for reason in summary["may_not_repeat"]:
            flight.console.print(f"may not repeat: {reason}", soft_wrap=True)
        flight.console.print(summary["verdict"], soft_wrap=True, style="bold")
    if digest:
        say(summary["digest"])
