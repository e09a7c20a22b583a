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
FLAG: Final = "|b1"
LABEL: Final = "<i2"
"""A place in a list of names, which the table has once."""
TEXT_PREFIX: Final = "|S"
"""Text of so many bytes of UTF-8 at most: ``|S24``. What is longer is cut."""
Batch = Mapping[str, NDArray[Any]]
"""Some rows of a table, by column; names as text."""


class TableError(ValueError):
    """A table cannot be read; the text has the file."""


class Column(NamedTuple):
    """One column.

    Attributes:
        name: with its unit.
        dtype: in the journal, as numpy writes it; LABEL for names, TEXT_PREFIX and a length for text.
        steps_per_unit: numbers are rounded to whole steps of which one unit has so many; 0: they are kept as they are.
    """

    name: str
    dtype: str
    steps_per_unit: float = 0.0

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
        keys: columns that tell which row it is.
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

    def is_in(self, run: Path) -> bool:
        """Whether the run directory ``run`` has anything of it."""
        return self.parquet_path(run).exists() or bool(self.journals(run))

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
MEASUREMENTS: Final = Table(
    "measurements",
    (
        Column("sim_time_ns", TICK),
        Column("node", LABEL),
        Column("emitter", LABEL),
        Column("number", TICK),
        Column("distance_m", NUMBER, 1e3),
        Column("mean_power_dbm", NUMBER, 1e3),
        Column("shadowing_db", NUMBER, 1e3),
        Column("fading_db", NUMBER, 1e3),
        Column("reading_dbm", NUMBER, 1e3),
        Column("power_dbm", NUMBER, 1e3),
        Column("outcome", LABEL),
    ),
    keys=("sim_time_ns", "node", "emitter"),
    tick="sim_time_ns",
    node="node",
)
"""A row per measurement of an RF sensor and emitter in its band; written by the radio, if a node has a sensor."""
AGES: Final = (
    *("heartbeat", "status", "attitude", "position", "local_position", "velocity"),
    *("speed", "airspeed", "wind", "current", "clock"),
)
"""Groups of fields of a state that an autopilot tells together, in the order of AircraftState.msg."""
STATES: Final = Table(
    "states",
    (
        Column("tick_ns", TICK),
        Column("node", LABEL),
        Column("mav_id", COUNT),
        *(Column(f"{name}_rad", NUMBER) for name in ("roll", "pitch", "yaw")),
        Column("longitude_deg", NUMBER),
        Column("latitude_deg", NUMBER),
        Column("altitude_amsl_m", NUMBER),
        Column("altitude_rel_m", NUMBER),
        *_vector("position", "_m", NED),
        *_vector("velocity", "_mps", NED),
        Column("indicated_airspeed_mps", NUMBER),
        Column("groundspeed_mps", NUMBER),
        Column("airspeed_mps", NUMBER),
        Column("mode", f"{TEXT_PREFIX}32"),
        Column("base_mode", f"{TEXT_PREFIX}192"),
        Column("heartbeat_age_s", NUMBER),
        Column("flight_time_s", NUMBER),
        Column("voltage_v", NUMBER),
        Column("current_a", NUMBER),
        *_vector("wind", "_mps", FRD),
        Column("throttle_percent", NUMBER),
        Column("armed", FLAG),
        Column("ready_to_arm", FLAG),
        *(Column(f"age_{name}_s", NUMBER, 1e3) for name in AGES),
    ),
    keys=("tick_ns", "node"),
    tick="tick_ns",
    node="node",
    by_node=True,
)
"""A row per node and tick at which its state is published, with the fields of `bridge.bus.messages.AircraftState`."""
TABLES: Final = (TRUTH, STATES, MEASUREMENTS, DELIVERIES)
"""In the order of cause."""
