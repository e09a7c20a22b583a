"""Commands of this package; `python -m channel` and `lostlink` both mount them."""

from __future__ import annotations

import json as json_module
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import click

from channel import presets
from channel.checks import ChannelInputError
from channel.cli import sweep as sweeps
from channel.cli.air_command import air
from channel.cli.fit_command import FitRequest, fit_options, run_fit
from channel.cli.link_report import link_report, link_text
from channel.cli.options import BadInput, chosen_radio, radio_options, writing
from channel.own.methods import OwnModelError
from channel.validity import ValidityWarning


@click.command()
@radio_options
@click.option(
    "--ground-distance", "ground_distance_m", type=float, help="Over the ground, m; at equal heights the way."
)
@click.option("--distance", "ground_distance_m", type=float, hidden=True)
@click.option("--frequency-hz", type=float, help="Another carrier than the radio's.")
@click.option("--height-tx", "height_tx_m", type=float, help="Transmitting antenna above ground, m.")
@click.option("--height-rx", "height_rx_m", type=float, help="Receiving antenna above ground, m.")
@click.option(
    "--base",
    type=click.Choice(["tx", "rx"]),
    help="Which end is the base, for uma-av and rma-av; tx if not given.",
)
@click.option("--length-bytes", type=int, help="Payload length.")
@click.option("--json", "as_json", is_flag=True, help="Machine-readable output.")
@click.option(
    "--sweep",
    nargs=2,
    metavar="KEY START:STOP:STEP",
    help="Print a CSV along a range instead: distance, frequency-hz, height-tx, height-rx, length-bytes or any key.",
)
@click.option("--plot", type=click.Path(dir_okay=False, path_type=Path), help="With --sweep: draw it, too.")
def link(
    radio: str,
    settings: tuple[str, ...],
    as_json: bool,
    sweep: tuple[str, str] | None,
    plot: Path | None,
    **ends: float | None,
) -> None:
    """Print the link budget at a distance, term by term, and what it comes to.

    The receiver lies north of the transmitter, and both are level with their noses to the north.

    \b
    Examples:
      lostlink link --radio wifi-2.4 --ground-distance 400
      lostlink link --radio corrected --ground-distance 400 --set propagation.exponent=3 --json
      lostlink link --radio wifi-2.4 --sweep distance 50:1000:10 --plot range.png
    """
    if plot is not None and sweep is None:
        raise BadInput("--plot draws along a range: it needs --sweep")
    given: dict[str, Any] = {name: value for name, value in ends.items() if value is not None}
    if "ground_distance_m" not in given and (sweep is None or sweep[0] != "distance"):
        raise BadInput("--ground-distance is missing")
    try:
        with _warnings_on_stderr():
            if sweep is None:
                report = link_report(chosen_radio(radio, settings), **given)
                click.echo(json_module.dumps(report, indent=2) if as_json else link_text(report))
            else:
                _sweep(radio, settings, sweep, given, as_json=as_json, plot=plot)
    except (ChannelInputError, OwnModelError, presets.PresetError) as error:
        raise BadInput(str(error)) from error


def _sweep(
    radio: str,
    settings: tuple[str, ...],
    along: tuple[str, str],
    ends: dict[str, Any],
    *,
    as_json: bool,
    plot: Path | None,
) -> None:
    key, text = along
    rows = sweeps.sweep(
        radio, presets.overrides_from_settings(settings), key, sweeps.sweep_values(text), ends
    )
    if as_json:
        click.echo(json_module.dumps(rows, indent=2))
    else:
        click.echo(",".join(rows[0]))
        for row in rows:
            click.echo(",".join(f"{value:.10g}" for value in row.values()))
    if plot is not None:
        from channel.cli.plots import plot_sweep

        with writing(plot):
            plot_sweep(rows, key, plot)


@contextmanager
def _warnings_on_stderr() -> Iterator[None]:
    """Say what a model warns of in one line on stderr, without a place in the code."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", ValidityWarning)
        yield
    for each in {str(warning.message) for warning in caught}:
        click.echo(f"warning: {each}", err=True)


@click.command()
@click.option("--json", "as_json", is_flag=True, help="Machine-readable output.")
def radios(as_json: bool) -> None:
    """List the radio presets: what each is, and how far it delivers 50 % and 90 % of its packets.

    Packets have the radio's nominal_payload_bytes, 40 if it says nothing else. Longer ones come less far where
    the error rate depends on the length: not with a fixed length (moon2020), a distance (disk) or a level (satellite).

    \b
    Examples:
      lostlink radios
      lostlink radios --json
    """
    rows = [sweeps.reach(presets.load_radio(name)) for name in presets.preset_names()]
    if as_json:
        table = [
            {key: None if value == float("inf") else value for key, value in row._asdict().items()}
            for row in rows
        ]
        click.echo(json_module.dumps(table, indent=2))
        return
    click.echo(f"{'radio':<17}{'50 %':>10}{'90 %':>10}  what it is")
    for row in rows:
        click.echo(
            f"{row.name:<17}{_metres(row.range_50_m):>10}{_metres(row.range_90_m):>10}  {row.description}"
        )


def _metres(distance_m: float) -> str:
    if distance_m == 0.0:
        return "never"
    return "> 100 km" if distance_m == float("inf") else f"{distance_m:.0f} m"


@click.command()
@click.option(
    "--out", type=click.Path(file_okay=False, path_type=Path), required=True, help="Directory to write to."
)
@click.option("--seed", type=int, default=1, show_default=True, help="Seed of the draws.")
def figures(out: Path, seed: int) -> None:
    """Redraw the paper's figures 5 and 6 as PNG and CSV; beside them the same for the corrected radio.

    \b
    Examples:
      lostlink figures --out figures
    """
    from channel.cli.paper_figures import write_figures

    with writing(out):
        files = write_figures(out, seed=seed)
    for file in files:
        click.echo(str(file))


@click.command()
@click.option(
    "--out", type=click.Path(file_okay=False, path_type=Path), required=True, help="Directory to write to."
)
@click.option("--seed", type=int, default=1, show_default=True, help="Seed of the random terms.")
def laws(out: Path, seed: int) -> None:
    """Draw the laws of the channel as PNG: path loss, two rays, antennas, error models, and the random terms.

    \b
    Examples:
      lostlink laws --out laws
    """
    from channel.cli.law_plots import write_law_plots
    from channel.cli.random_plots import write_random_plots

    with writing(out), _warnings_on_stderr():
        files = write_law_plots(out) + write_random_plots(out, seed)
    for file in files:
        click.echo(str(file))


@click.command()
@click.argument("log", type=click.Path(dir_okay=False, path_type=Path))
@fit_options
def fit(log: Path, **options: Any) -> None:
    """Fit a radio to a flight LOG: a CSV of distance_m (or positions), delivered, and optional rssi_dbm.

    The radio to start from needs log-distance propagation and normal, gudmundson or one-sided-normal shadowing; it
    gives the error model, powers and gains. Whether the shadowing is correlated along the track, and whether packets
    fade (Rice), is found from the log.
    Prints each parameter with its 95 % interval, or that the data do not determine it.

    \b
    Examples:
      lostlink fit flight.csv --radio corrected --out mine.yaml --plot fit.png
      lostlink fit flight.csv --radio corrected --set noise.noise_figure_db=4 --hold shadowing.sigma_db --json
    """
    from channel.fit.columns import read_log

    run_fit(FitRequest(**options), log.stem, lambda base: read_log(log, base))


@click.group()
def main() -> None:
    """Radio channel: link budgets, presets, figures and calibration."""


for _command in (link, radios, figures, laws, fit, air):
    main.add_command(_command)
