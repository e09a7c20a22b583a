"""`lostlink report`: a run as one page, and as numbers."""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

import click

from lostlink.cli.exits import fail
from lostlink.cli.exits import tell as warn
from lostlink.cli.now_and_then import NowAndThen, reporting
from lostlink.cli.run_path import RunPath
from lostlink.flight.exits import DISAGREES
from lostlink.flight.shown.say import say

REPORT_FILE = "report.html"


@click.command(short_help="Write what a run shows as one page, or as JSON.")
@click.argument("run", type=RunPath())
@click.option(
    "--out",
    type=click.Path(path_type=Path, dir_okay=False),
    metavar="FILE",
    help="The page; RUN/report.html unless given.",
)
@click.option(
    "--json", "as_json", is_flag=True, help="Print the page's numbers as JSON; with --out, write it, too."
)
def report(run: Path, out: Path | None, as_json: bool) -> None:
    """Write a page about the run in directory RUN (or of that name in runs/), finished, killed or still going on.

    The page is one file that asks for nothing: what ran, where the nodes were, delivery and power over distance, links,
    causes of loss, ages and latency, checks, events. Ends with status 0, 1 if the run's summary.json is not that of its
    record (digests and counts are computed anew), or 2 if the run cannot be read.

    \b
    Examples:
      lostlink report runs/20261121T120000Z-separation
      lostlink report runs/A --out /tmp/a.html
      lostlink report runs/A --json | jq .totals
    """
    from bridge.record.provenance import version_noted
    from lostlink.reading.edited import edited_files, presets_of_today, radio_files
    from lostlink.reading.run import load_run
    from lostlink.report.content import content_of

    tell = reporting()
    try:
        if out is not None and not out.parent.is_dir():
            raise ValueError(f"--out {out}: there is no directory {out.parent}; make it first")
        found = load_run(run)
        edited = edited_files(found.path, radio_files(found.scenario))
        for line in (*edited, *presets_of_today(found.path, found.scenario, found.scenario)):
            warn(f"{line}: the model's curve is that of today's")
        with version_noted(found.path):
            content = content_of(found, tell)
        if out is not None or not as_json:
            path = out or found.path / REPORT_FILE
            write_report(content, path, tell)
            say(path, err=as_json)
    except (OSError, ValueError) as error:
        fail(error)
    if as_json:
        click.echo(json.dumps(content, allow_nan=False))
    if mistakes := content["run"]["summary_mistakes"]:
        tell_mistakes({str(found.path): mistakes})
        sys.exit(DISAGREES)


def tell_mistakes(mistakes: Mapping[str, Sequence[str]]) -> None:
    """Say in what summaries are other than their records, by run."""
    for run, lines in mistakes.items():
        for line in lines:
            warn(f"{run}: summary.json is not that of its record: {line}")


def write_report(content: dict[str, object], path: Path, tell: NowAndThen) -> None:
    """Write the page of a report's numbers.

    Raises:
        OSError: it cannot be written.
    """
    from lostlink.report.page.page import page_of
    from lostlink.report.pictures.all import draw_all

    path.write_text(page_of(content, draw_all(content, tell)), encoding="utf-8")
