"""`lostlink compare`: are two runs the same, and if not, where do they begin to differ?"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import click

from bridge.cli.comparison import CompareProgress, as_plain, as_text

EXIT_DIFFERENT = 1
EXIT_UNREADABLE = 2
RUN_PATH = click.Path(path_type=Path)


@click.command(short_help="Find the first difference between two runs.")
@click.argument("run_a", type=RUN_PATH)
@click.argument("run_b", type=RUN_PATH)
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
def compare(run_a: Path, run_b: Path, as_json: bool) -> None:
    """Compare the runs in the directories RUN_A and RUN_B: true states, MAVLink, packets and deliveries.

    Prints `identical` and what was compared, or the first difference in sim time with both values. Ends with
    status 0 if the runs are identical, 1 if not, 2 if one cannot be read.

    \b
    Examples:
      lostlink compare runs/20261121T120000Z-separation runs/20261121T121500Z-separation
      lostlink compare runs/A runs/B --json | jq .difference.stream
    """
    from bridge.record.compare import examine

    try:
        comparison = examine(run_a, run_b, on_progress=CompareProgress())
    except (OSError, ValueError) as error:
        click.echo(f"lostlink: {error}", err=True)
        sys.exit(EXIT_UNREADABLE)
    click.echo(json.dumps(as_plain(comparison)) if as_json else as_text(comparison, run_a, run_b))
    sys.exit(0 if comparison.difference is None else EXIT_DIFFERENT)
