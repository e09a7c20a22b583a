"""`lostlink check`: what a scenario says, and what a run of it would be, without running it."""

from __future__ import annotations

import json
from dataclasses import asdict

import click

from bridge.scenario.file import DEFAULT_SCENARIO, ScenarioError
from channel.own.methods import OwnModelError
from channel.preset_errors import PresetError
from fdm.errors import AirframeError
from lostlink.cli.exits import fail
from lostlink.cli.scenario_options import scenario_with, setting_options
from lostlink.flight.shown.say import say
from lostlink.plan.flight_models import load_flight_models
from lostlink.plan.output import lines_of
from lostlink.plan.plan import plan_of


@click.command(short_help="Check a scenario and print the plan of its run.")
@click.argument("scenario", default=DEFAULT_SCENARIO)
@setting_options
@click.option("--json", "as_json", is_flag=True, help="Print the plan as JSON.")
def check(scenario: str, radio: str | None, settings: tuple[str, ...], as_json: bool) -> None:
    """Check SCENARIO (a shipped scenario's name, or a YAML file) and print the plan of its run.

    The plan has nodes, when radios are off, processes and how they are joined, ports, the radio with its range, the
    load that the agents offer to it, and what the run does not model. Airframes of your own are loaded; nothing is
    started. Ends with status 0 if the scenario is right, also with warnings, 2 if not.

    \b
    Examples:
      lostlink check my.yaml
      lostlink check my.yaml --radio telemetry-915 --set nodes.1.home.north_m=2000
      lostlink check my.yaml --json | jq .load.airtime_share
    """
    try:
        checked = scenario_with(scenario, {"radio": radio}, settings)
        load_flight_models(checked)
        plan = plan_of(checked)
    except (ScenarioError, AirframeError, PresetError, OwnModelError) as error:
        fail(error)
    say(json.dumps(asdict(plan), indent=1) if as_json else "\n".join(lines_of(plan)))
