"""`lostlink judge`: whether a recorded run shows what a scenario expects."""

from __future__ import annotations

import json
import sys
from dataclasses import asdict
from pathlib import Path

import click

from bridge.scenario.file import read_scenario
from lostlink.cli.exits import fail
from lostlink.cli.run_path import RunPath
from lostlink.expectations.judge import Judgement
from lostlink.expectations.judge import judge as judge_run
from lostlink.flight.exits import UNEXPECTED
from lostlink.flight.shown.say import say
from lostlink.reading.run import load_run


@click.command(short_help="See whether a recorded run shows what a scenario expects.")
@click.argument("run", type=RunPath(exists=True, file_okay=False))
@click.argument("scenario", required=False)
@click.option("--json", "as_json", is_flag=True, help="Print JSON: a list as expectations in summary.json.")
def judge(run: Path, scenario: str | None, as_json: bool) -> None:
    """Judge the run in directory RUN by the expectations of SCENARIO (a name or file), else by its own.

    A run that goes on or was killed is judged as far as its record goes. Ends with status 0 if all are met, 3 if one
    failed, 2 if RUN or SCENARIO cannot be read.

    \b
    Examples:
      lostlink judge runs/20261121T120000Z-separation
      lostlink judge runs/20261121T120000Z-separation stricter.yaml --json
    """
    try:
        judgements = _judgements(run, scenario)
    except (OSError, ValueError) as error:
        fail(error)
    if as_json:
        click.echo(json.dumps([asdict(each) for each in judgements], indent=1))
    else:
        say("\n".join(map(str, judgements)) or "the scenario expects nothing")
    sys.exit(0 if all(each.passed for each in judgements) else UNEXPECTED)


def _judgements(run: Path, scenario: str | None) -> list[Judgement]:
    recorded = load_run(run)
    flown = recorded.scenario
    expectations = flown.expectations if scenario is None else read_scenario(scenario).expectations
    missing = {
        node
        for each in expectations
        for ids in each.nodes.values()
        for node in ids
        if node not in flown.stations
    }
    if missing:
        raise ValueError(
            f"{run}: has no node {', '.join(sorted(missing))}, of which {scenario} expects something"
        )
    return judge_run(run, flown, recorded.ending, expectations)
