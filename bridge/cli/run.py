"""`lostlink run`: fly a scenario."""

from __future__ import annotations

import asyncio
import json
import signal
import sys
from pathlib import Path
from time import monotonic
from typing import Any, get_args

import click
from rich.console import Console

from bridge.bus.messages import Clock, Message
from bridge.cli.progress import Progress
from bridge.cli.report import (
    FIGURE_FILE,
    UNJUDGED,
    Timing,
    bins_table,
    draw_probability_of_delivery,
    summarise,
    write_summary,
)
from bridge.fleet.supervisor import Ending, Fleet, FleetError, Observer, preflight
from bridge.run.directory import RunDirectory
from bridge.scenario.file import DEFAULT_SCENARIO, ScenarioError, read_scenario, with_changes
from bridge.scenario.model import Scenario
from bridge.scenario.resolve_radio import radio_of
from fdm.exchange.settings import Coupling

EXIT_FAILED = 1
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
    help="Autopilot and physics compute in turns, or at the same time: faster with few UA, servos one frame later.",
)
@click.option("--duration", type=float, metavar="SECONDS", help="Longest sim time.")
@click.option("--seed", type=int, help="Another seed draws other packet losses.")
@click.option(
    "--out",
    type=click.Path(path_type=Path, file_okay=False),
    default=Path("runs"),
    help="Where runs are kept.",
)
@click.option("--first-slot", type=int, help="Move the ports of all UA by ten times this.")
@click.option("--zenoh-port", type=int, help="TCP port of the Zenoh router; 0: any free one.")
@click.option("--json", "as_json", is_flag=True, help="Print summary.json instead of text.")
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
    as_json: bool,
    quiet: bool,
) -> None:
    """Fly SCENARIO (a shipped scenario's name, or a YAML file) and record what its radio delivered.

    Writes OUT/<time>-<scenario>/ with summary.json, deliveries.csv, a figure, the scenario as resolved and a log
    per process. Ends with status 0 if the measured deliveries agree with the channel's model (also when
    --duration ends the run before its tasks: summary.json names the unfinished ones), 1 if not or if the run
    broke off, 2 if it could not start.

    \b
    Examples:
      lostlink run
      lostlink run --autopilot ardupilot --ardupilot-dir ~/ardupilot
      lostlink run my.yaml --speed 1 --seed 7
      lostlink run --duration 60 --json | jq .verdict
    """
    changes = {"autopilot": autopilot, "speed": speed, "duration_s": duration, "seed": seed}
    changes |= {"ports.first_slot": first_slot, "ports.zenoh": zenoh_port, "fdm.coupling": coupling}
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
    sys.exit(_Run(resolved, directory, console, as_json=as_json, quiet=quiet).go(ardupilot_dir))


def _fail(text: str, status: int) -> Any:
    click.echo(f"lostlink: {text}", err=True)
    sys.exit(status)


class _Run:
    """One run, from the first process to the verdict."""

    def __init__(
        self, scenario: Scenario, directory: RunDirectory, console: Console, *, as_json: bool, quiet: bool
    ) -> None:
        self.scenario = scenario
        self.directory = directory
        self.console = console
        self.as_json = as_json
        self.quiet = quiet
        self.signal: signal.Signals | None = None
        self._first_tick: float | None = None
        self._last_tick = 0.0
        self._unfinished: list[str] = []
        self._error: str | None = None

    def go(self, ardupilot_dir: Path | None) -> int:
        """Fly and report; returns the exit status."""
        silent = self.quiet or self.as_json
        if not silent:
            self.console.print(f"run {self.directory.path}", highlight=False, soft_wrap=True)
        try:
            with Progress(self.console, quiet=silent) as progress:
                ending, sim_time_ns = asyncio.run(self._fly(progress, ardupilot_dir))
            for number in (signal.SIGINT, signal.SIGTERM):
                signal.signal(number, lambda n, _: sys.exit(128 + n))
            return self._report(ending, sim_time_ns)
        except (OSError, ValueError) as error:
            click.echo(f"lostlink: {error}", err=True)
            return EXIT_FAILED if self.signal is None else 128 + self.signal

    async def _fly(self, progress: Progress, ardupilot_dir: Path | None) -> tuple[Ending, int]:
        def on_message(message: Message) -> None:
            if isinstance(message, Clock):
                self._last_tick = monotonic()
                self._first_tick = self._first_tick or self._last_tick
            progress.on_message(message)

        fleet = Fleet(self.scenario, self.directory, Observer(progress.on_phase, on_message), ardupilot_dir)

        def interrupt(number: signal.Signals) -> None:
            self.signal = number
            fleet.interrupt()

        for number in (signal.SIGINT, signal.SIGTERM):
            asyncio.get_running_loop().add_signal_handler(number, interrupt, number)
        try:
            ending = await fleet.fly()
        except FleetError as error:
            ending = self._break_off(str(error))
        for name in fleet.killed:
            text = f"{name} did not end in time and was killed; its log is {self.directory.log_path(name)}"
            if name == "router":
                ending = self._break_off(f"{text}; without its last part the record is not complete")
            else:
                click.echo(f"lostlink: {text}", err=True)
        self._unfinished = sorted(fleet.not_done)
        return ending, fleet.sim_time_ns

    def _break_off(self, error: str) -> Ending:
        """Tell what ended the run; the first such error is its cause."""
        click.echo(f"lostlink: {error}", err=True)
        self._error = self._error or error
        return Ending.FAILED

    def _report(self, ending: Ending, sim_time_ns: int) -> int:
        interrupted = 128 + self.signal if self.signal is not None else 0
        wall_s = self._last_tick - self._first_tick if self._first_tick is not None else 0.0
        timing = Timing(sim_time_ns / 1e9, wall_s)
        summary = summarise(
            self.scenario, self.directory, timing, ending.value, self._unfinished, error=self._error
        )
        write_summary(summary, self.directory)
        if ending not in UNJUDGED:
            radio = radio_of(self.scenario)
            draw_probability_of_delivery(summary, radio, self.directory.path / FIGURE_FILE)
        if self.as_json:
            click.echo(json.dumps(summary))
        elif self.quiet:
            click.echo(summary["verdict"])
        else:
            if summary["bins"]:
                self.console.print(bins_table(summary))
            self.console.print(f"{self.directory.path}", highlight=False, soft_wrap=True)
            self.console.print(summary["verdict"], highlight=False, soft_wrap=True, style="bold")
        if interrupted:
            return interrupted
        failed = ending is Ending.FAILED or summary["verdict"].startswith("fail")
        return EXIT_FAILED if failed else 0
