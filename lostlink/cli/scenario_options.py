"""Options of commands that take a scenario: values in place of its own."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeVar

import click

from bridge.scenario.document.settings import Setting, parse_setting
from bridge.scenario.file import read_scenario
from bridge.scenario.model import Scenario

F = TypeVar("F", bound=Callable[..., Any])
OPTIONS = {
    "autopilot": "--autopilot",
    "speed": "--speed",
    "fdm.coupling": "--coupling",
    "duration_s": "--duration",
    "seed": "--seed",
    "radio": "--radio",
    "ports.first_slot": "--first-slot",
    "ports.zenoh": "--zenoh-port",
    "processes": "--processes",
    "zenoh": "--zenoh",
    "api": "--api",
    "mcap.write": "--mcap",
    "figure": "--figure",
    "mavlink.udp_out": "--udp-out",
}
"""By the key of the scenario that each changes."""


def _autopilot_dir(option: str, says: str) -> Callable[[F], F]:
    return click.option(
        option, type=click.Path(path_type=Path, exists=True, file_okay=False, resolve_path=True), help=says
    )


px4_option = _autopilot_dir(
    "--px4-dir", "Where a real PX4 is (its checkout or build folder); else PX4_HOME, else PATH."
)
ardupilot_option = _autopilot_dir(
    "--ardupilot-dir", "Where real ArduPilot binaries are; else ARDUPILOT_HOME, else PATH."
)


def setting_options(command: F) -> F:
    """Add ``--radio`` and ``--set`` to a command, as ``radio`` and ``settings``."""
    radio = click.option(
        "--radio", metavar="NAME|FILE", help="Radio of all nodes that have none of their own."
    )
    set_ = click.option(
        "--set",
        "settings",
        multiple=True,
        metavar="KEY=VALUE",
        help="Any value of the scenario, as radio.noise.noise_figure_db=6 or nodes.1.home.north_m=100 (nodes by id, * "
        "for all). Repeatable; later ones win, also over other options.",
    )
    return radio(set_(command))


def scenario_with(scenario: str, changes: Mapping[str, Any], settings: tuple[str, ...] = ()) -> Scenario:
    """The scenario of a name or file, as options change it.

    Args:
        scenario: name or file.
        changes: values by key of `OPTIONS`; None = not given.
        settings: texts of ``--set``.

    Raises:
        ScenarioError: it cannot be used; mistakes of an option are reported under its name.
    """
    folder = Path.cwd()
    given = [
        Setting(key, value, _as_typed(OPTIONS[key], value), folder)
        for key, value in changes.items()
        if value is not None
    ]
    return read_scenario(scenario, [*given, *(parse_setting(text, folder=folder) for text in settings)])


def _as_typed(option: str, value: object) -> str:
    if isinstance(value, bool):
        return option if value else option.replace("--", "--no-", 1)
    return f"{option} {' '.join(map(str, value)) if isinstance(value, list) else value}"
