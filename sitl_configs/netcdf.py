"""Reads NetCDF files whole: classic (CDF-1, CDF-2) through SciPy, NetCDF-4, which is HDF5, through h5py.

HDF5 is a C library that loops for ever over some damaged files (one in some thousand, at random bytes): it runs in a
process of its own, ``python -m sitl_configs.netcdf FILE [VARIABLE ...]``, which has a limited time.

What comes out is plain: arrays, dimension names and attributes. Nothing here knows of winds, of gains or of the CF
conventions.
"""

from __future__ import annotations

import math
import os
import pickle
import resource
import subprocess
import sys
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

CLASSIC = (b"CDF\x01", b"CDF\x02")
CLASSIC_64_BIT_DATA = b"CDF\x05"
HDF5 = b"\x89HDF\r\n\x1a\n"
USER_BLOCK_BYTES = 512
"""Of the shortest: HDF5 may begin behind one of this length, or of twice, four times, ... of it."""
FILE_MAX_BYTES = 2_000_000_000

READ = (
    *("standard_name", "units", "axis", "positive"),
    *("_FillValue", "missing_value", "scale_factor", "add_offset"),
    *("origin_latitude", "origin_longitude", "frequency_hz"),
)
"""The attributes that are read: in a damaged file each one is a way to trip HDF5."""

READ_TIMEOUT_S = 60.0
"""Wall time that a NetCDF-4 file may take."""

Attributes = Mapping[str, str | float | tuple[float, ...]]


@dataclass(frozen=True)
class Variable:
    """A variable.

    Attributes:
        name: in the file.
        dimensions: names of its dimensions, slowest first.
        attributes: texts, and numbers (of an array the first one; of `missing_value` all).
        values: as stored, neither unpacked nor masked.
    """

    name: str
    dimensions: tuple[str, ...]
    attributes: Attributes
    values: npt.NDArray[Any]

    def text(self, attribute: str) -> str:
        """An attribute as text; empty if it is not there."""
        return str(self.attributes.get(attribute, ""))


@dataclass(frozen=True)
class NetcdfFile:
    """A file's contents."""

    attributes: Attributes
    variables: Mapping[str, Variable]


class NetcdfError(ValueError):
    """A file cannot be read; the text names it and says why."""


class BrokenFileError(Exception):
    """A NetCDF-4 file could not be read; the text says why."""


def read_netcdf(path: Path, variables: Collection[str] = ()) -> NetcdfFile:
    """Read a file; only these variables, if they are named.

    Raises:
        NetcdfError: it cannot be opened, is no NetCDF file, or is broken.
    """
    try:
        if path.stat().st_size > FILE_MAX_BYTES:
            raise NetcdfError(f"{path}: is larger than {FILE_MAX_BYTES / 1e9:g} GB; cut out what is needed")
        magic = _magic(path)
    except OSError as error:
        raise NetcdfError(f"{path}: {error.strerror or error}") from None
    if magic[:4] == CLASSIC_64_BIT_DATA:
        raise NetcdfError(f"{path}: is NetCDF in the CDF-5 format; convert it with nccopy -k nc4")
    reader = _read_classic if magic[:4] in CLASSIC else _read_netcdf4 if magic == HDF5 else None
    if reader is None:
        raise NetcdfError(f"{path}: is no NetCDF file: it begins with {magic[:4]!r}, not with CDF or HDF")
    try:
        return reader(path, variables)
    except BrokenFileError as error:
        raise NetcdfError(f"{path}: is broken: {error}") from None
    except Exception as error:  # a broken file may raise anything in the libraries
        raise NetcdfError(
            f"{path}: is broken: {type(error).__name__}: {str(error) or 'no reason given'}"
        ) from None


def is_netcdf(path: Path) -> bool:
    """Whether a file begins as NetCDF does, in whichever format and whether or not it can be read.

    Raises:
        OSError: it cannot be opened.
    """
    return _magic(path)[:4] in (*CLASSIC, CLASSIC_64_BIT_DATA, HDF5[:4])


def _magic(path: Path) -> bytes:
    """How a file begins; where HDF5 is behind a user block, how that does."""
    with path.open("rb") as file:
        magic, end = file.read(len(HDF5)), file.seek(0, os.SEEK_END)
        place = USER_BLOCK_BYTES
        while place < end:
            file.seek(place)
            if file.read(len(HDF5)) == HDF5:
                return HDF5
            place *= 2
    return magic


