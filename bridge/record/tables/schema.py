"""What a table of a run is: its columns, units and steps, and its files. Each table has a module beside this one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

TICK: Final = "<i8"
NUMBER: Final = "<f8"
COUNT: Final = "<i4"
FLAG: Final = "|b1"
LABEL: Final = "<i2"
"""A place in a list of names, which the table has once."""
TEXT_PREFIX: Final = "|S"
"""Text of so many bytes of UTF-8 at most: ``|S24``. What is longer is cut."""
NED: Final = ("north", "east", "down")
FRD: Final = ("forward", "right", "down")
TIME_MAX_NS: Final = 5 * 10**15
"""58 days of sim time: no run is that long (MAVLink counts milliseconds in 32 bits)."""
NUMBER_MAX: Final = 1 << 48
"""Of packets, with room for the number of a node beside it."""
COUNT_MAX: Final = (1 << 31) - 1
Columns = dict[str, NDArray[Any]]
"""Rows of a table, by column."""


class TableError(ValueError):
    """A table cannot be read; the text has the file."""


class Column(NamedTuple):
    """One column.

    Attributes:
        name: with its unit.
        dtype: in the journal, as numpy writes it; LABEL for names, TEXT_PREFIX and a length for text.
        steps_per_unit: numbers are rounded to whole steps of which one unit has so many; 0: they are kept as they are.
        comes_up: its names are not known before rows have them: a file has those of its rows alone, in their order,
            whoever met them first while the table was written.
        most: its numbers are from 0 to this one; 0: there are others.
    """

    name: str
    dtype: str
    steps_per_unit: float = 0.0
    comes_up: bool = False
    most: int = 0

    @property
    def is_text(self) -> bool:
        """Whether it has text of its own."""
        return self.dtype.startswith(TEXT_PREFIX)

    @property
    def is_name(self) -> bool:
        """Whether readers get text: names, or text of its own."""
        return self.dtype == LABEL or self.is_text


@dataclass(frozen=True)
class Table:
    """One table.

    Attributes:
        name: of its files, and among the streams of a comparison.
        columns: in their order.
        keys: columns that identify a row.
        tick: the column with the sim time that a row belongs to.
        node: the column with the node that a row belongs to.
        by_node: each node has a journal of its own, written by whoever has the node.
    """

    name: str
    columns: tuple[Column, ...]
    keys: tuple[str, ...]
    tick: str
    node: str
    by_node: bool = False

    def parquet_path(self, run: Path) -> Path:
        """Its file in the run directory ``run`` when the run is over."""
        return run / f"{self.name}.parquet"

    def journal_path(self, run: Path, node: str = "") -> Path:
        """Its file while the run goes on, or if whoever was to end it was killed; of ``node``, if each has one."""
        return run / self.name / f"{node}.journal" if self.by_node else run / f"{self.name}.journal"

    def journals(self, run: Path) -> list[Path]:
        """The journals that the run directory ``run`` has of it, in the order of their nodes."""
        if self.by_node:
            return sorted((run / self.name).glob("*.journal"), key=_by_number)
        path = self.journal_path(run)
        return [path] if path.exists() else []

    def files(self, run: Path) -> list[Path]:
        """All files that the run directory ``run`` has of it."""
        path, journals = (
            self.parquet_path(run),
            self.journals(run),
        )  # looked for first: they go when that is there
        return [*([path] if path.exists() else []), *journals]

    def is_in(self, run: Path) -> bool:
        """Whether the run directory ``run`` has anything of it."""
        return bool(self.files(run))

    def chosen(self, names: Sequence[str] | None) -> tuple[Column, ...]:
        """The columns of these names; all of them for None.

        Raises:
            TableError: there is no such column.
        """
        by_name = {column.name: column for column in self.columns}
        unknown = [name for name in names or () if name not in by_name]
        if unknown:
            raise TableError(
                f"{self.name} has no column {', '.join(unknown)}; there are {', '.join(by_name)}"
            )
        return self.columns if names is None else tuple(by_name[name] for name in names)

    @property
    def numbers(self) -> tuple[str, ...]:
        """Names of the columns of floating-point numbers."""
        return tuple(column.name for column in self.columns if column.dtype == NUMBER)

    @property
    def dtype(self) -> np.dtype[np.void]:
        """A row of the journal."""
        return np.dtype([(column.name, column.dtype) for column in self.columns])

    @property
    def labels(self) -> tuple[str, ...]:
        """Columns that hold names."""
        return tuple(column.name for column in self.columns if column.dtype == LABEL)


def _by_number(path: Path) -> tuple[int, str]:
    """Numbers by their value, before names."""
    return (int(path.stem) if path.stem.isdecimal() else 1 << 62), path.stem


def vector(name: str, unit: str, axes: Sequence[str]) -> tuple[Column, ...]:
    """A column for each axis."""
    return tuple(Column(f"{name}_{axis}{unit}", NUMBER) for axis in axes)
