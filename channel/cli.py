"""Commands of this package; `python -m channel` and `lostlink` both mount them."""

from __future__ import annotations

import json as json_module
from collections.abc import Callable
from typing import Any

import click

from channel import presets
from channel.checks import ChannelInputError
from channel.config import RadioConfig
from channel.link_report import link_report, link_text


class BadInput(click.ClickException):
    """A mistake of the user: one line, exit code 2."""

    exit_code = 2


def radio_options(command: Callable[..., None]) -> Callable[..., None]:
    """Add --radio and --set to a command."""
    command = click.option(
        "--set",
        "settings",
        multiple=True,
        metavar="KEY=VALUE",
        help="Override a key of the radio, as in --set propagation.exponent=2.5. Repeatable.",
    )(command)
    return click.option(
        "--radio", default="moon2020", show_default=True, help="A preset's name, or a YAML file."
    )(command)


def chosen_radio(radio: str, settings: tuple[str, ...]) -> RadioConfig:
    """Return the radio that the options name.

    Raises:
        BadInput: no such radio, key or value.
    """
    try:
        return presets.load_radio(radio, presets.overrides_from_settings(settings))
    except presets.PresetError as error:
        raise BadInput(str(error)) from error


@click.command()
@radio_options
@click.option(
    "--distance",
    "distance_m",
    type=float,
    required=True,
    help="Over the ground, m; with equal heights the way itself.",
)
@click.option("--frequency-hz", type=float, help="Another carrier than the radio's.")
@click.option("--height-tx", "height_tx_m", type=float, help="Transmitting antenna above ground, m.")
@click.option("--height-rx", "height_rx_m", type=float, help="Receiving antenna above ground, m.")
@click.option("--length-bytes", type=int, help="Payload length.")
@click.option("--json", "as_json", is_flag=True, help="Machine-readable output.")
def link(
    radio: str,
    settings: tuple[str, ...],
    distance_m: float,
    length_bytes: int | None,
    as_json: bool,
    **ends: float | None,
) -> None:
    """Print the link budget at a distance, term by term, and what it comes to."""
    given: dict[str, Any] = {name: value for name, value in ends.items() if value is not None}
    try:
        report = link_report(chosen_radio(radio, settings), distance_m, length_bytes, **given)
    except ChannelInputError as error:
        raise BadInput(str(error)) from error
    click.echo(json_module.dumps(report, indent=2) if as_json else link_text(report))


@click.group()
def main() -> None:
    """Radio channel: link budgets and delivery."""


main.add_command(link)