def _read_classic(path: Path, wanted: Collection[str]) -> NetcdfFile:
    from scipy.io import netcdf_file

    file: Any
    with netcdf_file(path, "r", mmap=False) as file:
        variables = {
            name: Variable(name, tuple(v.dimensions), _attributes(v._attributes), np.array(v[...]))
            for name, v in file.variables.items()
            if not wanted or name in wanted
        }
        return NetcdfFile(_attributes(file._attributes), variables)


def _read_netcdf4(path: Path, wanted: Collection[str]) -> NetcdfFile:
    command = [sys.executable, "-P", "-m", "sitl_configs.netcdf", str(path), *wanted]
    try:
        done = subprocess.run(command, capture_output=True, timeout=READ_TIMEOUT_S, check=False)
    except subprocess.TimeoutExpired:
        raise BrokenFileError(f"HDF5 did not end with it in {READ_TIMEOUT_S:g} s") from None
    if done.returncode:
        last = done.stderr.decode("utf-8", "replace").strip().splitlines()[-1:]
        raise BrokenFileError(last[0] if last else f"HDF5 crashed on it ({done.returncode})")
    contents = pickle.loads(done.stdout)
    if not isinstance(contents, NetcdfFile):
        raise BrokenFileError("its reader gave something else")
    return contents


def _read_hdf5(path: Path, wanted: Collection[str]) -> NetcdfFile:
    import h5py

    with h5py.File(path, "r") as file:
        variables = {
            name: Variable(name, _dimension_names(v), _attributes(v.attrs), _values(v))
            for name, v in file.items()
            if (not wanted or name in wanted) and isinstance(v, h5py.Dataset) and not _is_bare_dimension(v)
        }
        return NetcdfFile(_attributes(file.attrs), variables)


def _values(dataset: Any) -> npt.NDArray[Any]:
    """All of a dataset, which a small file may say is vast; whoever reads it makes doubles of it."""
    as_doubles = 8 * (dataset.size or 0)
    if as_doubles > FILE_MAX_BYTES:
        raise MemoryError(f"{dataset.name} has {as_doubles / 1e9:g} GB, more than {FILE_MAX_BYTES / 1e9:g}")
    return np.array(dataset[...])


def _is_bare_dimension(dataset: Any) -> bool:
    """Whether it only stands for a dimension without coordinates, as the NetCDF library marks it."""
    name = dataset.attrs.get("NAME", b"")
    mark = b"This is a netCDF dimension but not a netCDF variable"
    return (name if isinstance(name, bytes) else str(name).encode()).startswith(mark)


def _dimension_names(dataset: Any) -> tuple[str, ...]:
    """NetCDF-4 keeps a dimension as an HDF5 dimension scale; a coordinate variable is its own."""
    if dataset.ndim == 1 and dataset.is_scale:
        return (dataset.name.lstrip("/"),)
    return tuple(dimension[0].name.lstrip("/") if len(dimension) else "" for dimension in dataset.dims)


def _attributes(stored: Mapping[str, Any]) -> dict[str, str | float | tuple[float, ...]]:
    plain: dict[str, str | float | tuple[float, ...]] = {}
    for name in READ:
        if name not in stored:
            continue
        values = np.ravel(np.asarray(stored[name]))
        if values.size and np.issubdtype(values.dtype, np.number):
            numbers = values.astype(float).tolist()
            plain[name] = tuple(numbers) if name == "missing_value" else numbers[0]
            continue
        text = values.tolist()[0] if values.size == 1 else ""
        if isinstance(text, bytes):
            text = text.decode("utf-8", "replace")
        plain[name] = text if isinstance(text, str) else ""  # no number, which whoever wants one refuses
    return plain


def main(path: Path, wanted: Collection[str]) -> None:
    """Write the pickled contents of a NetCDF-4 file to standard output; ends the process with an error's text.

    Its processor time is limited: who waits for it may be killed meanwhile, and HDF5 would loop for ever.
    """
    limit_s = math.ceil(READ_TIMEOUT_S)
    resource.setrlimit(resource.RLIMIT_CPU, (limit_s, limit_s + 1))
    try:
        sys.stdout.buffer.write(pickle.dumps(_read_hdf5(path, wanted)))
    except Exception as error:
        sys.exit(f"{type(error).__name__}: {error}")


if __name__ == "__main__":
    # As a module of its name, so that the records unpickle in the process that asked.
    from sitl_configs import netcdf

    netcdf.main(Path(sys.argv[1]), sys.argv[2:])
