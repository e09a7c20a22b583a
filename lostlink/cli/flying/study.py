"""`lostlink study`: fly many runs, and measure them."""

from __future__ import annotations

import json
import signal
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from time import monotonic
from typing import Any

import click
from rich import box
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from bridge.fleet.autopilots.dirs import AutopilotDirs
from bridge.run.every import Every
from bridge.timeouts import LOG_PERIOD_S
from lostlink.cli.exits import tell
from lostlink.cli.scenario_options import ardupilot_option, px4_option
from lostlink.cli.shown_table import print_table
from lostlink.flight.shown.console import plain_console
from lostlink.flight.shown.say import say
from lostlink.flight.signals import ending_signals, leave_terminal
from lostlink.report.scales import plain
from lostlink.study.lanes import DASK_PATIENCE_S, DaskLanes, Lanes, LocalLanes
from lostlink.study.model import StudyError
from lostlink.study.scripted import STUDIES
from lostlink.study.settings import ALWAYS, BySetting, by_setting
from lostlink.study.study import NOT_FLOWN, Standing, Study
from lostlink.study.table import TABLE_FILE

EXIT_FAILED, EXIT_USAGE = 1, 2
COLUMNS_MAX, LINES_MAX, REASONS_MAX = 8, 40, 4


@click.command(short_help="Fly many runs: seeds, settings, scenarios; one table at the end.")
@click.argument("file", type=click.Path(path_type=Path, dir_okay=False, exists=True))
@click.option("--out", type=click.Path(path_type=Path, file_okay=False), default=STUDIES, show_default=True)
@click.option(
    "--lanes",
    type=click.IntRange(1, 64),
    help="Runs at a time on this machine. [default: one per core, at most 8]",
)
@click.option("--scheduler", metavar="ADDRESS", help="Fly on the workers of this Dask scheduler instead.")
@px4_option
@ardupilot_option
@click.option("--dry-run", is_flag=True, help="Only say which runs there are, and which are done.")
@click.option(
    "--json",
    "as_json",
    is_flag=True,
    help="Print the table's rows as JSON lines (nan as null), with --dry-run the runs, and nothing else on stdout.",
)
def study(
    file: Path,
    out: Path,
    lanes: int | None,
    scheduler: str | None,
    ardupilot_dir: Path | None,
    px4_dir: Path | None,
    dry_run: bool,
    as_json: bool,
) -> None:
    """Fly the runs of the study in FILE, and write OUT/<name>/metrics.parquet: a row per run.

    At the end it shows means over the seeds for each setting, with their standard errors; if it is interrupted, of the
    runs that are over. It goes on when it is started again: runs that are done are not flown again. Runs whose scenario
    or agent (with what it imports) changed are other runs, and so are all when lostlink did. Ends with status 0 if all
    runs came to their end and were measured and all figures were drawn, 1 if not, 2 if the study cannot be flown.

    \b
    Examples:
      lostlink study range.yaml
      lostlink study range.yaml --dry-run
      lostlink study range.yaml --lanes 4 --out ~/studies
      lostlink study range.yaml --scheduler tcp://10.0.0.1:8786
    """
    console, ours = plain_console(stderr=as_json), None
    for number in ending_signals():
        signal.signal(number, _interrupt)
    try:
        console.print(f"{file}: reads the scenario of each run", soft_wrap=True)
        ours = Study(file, out, AutopilotDirs(ardupilot_dir, px4_dir))
        earlier = ours.earlier()
        left = _tell_left(ours, earlier, console)
        if dry_run:
            _tell_plan(ours, earlier, console, as_json=as_json)
            return
        failed = 0
        if left:
            with _lanes(lanes, scheduler, console) as where:
                failed = _show(ours.fly(where), console)
        failed += _tell_results(ours, console, as_json=as_json)
    except (StudyError, OSError) as error:
        tell(error)
        sys.exit(EXIT_USAGE)
    except KeyboardInterrupt as error:
        for each in ending_signals():
            signal.signal(each, signal.SIG_DFL)  # once more, and it ends as it is
        if ours is not None:
            _tell_interrupted(ours, console, as_json=as_json)
        say("interrupted: start it again to go on", err=True)
        sys.exit(128 + (error.args[0] if error.args else signal.SIGINT))
    sys.exit(EXIT_FAILED if failed else 0)


def _tell_results(ours: Study, console: Console, *, as_json: bool) -> int:
    """Write and show what came of all runs, and draw the figures; gives how many of these failed.

    Raises:
        StudyError, OSError: the table cannot be written.
    """
    rows, failed = ours.rows(), 0
    table = ours.write(rows)
    if not as_json:
        _print_settings(ours, rows, rows)
    console.print(f"{table}", soft_wrap=True)
    _tell_not_passed(rows, console)
    for mistake in ours.draw(rows):
        tell(mistake)
        failed += 1
    if as_json:
        _print_rows(rows)
    return failed


def _tell_interrupted(ours: Study, console: Console, *, as_json: bool) -> None:
    """Show what came of the runs that are over; the table's file is not written, as it has them all."""
    rows = ours.rows()
    over = [row for row in rows if row["failure"] != NOT_FLOWN]
    if as_json:
        _print_rows(over)
    elif over:
        _print_settings(ours, over, rows)
    console.print(f"{len(over)} of {len(rows)} runs are over; {TABLE_FILE} is written when all are")


