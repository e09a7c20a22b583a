"""`fly_study`: a study from a script or a notebook, as `lostlink study` flies it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import nullcontext
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bridge.fleet.autopilots.dirs import AutopilotDirs
from lostlink.reading.frames import frame_of_table
from lostlink.study.lanes import Lanes, LocalLanes
from lostlink.study.study import Standing, Study
from lostlink.study.table import table_of

if TYPE_CHECKING:
    import pandas as pd

STUDIES = Path("studies")


@dataclass(frozen=True, repr=False)
class StudyResult:
    """What came of a study.

    Attributes:
        path: its directory, with the table (`metrics.parquet`) and a directory per run.
        rows: what the table has: of each run its labels, its ``id``, why it failed (``failure``, "" if it did not), and
            what was measured.
        not_drawn: a line for each of the study's figures that could not be drawn.
    """

    path: Path
    rows: list[dict[str, Any]]
    not_drawn: tuple[str, ...]

    def __repr__(self) -> str:
        """How many runs there are, and how many failed."""
        return f"<StudyResult {self.path.name}: {len(self.rows)} runs, {self.failed} failed>"

    @property
    def failed(self) -> int:
        """How many runs failed, or could not be measured."""
        return sum(bool(row["failure"]) for row in self.rows)

    @cached_property
    def table(self) -> pd.DataFrame:
        """The rows as a frame, as the file had them when the study was over."""
        return frame_of_table(table_of(self.rows))


def fly_study(
    study: str | Path | Mapping[str, Any],
    *,
    directory: str | Path | None = None,
    lanes: int | Lanes | None = None,
    tell: Callable[[Standing], object] | None = None,
    ardupilot_dir: str | Path | None = None,
    px4_dir: str | Path | None = None,
) -> StudyResult:
    """Fly the runs of a study that are left, as `lostlink study` does, and return what came of all.

    Runs that were flown before, with the same scenario, code and lostlink, are not flown again. It blocks until the
    study is over; what ends the wait, such as Ctrl-C, ends what flies, and the study goes on when it is flown again.

    Args:
        study: its YAML file, or the content of such a file as a mapping (docs/how-to/studies.md). Files that a mapping
            names are as seen from the working directory.
        directory: where directories of studies are kept; this one's has the study's name. ``studies/`` unless given.
        lanes: how many runs fly at a time on this machine; one per core, at most 8, unless given. Or where they fly:
            `LocalLanes` or `DaskLanes`, whose processes stay for the next study until they are left (``with``), which
            also ends what still flies there when an exception has ended the wait.
        tell: called after each run, and now and then in between, with how far it is: `done`, `failed` and `count` of
            runs, and `case` and `failure` of the one that is just over.
        ardupilot_dir: where real binaries are, as in `fly`.
        px4_dir: where PX4 is, likewise.

    Raises:
        StudyError: the study cannot be flown; a line per mistake.
        TypeError: lanes are neither a number of them nor what flies.
        ValueError: fewer lanes than one.
        OSError: its directory cannot be written.
    """
    dirs = AutopilotDirs(*(Path(said) if said else None for said in (ardupilot_dir, px4_dir)))
    out = STUDIES if directory is None else Path(directory)
    ours = Study(Path(study) if isinstance(study, str) else study, out, dirs)
    with nullcontext(lanes) if isinstance(lanes, Lanes) else LocalLanes(lanes) as where:
        for standing in ours.fly(where):
            if tell is not None:
                tell(standing)
    rows = ours.rows()
    ours.write(rows)
    return StudyResult(ours.directory, rows, tuple(ours.draw(rows)))
