"""`lostlink refly`: fly a recorded run again, and see whether it comes out the same."""

from __future__ import annotations

import json
import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

import click

from bridge.fleet.autopilots.dirs import AutopilotDirs
from bridge.fleet.course import FleetError
from bridge.fleet.preflight.preflight import preflight
from bridge.run.directory import RunDirectory
from lostlink.cli.exits import fail, tell
from lostlink.cli.now_and_then import comparing
from lostlink.cli.number_or_word import SPEED
from lostlink.cli.ports import FirstSlot, at_ports, first_slot_option, slot_asked
from lostlink.cli.run_path import RunPath
from lostlink.cli.scenario_options import px4_option
from lostlink.flight.exits import DISAGREES, WELL
from lostlink.flight.shown.say import say
from lostlink.flight.signals import signals_held

if TYPE_CHECKING:
    from lostlink.refly.reflight import Fly, Reflight, ReflightPlan

EXIT_INTERRUPTED = 130


@click.command(short_help="Fly a recorded run again and compare.")
@click.argument("run", type=RunPath())
@click.option(
    "--out",
    type=click.Path(path_type=Path, file_okay=False),
    default=Path("runs"),
    help="Where runs are kept.",
)
@px4_option
@click.option(
    "--ardupilot-dir",
    type=click.Path(path_type=Path, exists=True, file_okay=False),
    help="Where real ArduPilot binaries are; else where RUN's were, else ARDUPILOT_HOME, else PATH.",
)
@click.option(
    "--code",
    type=click.Path(path_type=Path, exists=True, file_okay=False),
    metavar="FOLDER",
    help="Below which folder agents' files, winds and airframes of RUN lie now, if they are no more where they were.",
)
@click.option(
    "--speed",
    type=SPEED,
    default="max",
    show_default=True,
    help="Real-time factor, or max: as fast as this machine can. The result does not depend on it.",
)
@click.option(
    "--processes",
    type=click.Choice(["auto", "one", "many"]),
    help="How the parts are joined; else as in RUN. The result does not depend on it.",
)
@first_slot_option
@click.option("--zenoh-port", type=int, help="TCP port of the Zenoh router; 0: any free one.")
@click.option("--json", "as_json", is_flag=True, help="Print JSON instead of text.")
@click.option("--quiet", is_flag=True, help="Print the result only.")
def refly(
    run: Path,
    out: Path,
    ardupilot_dir: Path | None,
    px4_dir: Path | None,
    code: Path | None,
    speed: float | str,
    processes: str | None,
    first_slot: FirstSlot,
    zenoh_port: int | None,
    as_json: bool,
    quiet: bool,
) -> None:
    """Fly the scenario of the run in directory RUN again, with the inputs that it recorded, and compare the two.

    RUN/inputs/ has what a ground station or an operator sent, and when; edit a copy of RUN to see what another
    input would have done. A run that was interrupted is flown up to its last whole tick. The new run goes to
    OUT/<time>-<scenario>/. Ends with status 0 if the two are identical, 1 if they or their endings differ (one broke
    off and the other did not, say), 2 if RUN cannot be flown.

    \b
    Examples:
      lostlink refly runs/20261121T120000Z-separation
      lostlink refly runs/A --ardupilot-dir ~/ardupilot --first-slot 20 --zenoh-port 0
      lostlink refly runs/A --json | jq .difference
      lostlink refly unzipped/runs/A --code unzipped
    """
    from lostlink.refly.reflight import Interrupted, fly_again, plan

    changes = {
        "speed": speed,
        "processes": processes,
        "ports.first_slot": slot_asked(first_slot),
        "ports.zenoh": zenoh_port,
    }
    silent, dirs = quiet or as_json, AutopilotDirs(ardupilot_dir, px4_dir)
    try:
        planned = plan(run, {k: v for k, v in changes.items() if v is not None}, code)
        with at_ports(planned.scenario, first_slot, repeats=True) as placed:
            planned = replace(planned, scenario=placed)
            preflight(placed, dirs.or_else(planned.dirs))
            with signals_held():  # until the flight takes them: none leaves a directory without a summary
                directory = RunDirectory.create(out, placed.name)
                _tell_before(planned, directory, silent=silent)
                outcome = fly_again(
                    planned,
                    directory,
                    _flight(),
                    dirs=dirs,
                    quiet=silent,
                    on_progress=None if silent else comparing(),
                )
    except Interrupted:
        fail(f"interrupted; nothing was compared; the new run is {directory.path}", EXIT_INTERRUPTED)
    except (ValueError, OSError, FleetError) as error:
        fail(error)
    _report(planned, outcome, as_json=as_json)


def _flight() -> Fly:
    from lostlink.cli.shown_flight import fly

    return fly


def _tell_before(planned: ReflightPlan, directory: RunDirectory, *, silent: bool) -> None:
    for remark in planned.remarks:
        tell(remark)
    if not silent:
        say(f"flies {planned.run} again{planned.extent_told}, into {directory.path}")


def _report(planned: ReflightPlan, outcome: Reflight, *, as_json: bool) -> NoReturn:
    from lostlink.refly.output import as_plain, as_text

    for remark in outcome.remarks:
        tell(remark)
    say(json.dumps(as_plain(planned, outcome)) if as_json else as_text(planned, outcome))
    sys.exit(DISAGREES if outcome.is_different else WELL)
