"""`lostlink export`: the tables of a run for other programs."""

from __future__ import annotations

import sys
from pathlib import Path

import click

from bridge.run.directory import RunDirectory

EXIT_UNREADABLE = 2


@click.command(short_help="Write a run's tables as CSV, or those of a killed run as Parquet.")
@click.argument("run", type=click.Path(path_type=Path, exists=True, file_okay=False))
@click.option("--csv", "as_csv", is_flag=True, help="Write truth.csv and deliveries.csv.")
@click.option(
    "--parquet",
    "as_parquet",
    is_flag=True,
    help="Turn what a killed run left into Parquet, as its end would have.",
)
@click.option(
    "--out", type=click.Path(path_type=Path, file_okay=False), help="Where CSV goes; RUN unless given."
)
def export(run: Path, as_csv: bool, as_parquet: bool, out: Path | None) -> None:
    """Write the tables of the run in directory RUN: true states, and what became of each packet.

    Every run that came to an end has truth.parquet and deliveries.parquet already. CSV can be written of a run at any
    time, also while it goes on.

    \b
    Examples:
      lostlink export runs/20261121T120000Z-separation --csv
      lostlink export runs/20261121T120000Z-separation --csv --out /tmp
      lostlink export runs/KILLED --parquet
    """
    if not (as_csv or as_parquet):
        raise click.UsageError("one of --csv and --parquet is needed")
    from bridge.record.tables.export import export_csv
    from bridge.record.tables.parquet import finish_tables

    try:
        if as_parquet:
            _check_over(run)
            finish_tables(run)
        if as_csv:
            folder = out or run
            folder.mkdir(parents=True, exist_ok=True)
            for path in export_csv(run, folder):
                click.echo(path)
    except (OSError, ValueError) as error:
        click.echo(f"lostlink: {error}", err=True)
        sys.exit(EXIT_UNREADABLE)


def _check_over(run: Path) -> None:
    try:
        is_live = RunDirectory(run).info.is_live
    except (OSError, ValueError):
        return
    if is_live:
        raise ValueError(f"{run}: this run has not ended yet; --csv writes what there is so far")