def _print_rows(rows: list[dict[str, Any]]) -> None:
    for row in rows:
        click.echo(json.dumps(plain(row)))


def _print_settings(ours: Study, rows: list[dict[str, Any]], whole: list[dict[str, Any]]) -> None:
    """A line per setting: how many of its runs passed, and what was measured, over the seeds."""
    settings = by_setting(rows, list(ours.cases[0].labels), ours.link_columns(), whole)
    names = list(settings[0].means)
    always = [name for name in names if name in ALWAYS]
    shown = [*[name for name in names if name not in ALWAYS][: COLUMNS_MAX - len(always)], *always]
    table = Table(box=box.SIMPLE_HEAD)
    for label in settings[0].labels:
        table.add_column(label, overflow="fold")
    failed = ["failed"] if any(one.failed for one in settings) else []
    for name in ("runs", "passed", *failed, *shown):
        table.add_column(name, justify="right", overflow="fold")
    for one in settings[:LINES_MAX]:
        means = [_mean_of(one, name) for name in shown]
        counts = [one.runs, one.passed, *([one.failed] if failed else [])]
        table.add_row(*map(str, one.labels.values()), *map(str, counts), *means)
    print_table(table)
    say("means over the seeds ± standard error")
    for count, what in ((len(names) - len(shown), "numbers"), (len(settings) - LINES_MAX, "settings")):
        if count > 0:
            say(f"and {count} more {what}: see {TABLE_FILE}")


def _mean_of(one: BySetting, name: str) -> str:
    """The mean, and of how many runs where not all have the number."""
    mean = one.means[name]
    return f"{mean} (n={mean.count})" if 0 < mean.count < one.runs else str(mean)


def _tell_not_passed(rows: list[dict[str, Any]], console: Console) -> None:
    failed = sum(bool(row["failure"]) for row in rows)
    not_passed = sum(not row["failure"] and not row["passed"] for row in rows)
    for count, what in (
        (failed, "failed, or could not be measured: see the column failure"),
        (not_passed, "did not pass: see the columns passed and verdict"),
    ):
        if count:
            console.print(f"{count} of {len(rows)} runs {what}", soft_wrap=True)


def _interrupt(number: int, _: Any) -> None:
    leave_terminal()
    raise KeyboardInterrupt(number)


def _lanes(lanes: int | None, scheduler: str | None, console: Console) -> Lanes:
    if scheduler is not None:
        console.print(f"joins the Dask scheduler at {scheduler}, within {DASK_PATIENCE_S} s", soft_wrap=True)
        cluster = DaskLanes(scheduler)
        count = cluster.workers
        console.print(f"workers there: {count or 'none yet; runs begin when one joins'}", soft_wrap=True)
        return cluster
    return LocalLanes(lanes)


def _tell_left(ours: Study, earlier: dict[str, str], console: Console) -> int:
    """Say how much there is to do, and why, where results do not count; gives how many runs are left."""
    left, measured = len(ours.left()), len(ours.to_measure())
    again = f", to measure again: {measured}" if measured else ""
    text = f"{ours.directory}: runs: {len(ours.cases)}, to fly: {left - measured}{again}"
    console.print(text, soft_wrap=True)
    for why, count in Counter(earlier.values()).most_common(REASONS_MAX):
        results = "1 earlier result does" if count == 1 else f"{count} earlier results do"
        console.print(f"{results} not count: {why}", soft_wrap=True)
    return left


def _tell_plan(ours: Study, earlier: dict[str, str], console: Console, *, as_json: bool) -> None:
    """Say of each run what is to be done; as JSON also why."""
    left, measured = {case.id for case in ours.left()}, ours.to_measure()
    for case in ours.cases:
        what = "measure" if case.id in measured else "to fly" if case.id in left else "done"
        if as_json:
            row = {**case.labels, "id": case.id, "standing": what, "earlier": earlier.get(case.id, "")}
            click.echo(json.dumps(plain(row)))
        else:
            console.print(f"{what:7}  {case.id}  {case.title}", soft_wrap=True)


def _show(news: Iterator[Standing], console: Console) -> int:
    """Show how far the study is; gives how many runs failed."""
    begin = monotonic()
    over, failed, ready_at, line = 0, 0, 0.0, Every(LOG_PERIOD_S)
    columns = (TextColumn("runs"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, disable=not console.is_terminal) as bar:
        task = bar.add_task("", total=None)
        for standing in news:
            failed = standing.failed
            if standing.case is not None:
                over += 1
                # a run that is only measured again takes a moment, and says nothing of flights
                left, like_them = standing.to_fly, standing.flown
                if not left:
                    left, like_them = standing.count - standing.done, over
                if like_them:
                    now = monotonic()
                    ready_at = now + (now - begin) / like_them * left
            bar.update(task, completed=standing.done, total=standing.count)
            if standing.failure and standing.case is not None:
                console.print(f"failed: {standing.case.title}: {standing.failure}", soft_wrap=True)
            elif not console.is_terminal and line.is_due():
                console.print(_line(standing, ready_at), soft_wrap=True)
    return failed


def _line(standing: Standing, ready_at: float) -> str:
    line = f"{standing.done} of {standing.count} runs"
    if not ready_at or standing.done >= standing.count:
        return line
    remaining_s = ready_at - monotonic()
    if remaining_s <= 0.0:
        return f"{line}, the next takes longer than those before"
    return f"{line}, about {remaining_s // 60:.0f} min {remaining_s % 60:.0f} s remain"
