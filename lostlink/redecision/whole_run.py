"""What was decided anew as a whole run: its directory with summary and figure, as a flight leaves it."""

from __future__ import annotations

import shutil
from contextlib import suppress
from pathlib import Path
from typing import Any

from bridge.run.directory import RunDirectory
from lostlink.flight.figure import draw_figure_of
from lostlink.flight.summary import Timing, summarise, write_summary
from lostlink.redecision.redecide import Redecision
from lostlink.redecision.rewrite import OnProgress, check_is_free, write_run


def write_whole_run(
    result: Redecision, directory: Path, on_progress: OnProgress = lambda _name, _rows: None
) -> dict[str, Any]:
    """Write ``directory``; gives its summary. Arguments and errors as of `write_run`: nothing of it stays after one."""
    check_is_free(directory)
    was_there = directory.is_dir()
    try:
        return _written(result, directory, on_progress)
    except FileExistsError:  # somebody else has put there what it names
        raise
    except BaseException:
        if was_there:
            _empty(directory)
        else:
            shutil.rmtree(directory, ignore_errors=True)
        raise


def _empty(directory: Path) -> None:
    with suppress(OSError):
        for each in directory.iterdir():
            if each.is_dir():
                shutil.rmtree(each, ignore_errors=True)
            else:
                each.unlink()


def _written(result: Redecision, directory: Path, on_progress: OnProgress) -> dict[str, Any]:
    was = RunDirectory(result.run).summary
    made = write_run(result, directory, on_progress)
    timing = Timing(was.get("sim_duration_s", 0.0), was.get("wall_duration_s", 0.0))
    ending, unfinished = was.get("ending", "interrupted"), was.get("unfinished", [])
    summary = summarise(result.scenario, made, timing, ending, unfinished, error=was.get("error"))
    summary |= {"redecided_from": str(result.run.resolve())}
    write_summary(summary, made)
    draw_figure_of(made.path, result.scenario, summary)
    return summary
