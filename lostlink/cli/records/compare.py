"""`lostlink compare`: are two runs the same, and if not, where do they begin to differ? Several runs side by side."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from lostlink.cli.exits import fail
from lostlink.cli.now_and_then import comparing, reporting
from lostlink.cli.run_path import RunPath
from lostlink.cli.shown_table import print_table
from lostlink.compare.output import as_plain, as_text
from lostlink.flight.shown.say import say

if TYPE_CHECKING:
    from rich.table import Table

EXIT_DIFFERENT = 1


@click.command(short_help="Find the first difference between two runs, or put runs side by side.")
@click.argument("runs", type=RunPath(), nargs=-1, required=True)
@click.option("--metrics", is_flag=True, help="Also put two runs side by side, or one alone.")
@click.option(
    "--html", type=click.Path(path_type=Path, dir_okay=False), help="Write the table as a page there."
)
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
def compare(runs: tuple[Path, ...], metrics: bool, html: Path | None, as_json: bool) -> None:
    """Compare the runs in the directories RUNS.

    Of two runs: true states, MAVLink, packets and deliveries. Prints `identical` and what was compared, or the first
    difference in sim time with both values, and of runs of other scenarios the table below. Ends with status 0 if the
    runs are identical, 1 if not, 2 if one cannot be read or has not ended yet.

    Of three or more, or with --metrics or --html: a table of settings that differ, verdict, delivery per link, ages
    of information, least distance of two UA, and which digests are equal. Ends with status 0, or 2 if a run cannot be
    read.

    In any case the digests and counts in each run's summary.json are computed anew from its record: the status is 1 if
    one is other than that.

    \b
    Examples:
      lostlink compare runs/20261121T120000Z-separation runs/20261121T121500Z-separation
      lostlink compare runs/A runs/B --json | jq .difference.stream
      lostlink compare runs/A runs/B runs/C --html compared.html
    """
    if len(runs) == 2 and not metrics and html is None:
        _identity(runs, as_json=as_json)
    if len(runs) == 1 and not metrics and html is None:
        raise click.UsageError("one run alone: give another one to compare it with, or --metrics")
    if _table(runs, html, as_json=as_json):
        sys.exit(EXIT_DIFFERENT)


def _identity(runs: tuple[Path, ...], *, as_json: bool) -> None:
    from bridge.run.directory import RunDirectory
    from lostlink.cli.records.report import tell_mistakes
    from lostlink.compare.compare import examine
    from lostlink.compare.made_by import others_made_by
    from lostlink.compare.summary import mistakes_in_summary

    try:
        run_a, run_b = runs
        for run in runs:
            if RunDirectory(run).is_live:
                raise ValueError(f"{run}: this run has not ended yet: what is compared would grow meanwhile")
        comparison = examine(run_a, run_b, on_progress=comparing())
        others = others_made_by(runs)
        settings = {} if comparison.difference is None else _settings(runs)
        forged = {str(run): mistakes for run in (run_a, run_b) if (mistakes := mistakes_in_summary(run))}
    except (OSError, ValueError) as error:
        fail(error)
    if as_json:
        more = {"settings": settings, "summary_mistakes": forged, "made_by": others}
        click.echo(json.dumps(as_plain(comparison) | more, allow_nan=False))
    else:
        say(as_text(comparison, run_a, run_b))
        if others:
            say("; ".join(f"{by} made {run}" for run, by in others.items()))
    tell_mistakes(forged)
    if settings and not as_json:
        say("The scenarios differ. What came of each run:")
        _table(runs, None, as_json=False, is_told=True)
    sys.exit(0 if comparison.difference is None and not forged else EXIT_DIFFERENT)


def _settings(runs: tuple[Path, ...]) -> dict[str, Any]:
    """In which settings runs differ; none if one has no scenario that can be read."""
    from lostlink.reading.run import load_run
    from lostlink.report.scales import plain
    from lostlink.report.side_by_side import settings_of

    try:
        found: dict[str, Any] = plain(settings_of([load_run(run) for run in runs]))
    except (OSError, ValueError):
        return {}
    return found


def _table(runs: tuple[Path, ...], html: Path | None, *, as_json: bool, is_told: bool = False) -> bool:
    """Show runs side by side; gives whether a summary is other than its record, and tells so unless that was done."""
    from lostlink.cli.records.report import tell_mistakes
    from lostlink.reading.run import load_run
    from lostlink.report.side_by_side import comparison_page, sameness, side_by_side

    try:
        content = side_by_side([load_run(run) for run in runs], reporting())
        if html is not None:
            html.write_text(comparison_page(content), encoding="utf-8")
    except (OSError, ValueError) as error:
        fail(error)
    forged = {each["name"]: each["summary_mistakes"] for each in content["runs"] if each["summary_mistakes"]}
    tell_mistakes({} if is_told else forged)
    if as_json:
        click.echo(json.dumps(content, allow_nan=False))
        return bool(forged)
    print_table(_rich_table(content))
    say(sameness(content))
    if html is not None:
        say(html)
    return bool(forged)


def _rich_table(content: dict[str, Any]) -> Table:
    from rich.table import Table

    from lostlink.report.side_by_side import table_of

    table = Table()
    table.add_column("")
    for run in content["runs"]:
        table.add_column(run["name"], justify="right", overflow="fold")
    for name, cells, differs in table_of(content):
        table.add_row(name, *cells, style="bold" if differs else "dim")
    return table
