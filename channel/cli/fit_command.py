"""The command `fit`, but for how the log is read: `lostlink fit` reads logs of autopilots, too."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import asdict, dataclass
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from channel import presets
from channel.checks import ChannelInputError
from channel.cli.options import BadInput, base_radio_options, chosen_radio, writing
from channel.config import RadioConfig

if TYPE_CHECKING:
    from channel.fit.flight_log import FlightLog
    from channel.fit.result import Fit, Goodness

NO_RADIO = (
    "--radio is missing: the radio to start from gives the error model, powers, gains and the kind of shadowing; "
    "`--radio corrected` (uncoded QPSK) if nothing is known, `lostlink radios` lists all"
)
STRONG = 0.9
"""Correlation of two estimates from which the text says so."""


@dataclass(frozen=True, slots=True)
class FitRequest:
    """The options of `fit` but for the log."""

    radio: str | None
    settings: tuple[str, ...]
    hold: tuple[str, ...]
    out: Path | None
    plot: Path | None
    as_json: bool


def fit_options(command: Callable[..., None]) -> Callable[..., None]:
    """Add what every `fit` takes to a command."""
    for option in (
        click.option("--json", "as_json", is_flag=True, help="Machine-readable output."),
        click.option(
            "--plot", type=click.Path(dir_okay=False, path_type=Path), help="Draw the data over the model."
        ),
        click.option(
            "--out", type=click.Path(dir_okay=False, path_type=Path), help="Write the fitted radio as YAML."
        ),
        click.option(
            "--hold", multiple=True, metavar="KEY", help="A parameter that is known: the radio's. Repeatable."
        ),
        base_radio_options,
    ):
        command = option(command)
    return command


def run_fit(request: FitRequest, name: str, read: Callable[[RadioConfig], FlightLog]) -> None:
    """Fit, write and print.

    Args:
        request: the options.
        name: of the fitted radio, if no file is written.
        read: returns the log, given the radio to start from.

    Raises:
        BadInput: a log, an option or a file that cannot be.
    """
    from channel.fit import calibration, flight_log

    if request.radio is None:
        raise BadInput(NO_RADIO)
    base = chosen_radio(request.radio, request.settings)
    try:
        data = read(base)
        found = calibration.fit_radio(data, base, request.hold)
    except (flight_log.FlightLogError, calibration.NotEnoughInformationError, ChannelInputError) as error:
        raise BadInput(str(error)) from error
    fitted = calibration.fitted_radio(found, base, name if request.out is None else request.out.stem)
    if request.out is not None:
        with writing(request.out):
            request.out.write_text(presets.radio_to_yaml(fitted), encoding="utf-8")
    if request.plot is not None:
        from channel.cli.plots import plot_fit

        with writing(request.plot):
            plot_fit(data, fitted, request.plot)
    click.echo(json.dumps(_report(found), indent=2) if request.as_json else _text(found))


def _report(found: Fit) -> dict[str, Any]:
    return {
        "packets": found.packets,
        "delivered": found.delivered,
        "log_likelihood": found.log_likelihood,
        "rssi_error_db": found.rssi_error_db,
        "correlated": found.correlated,
        "estimates": [_finite(asdict(each)) for each in found.estimates],
        "level": found.level and _finite(asdict(found.level)),
        "correlations": found.correlations,
        "goodness": found.goodness and asdict(found.goodness),
        "radio": dict(found.overrides),
    }


def _finite(values: dict[str, Any]) -> dict[str, Any]:
    """Return the values with None for what is infinite, which JSON has not."""
    return {key: None if value in (float("inf"), float("-inf")) else value for key, value in values.items()}


def _text(found: Fit) -> str:
    rows = [f"{found.packets} packets, {found.delivered} delivered", f"{'':<28}{'value':>12}   95 % interval"]
    level = found.level
    if level is not None:
        name = f"dBm at {level.distance_m:.4g} m"
        interval = f"{level.low_dbm:.4g} .. {level.high_dbm:.4g}"
        note = "" if isfinite(level.high_dbm - level.low_dbm) else "the fitted radio's"
        rows.append(f"{name:<28}{level.value_dbm:>12.4g}   {interval}  {note}".rstrip())
    for each in found.estimates:
        value = "-" if each.value is None else f"{each.value:.4g}"
        rows.append(f"{each.name:<28}{value:>12}   {each.low:.4g} .. {each.high:.4g}  {each.note}".rstrip())
    goodness = [] if found.goodness is None else _goodness(found.goodness, correlated=found.correlated)
    return "\n".join([*rows, *_strong_correlations(found), *goodness])


def _strong_correlations(found: Fit) -> list[str]:
    """Return a line for each pair of estimates that can hardly be separated."""
    table = found.correlations or {}
    names = list(table)
    pairs = [(one, other) for i, one in enumerate(names) for other in names[:i]]
    return [
        f"{other} and {one} go together: correlation {table[one][other]:.2f}"
        for one, other in pairs
        if abs(table[one][other]) >= STRONG
    ]


def _goodness(goodness: Goodness, *, correlated: bool) -> list[str]:
    """Return what the log says of the model: chances below a hundredth say that it does not hold."""
    first = goodness.independent_at_first
    if goodness.independence is None and not correlated:
        return [
            f"packets depend on each other (chance of independence {first:.2g}); shadowing taken as independent",
            "chance that the fitted radio is as far off: not known, its tests hold for independent packets",
        ]
    kind = "correlated along the track" if correlated else "independent from packet to packet"
    chances = {
        "independence": goodness.independence,
        "readings": goodness.readings,
        "deliveries": goodness.deliveries,
    }
    said = [f"{name} {chance:.2g}" for name, chance in chances.items() if chance is not None]
    return [
        f"shadowing taken as {kind} (chance of independence {first:.2g})",
        f"chance that the fitted radio is as far off: {', '.join(said) or 'not known'}",
    ]
