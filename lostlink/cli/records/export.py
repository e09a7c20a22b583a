"""`lostlink export`: the record of a run for other programs."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from bridge.record.provenance import version_noted
from bridge.run.directory import RunDirectory
from lostlink.cli.exits import fail, tell
from lostlink.cli.records.lost import tell_lost
from lostlink.cli.records.mcap_options import changed, mcap_options
from lostlink.cli.run_path import RunPath
from lostlink.flight.shown.say import say


@click.command(short_help="Write a run as MCAP or CSV, or the tables of a killed run as Parquet.")
@click.argument("run", type=RunPath(exists=True, file_okay=False))
@click.option("--csv", "as_csv", is_flag=True, help="Write a CSV of each table, and logged.csv.")
@click.option(
    "--parquet",
    "as_parquet",
    is_flag=True,
    help="Turn what a killed run left into Parquet, as its end would have.",
)
@click.option("--mcap", "as_mcap", is_flag=True, help="Write run.mcap, for viewers and ROS 2.")
@click.option(
    "--out", type=click.Path(path_type=Path, file_okay=False), help="Where CSV and MCAP go; RUN unless given."
)
@mcap_options
def export(run: Path, as_csv: bool, as_parquet: bool, as_mcap: bool, out: Path | None, **mcap: Any) -> None:
    """Write the record of the run in directory RUN for other programs.

    Every run that came to an end has Parquet tables and, unless its scenario says otherwise, run.mcap already. CSV and
    MCAP can be written of a run at any time, also while it goes on or after it was killed.

    \b
    Examples:
      lostlink export runs/20261121T120000Z-separation --csv
      lostlink export runs/20261121T120000Z-separation --csv --out /tmp
      lostlink export runs/KILLED --parquet --mcap
      lostlink export runs/20261121T120000Z-separation --mcap --payloads --mavlink messages --rate truth=20
    """
    if not (as_csv or as_parquet or as_mcap):
        raise click.UsageError("one of --csv, --parquet and --mcap is needed")
    if not as_mcap and any(mcap.values()):
        raise click.UsageError("--payloads, --mavlink, --compression, --rate and --size go with --mcap")
    from bridge.record.names import Kind
    from bridge.record.tables.every import TABLES, finish_tables
    from lostlink.export.csv_files import export_csv

    folder = out or run
    try:
        if as_parquet:
            if RunDirectory(run).is_live:
                raise ValueError(
                    f"{run}: this run has not ended yet; --csv and --mcap write what there is so far"
                )
            before = set(run.glob("*.parquet"))
            with version_noted(run):
                finish_tables(run)
            made = sorted(set(run.glob("*.parquet")) - before)
            say("\n".join(map(str, made)) if made else f"{run}: its tables are Parquet already")
        folder.mkdir(parents=True, exist_ok=True)
        with version_noted(run):
            if as_csv:
                for path in export_csv(run, folder):
                    say(path)
                tell_lost(run, (*(table.name for table in TABLES), Kind.LOGGED.value), "not in these files")
            if as_mcap:
                say(_write_mcap(run, folder, mcap))
    except OSError as error:
        is_clear = isinstance(error, BrokenPipeError) or error.filename is not None
        fail(error if is_clear else f"{folder}: {error}")  # a full disk has no name
    except ValueError as error:
        fail(error)


def _write_mcap(run: Path, folder: Path, options: dict[str, Any]) -> Path:
    from lostlink.export.mcap.export import MCAP_FILE, write_mcap
    from lostlink.reading.lost_parts import in_words, lost_parts

    directory, path = RunDirectory(run), folder / MCAP_FILE
    settings = changed(directory.scenario.mcap, **options)
    lost = lost_parts(run, directory.summary)
    if lost and path.exists():
        raise ValueError(
            f"{path} is there, and may have what the record has lost: {in_words(lost)}; "
            "it is not replaced: name another folder with --out"
        )
    write_mcap(run, path, settings)
    if lost:
        tell(f"warning: {path} lacks what the record has lost: {in_words(lost)}")
    return path
