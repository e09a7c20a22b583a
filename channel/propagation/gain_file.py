"""Maps of mean path gain from files: NetCDF (classic or NetCDF-4) and CSV.

A map has transmitters at places, and for each of them either a grid of receivers (height by north by east), or a gain
to each of a list of receivers. Places are metres north and east of the run's origin and above its ground.
"""

from __future__ import annotations

import csv
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from channel.checks import FloatArray
from channel.csv_rows import rows_with_headings
from sitl_configs.netcdf import NetcdfError, is_netcdf, read_netcdf

AXES = ("north_m", "east_m", "height_m")
GRID = ("rx_height_m", "rx_north_m", "rx_east_m")
READ = frozenset({*(f"{end}_{axis}" for end in ("tx", "rx") for axis in AXES), "gain_db"})
"""The variables that are read: others may hold anything."""
BROKEN = (ValueError, TypeError, LookupError, ArithmeticError, MemoryError)
"""What comes of numbers that are none."""


class GainFileError(ValueError):
    """A map that cannot be read: the message names file and what is wrong."""


@dataclass(frozen=True, slots=True)
class GainTable:
    """A map.

    Attributes:
        tx_m: places of the transmitters, shape (transmitters, 3): north, east, height.
        grid: rising heights, norths and easts of a grid of receivers; None if they are a list.
        rx_m: places of a list of receivers, shape (receivers, 3); of no use with a grid.
        gain_db: shape (transmitters, heights, norths, easts) or (transmitters, receivers); NaN where there is no path.
        frequency_hz: that it was made for, if the file says so.
    """

    tx_m: FloatArray
    grid: tuple[FloatArray, FloatArray, FloatArray] | None
    rx_m: FloatArray
    gain_db: FloatArray
    frequency_hz: float | None


def read_gain_file(file: Path) -> GainTable:
    """Return the map of a file; kept until the file changes, so that every radio of a run shares one.

    Raises:
        GainFileError: it cannot be read, or is no map.
    """
    try:
        return _read(file, file.stat().st_mtime_ns)
    except GainFileError:
        raise
    except OSError as error:
        raise GainFileError(f"cannot read {file}: {error.strerror or error}") from error
    except BROKEN as error:
        raise GainFileError(f"{file}: not a NetCDF file, or a broken one: {error}") from error


@lru_cache(maxsize=8)
def _read(file: Path, _changed_ns: int) -> GainTable:
    return _from_columns(file, *_columns(file)) if is_netcdf(file) else _from_rows(file)


def _columns(file: Path) -> tuple[dict[str, FloatArray], Any]:
    try:
        contents = read_netcdf(file, READ)
    except NetcdfError as error:
        raise GainFileError(str(error)) from None
    columns = {name: _unpacked(each.values, each.attributes) for name, each in contents.variables.items()}
    return columns, contents.attributes.get("frequency_hz")


def _unpacked(values: Any, attributes: Mapping[str, Any]) -> FloatArray:
    """Return numbers as they are meant, NaN where there is none (CF conventions, sec. 2.5.1 and 8.1)."""
    numbers = np.array(values, dtype=np.float64)
    for name in ("_FillValue", "missing_value"):
        if name in attributes:
            declared = np.asarray(attributes[name], dtype=np.float64)
            if values.dtype.kind == "f":  # in single precision no number is -99.9 as a double has it
                with np.errstate(over="ignore"):
                    declared = declared.astype(values.dtype)
            numbers[np.isin(numbers, declared)] = np.nan
    scale, offset = (
        float(np.ravel(attributes.get(*each))[0]) for each in (("scale_factor", 1.0), ("add_offset", 0.0))
    )
    return numbers * scale + offset


