"""`lostlink redecide`: what another radio, or another seed, makes of the transmissions of a recorded run."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from bridge.scenario.document.settings import parse_setting
from bridge.scenario.file import with_changes
from bridge.scenario.model import Scenario
from bridge.timeouts import NEWS_PERIOD_S
from lostlink.cli.exits import fail
from lostlink.cli.exits import tell as warn
from lostlink.cli.now_and_then import NowAndThen
from lostlink.cli.run_path import RunPath
from lostlink.cli.scenario_options import setting_options
from lostlink.cli.shown_table import print_table
from lostlink.flight.exits import DISAGREES, UNEXPECTED, WELL
from lostlink.flight.shown.say import say

if TYPE_CHECKING:
    from lostlink.redecision.redecide import Redecision


@click.command(short_help="Decide a run's transmissions anew, by another radio, and compare.")
@click.argument("run", type=RunPath())
@click.option("--seed", type=int, help="Seed of all draws; the run's own unless given.")
@setting_options
@click.option(
    "--out",
    type=click.Path(path_type=Path, file_okay=False),
    metavar="DIR",
    help="Write a run directory there, with the new deliveries.",
)
@click.option("--json", "as_json", is_flag=True, help="Print JSON instead of text.")
@click.option("--quiet", is_flag=True, help="Print the result only.")
def redecide(
    run: Path,
    seed: int | None,
    radio: str | None,
    settings: tuple[str, ...],
    out: Path | None,
    as_json: bool,
    quiet: bool,
) -> None:
    """Decide every transmission of the run in directory RUN anew, without flying, and compare with what was.

    Flight and transmissions stay as recorded: what a node would have done had it heard more or less is not in
    the result, and --set takes values of radios, networks, partitions and emissions alone. Without --radio,
    --seed and --set all fates come out as they were, and the status is 1 if not; else it is 0, or 1 if the new
    fates disagree with the radio's model, or 3 if what --out wrote does not meet the scenario's expectations.
    2: RUN cannot be read, or there is no such radio.

    \b
    Examples:
      lostlink redecide runs/A --radio wifi-2.4
      lostlink redecide runs/A --seed 7 --out runs/A-seed-7
      lostlink redecide runs/A --set radio.transmit_power_dbm=17 --json | jq .links
      lostlink redecide runs/A                        the same radio and seed: the same fates, all of them
    """
    silent = quiet or as_json
    progress = NowAndThen(  # whose clock goes while modules are imported
        lambda done: f"decided {100 * done:.0f} % of the packets", silent=silent, first_s=NEWS_PERIOD_S / 2
    )
    from channel.checks import ChannelInputError
    from channel.validity import OutsideValidityError
    from lostlink.redecision.output import agrees, plain_of
    from lostlink.redecision.redecide import decide
    from lostlink.redecision.rewrite import check_is_free
    from lostlink.redecision.whole_run import write_whole_run

    try:
        if out is not None:
            check_is_free(out)  # before all is decided for nothing
        scenario = _scenario(run, radio, seed, settings)
        result = decide(run, scenario, progress)
        writing = NowAndThen("writes {}: {} rows so far".format, silent=silent)
        summary = None if out is None else write_whole_run(result, out, writing)
    except (OSError, ValueError, ChannelInputError, OutsideValidityError) as error:
        fail(error)
    for line in result.edited:
        warn(line)
    if as_json:
        written = {} if summary is None else {"directory": str(out), "digest": summary["digest"]}
        click.echo(json.dumps(plain_of(result, summary) | written))
    else:
        _tell(result, out, summary, quiet=quiet)
    differs = radio is None and seed is None and not settings and result.disagrees
    if differs or not agrees(result):
        sys.exit(DISAGREES)
    met = summary is None or all(each["passed"] for each in summary["expectations"])
    sys.exit(WELL if met else UNEXPECTED)


def _scenario(run: Path, radio: str | None, seed: int | None, settings: tuple[str, ...]) -> Scenario:
    """The run's scenario as the options change it."""
    from lostlink.reading.moved import scenario_of
    from lostlink.redecision.redecide import as_seen_from_here

    changes: dict[str, Any] = {} if seed is None else {"seed": seed}
    changes |= {} if radio is None else {"radio": as_seen_from_here(radio)}
    given = [parse_setting(text) for text in settings]
    return with_changes(scenario_of(run), changes | {each.key: each.value for each in given})


def _tell(result: Redecision, out: Path | None, summary: dict[str, Any] | None, *, quiet: bool) -> None:
    from lostlink.redecision.output import sentence, tables, verdict_on

    if not quiet:
        for table in tables(result.comparison):
            print_table(table)
        if out is not None:
            say(out)
    say(sentence(result.comparison))
    say(verdict_on(result, summary).text)
