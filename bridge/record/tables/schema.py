"""The tables of a run: their columns, units and steps; docs/run-output.md says what each means."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

TICK: Final = "<i8"
NUMBER: Final = "<f8"
COUNT: Final = "<i4"
LABEL: Final = "<i2"
"""A place in a list of names, which the table has once."""
Batch = Mapping[str, NDArray[Any]]
"""Some rows of a table, by column; names as text."""


class TableError(ValueError):
    """A table cannot be read; the text has the file."""


class Column(NamedTuple):
    """One column.

    Attributes:
        name: with its unit.
        dtype: in the journal, as numpy writes it; LABEL for names.
        steps_per_unit: numbers are rounded to whole steps of which one unit has so many; 0: they are kept as they are.
    """

    name: str
    dtype: str
    steps_per_unit: float = 0.0


@dataclass(frozen=True)
class Table:
    """One table.

    Attributes:
        name: of its files, and among the streams of a comparison.
        columns: in their order.
        keys: columns that tell which row it is.
        tick: the column with the sim time that a row belongs to.
        node: the column with the node that a row belongs to.
    """

    name: str
    columns: tuple[Column, ...]
    keys: tuple[str, ...]
    tick: str
    node: str

    def parquet_path(self, run: Path) -> Path:
        """Its file in the run directory ``run`` when the run is over."""
        return run / f"{self.name}.parquet"

    def journal_path(self, run: Path) -> Path:
        """Its file while the run goes on, or if whoever was to end it was killed."""
        return run / f"{self.name}.journal"

    def is_in(self, run: Path) -> bool:
        """Whether the run directory ``run`` has anything of it."""
        return self.parquet_path(run).exists() or self.journal_path(run).exists()

    @property
    def dtype(self) -> np.dtype[np.void]:
        """A row of the journal."""
        return np.dtype([(column.name, column.dtype) for column in self.columns])

    @property
    def labels(self) -> tuple[str, ...]:
        """Columns that hold names."""
        return tuple(column.name for column in self.columns if column.dtype == LABEL)


def _vector(name: str, unit: str, axes: tuple[str, ...]) -> tuple[Column, ...]:
    return tuple(Column(f"{name}_{axis}{unit}", NUMBER) for axis in axes)


DELIVERIES: Final = Table(
    "deliveries",
    (
        Column("sim_time_ns", TICK),
        Column("tx", LABEL),
        Column("rx", LABEL),
        Column("seq", TICK),
        Column("packets", COUNT),
        Column("length_bytes", COUNT),
        Column("distance_m", NUMBER, 1e3),
        Column("received_power_dbm", NUMBER, 1e3),
        Column("snr_db", NUMBER, 1e3),
        Column("per", NUMBER, 1e7),
        Column("fate", LABEL),
    ),
    keys=("sim_time_ns", "tx", "rx", "seq"),
    tick="sim_time_ns",
    node="tx",
)
"""A row per packet and intended receiver; written by the radio."""
NED: Final = ("north", "east", "down")
FRD: Final = ("forward", "right", "down")
TRUTH: Final = Table(
    "truth",
    (
        Column("tick_ns", TICK),
        Column("node", LABEL),
        Column("sim_time_ns", TICK),
        Column("longitude_deg", NUMBER),
        Column("latitude_deg", NUMBER),
        Column("altitude_amsl_m", NUMBER),
        *_vector("position", "_m", NED),
        *_vector("velocity", "_mps", NED),
        *_vector("attitude", "", ("w", "x", "y", "z")),
        *_vector("body_rate", "_radps", FRD),
        *_vector("specific_force", "_mps2", FRD),
        Column("airspeed_mps", NUMBER),
        *_vector("wind", "_mps", NED),
    ),
    keys=("tick_ns", "node"),
    tick="tick_ns",
    node="node",
)
"""A row per tick and node, with the fields of `bridge.bus.messages.Truth`; written by physics."""
TABLES: Final = (TRUTH, DELIVERIES)
"""In the order of cause."""