def _from_columns(file: Path, columns: Mapping[str, FloatArray], frequency: Any) -> GainTable:
    def column(name: str) -> FloatArray:
        if name not in columns:
            raise GainFileError(f"{file}: no variable {name}; it has {', '.join(sorted(columns))}")
        return np.atleast_1d(columns[name])

    tx_m = np.stack([column(f"tx_{axis}") for axis in AXES], axis=-1)
    gain_db = np.where(np.isfinite(column("gain_db")), column("gain_db"), np.nan)
    frequency_hz = None if frequency is None else float(np.ravel(frequency)[0])
    if frequency_hz is not None and not 0.0 < frequency_hz < np.inf:
        raise GainFileError(f"{file}: frequency_hz = {frequency_hz:g}: has to be above 0")
    if gain_db.ndim == 2:
        rx_m = np.stack([column(f"rx_{axis}") for axis in AXES], axis=-1)
        return _checked(file, GainTable(tx_m, None, rx_m, gain_db, frequency_hz))
    height, north, east = (column(name) for name in GRID)
    grid = height, north, east
    return _checked(file, GainTable(tx_m, grid, np.empty((0, 3)), gain_db, frequency_hz))


def _from_rows(file: Path) -> GainTable:
    """Read a CSV with a heading: places of both ends and gain_db; a list, or a full grid for each transmitter."""
    names = (*(f"tx_{axis}" for axis in AXES), *(f"rx_{axis}" for axis in AXES), "gain_db")
    try:
        with file.open(encoding="utf-8-sig", newline="") as lines:
            headings, read = rows_with_headings(lines, names)
            if missing := [name for name in names if name not in headings]:
                raise GainFileError(f"{file}: no column {missing[0]!r}; it needs {', '.join(names)}")
            rows = [[float(row[name] or "") for name in names] for _, row in read]
    except GainFileError:
        raise
    except (ValueError, csv.Error) as error:
        raise GainFileError(f"{file}: not a CSV of numbers: {error}") from error
    if not rows:
        raise GainFileError(f"{file}: no rows")
    data = np.asarray(rows)
    tx_m, tx = np.unique(data[:, :3], axis=0, return_inverse=True)
    rx_m, rx = np.unique(data[:, 3:6], axis=0, return_inverse=True)
    tx, rx = np.ravel(tx), np.ravel(rx)
    gain_db = np.full((len(tx_m), len(rx_m)), np.nan)
    if len(np.unique(tx * len(rx_m) + rx)) != len(data) or gain_db.size != len(data):
        raise GainFileError(f"{file}: has to have each pair of a transmitter and a receiver, once")
    gain_db[tx, rx] = np.where(np.isfinite(data[:, 6]), data[:, 6], np.nan)
    north, east, height = (np.unique(rx_m[:, k]) for k in range(3))
    if len(rx_m) != len(north) * len(east) * len(height) or min(len(north), len(east)) < 2:
        return _checked(file, GainTable(tx_m, None, rx_m, gain_db, None))
    order = np.lexsort((rx_m[:, 1], rx_m[:, 0], rx_m[:, 2]))
    shape = len(tx_m), len(height), len(north), len(east)
    return _checked(
        file, GainTable(tx_m, (height, north, east), rx_m, gain_db[:, order].reshape(shape), None)
    )


def _checked(file: Path, table: GainTable) -> GainTable:
    shape: tuple[int, ...] = (len(table.tx_m), len(table.rx_m))
    if table.grid is not None:
        shape = (len(table.tx_m), *(len(axis) for axis in table.grid))
        for name, axis in zip(GRID, table.grid, strict=True):
            if not np.all(np.isfinite(axis)):
                raise GainFileError(f"{file}: {name} is not finite")
            if not np.all(np.diff(axis) > 0.0):
                raise GainFileError(f"{file}: {name} has to rise")
    if table.gain_db.shape != shape:
        raise GainFileError(f"{file}: gain_db has shape {table.gain_db.shape}, its places ask for {shape}")
    if not np.all(np.isfinite(table.tx_m)) or not np.all(np.isfinite(table.rx_m)):
        raise GainFileError(f"{file}: a place is not finite")
    return table
