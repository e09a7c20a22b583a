"""Wind maps: a NetCDF grid of (time, altitude, y, x) -> wind, after the CF conventions.

Variables are found by their CF ``standard_name``: ``eastward_wind``, ``northward_wind`` (m/s) and,
optionally, ``upward_air_velocity``. Their four dimensions, in this order, have coordinate variables:

    time       s since the start of the run
    altitude   m above mean sea level
    y          latitude, ``degrees_north``; or m north of the file's ``origin_latitude``
    x          longitude, ``degrees_east``; or m east of the file's ``origin_longitude``

Coordinates increase. A dimension of length 1 means "everywhere". Metres are on ArduPilot's scale (fdm.geodesy).
The wind is interpolated linearly in all four. Files are read with SciPy, that is in NetCDF's classic format
(CDF-1, CDF-2); ``nccopy -k classic`` turns a NetCDF-4 file into one.
"""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from fdm.errors import WindError
from fdm.geodesy import GeodeticPosition, ned_from_geodetic
from fdm.truth import Vector
from fdm.wind import AirPoint

AXES = ("time", "altitude", "y", "x")
COMPONENTS = {"northward_wind": 1.0, "eastward_wind": 1.0, "upward_air_velocity": -1.0}
"""Standard names in the order north, east, down, and the sign that makes them so."""

Coordinates = tuple[float, ...]
Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class WindMap:
    """A wind map in memory.

    Attributes:
        name: the file, for messages.
        axes: the four coordinates (time s, altitude m, y, x), each increasing.
        origin: where x and y are metres from; None = they are degrees.
        ned_mps: wind, shape (time, altitude, y, x, 3).
    """

    name: str
    axes: tuple[Coordinates, Coordinates, Coordinates, Coordinates]
    origin: GeodeticPosition | None
    ned_mps: Array

    def coordinates(self, point: AirPoint) -> Coordinates:
        """(time, altitude, y, x) of `point` in this map."""
        time_s = point.sim_time_ns / 1e9
        if self.origin is None:
            return (time_s, point.alt_amsl_m, point.lat_deg, point.lon_deg)
        place = GeodeticPosition(point.lat_deg, point.lon_deg, point.alt_amsl_m)
        north, east, _ = ned_from_geodetic(self.origin, place)
        return (time_s, point.alt_amsl_m, north, east)

    def interpolate(self, coordinates: Coordinates, *, clamp: bool) -> Vector:
        """The wind at (time, altitude, y, x), NED m/s.

        Args:
            coordinates: where.
            clamp: outside the grid take the nearest edge's wind, else raise.

        Raises:
            WindError: outside the grid, and not `clamp`.
        """
        values: Array = self.ned_mps
        for name, axis, at in zip(AXES, self.axes, coordinates, strict=True):
            if len(axis) == 1:
                values = values[0]
                continue
            if not clamp and not axis[0] <= at <= axis[-1]:
                raise WindError(
                    f"{self.name}: {name} {at:g} is outside the map ({axis[0]:g} to {axis[-1]:g})"
                )
            below = min(max(bisect_right(axis, at) - 1, 0), len(axis) - 2)
            share = min(max((at - axis[below]) / (axis[below + 1] - axis[below]), 0.0), 1.0)
            values = (1.0 - share) * values[below] + share * values[below + 1]
        north, east, down = values.tolist()
        return (north, east, down)


@dataclass(frozen=True)
class MapWind:
    """The wind that a UA feels in a map.

    Attributes:
        wind_map: the map.
        outside: ``clamp`` or ``error``.
    """

    wind_map: WindMap
    outside: str

    def air_ned_mps(self, point: AirPoint) -> Vector:
        """The wind at `point`."""
        clamp = self.outside == "clamp"
        return self.wind_map.interpolate(self.wind_map.coordinates(point), clamp=clamp)


@lru_cache(maxsize=8)
def load_wind_map(path: Path) -> WindMap:
    """Read a wind map; several UA share one.

    Raises:
        WindError: the file is missing or is no wind map; the text says why.
    """
    from scipy.io import netcdf_file

    try:
        with netcdf_file(path, "r", mmap=False) as file:
            return _read(path, file)
    except OSError as error:
        raise WindError(f"{path}: {error.strerror or error}") from None
    except TypeError:
        raise WindError(f"{path}: is not in NetCDF's classic format (try nccopy -k classic)") from None


def _read(path: Path, file: Any) -> WindMap:
    by_name = {_text(getattr(v, "standard_name", b"")): v for v in file.variables.values()}
    missing = [name for name in ("eastward_wind", "northward_wind") if name not in by_name]
    if missing:
        raise WindError(f"{path}: no variable has the standard_name {' or '.join(missing)}")
    dimensions = by_name["eastward_wind"].dimensions
    if len(dimensions) != len(AXES):
        raise WindError(f"{path}: wind has the dimensions {dimensions}: needed are (time, altitude, y, x)")
    axes = tuple(_axis(path, file, name) for name in dimensions)
    shape = tuple(len(axis) for axis in axes)
    parts = []
    for name, sign in COMPONENTS.items():
        values = np.zeros(shape) if name not in by_name else _values(by_name[name])
        if values.shape != shape:
            raise WindError(f"{path}: {name} has the shape {values.shape}: needed is {shape}")
        parts.append(sign * values)
    ned_mps = np.stack(parts, axis=-1)
    if not np.isfinite(ned_mps).all():
        raise WindError(f"{path}: has values that are missing or not finite")
    return WindMap(str(path), (axes[0], axes[1], axes[2], axes[3]), _origin(path, file, dimensions), ned_mps)


def _axis(path: Path, file: Any, name: str) -> Coordinates:
    if name not in file.variables:
        raise WindError(f"{path}: dimension {name} has no coordinate variable")
    values = tuple(float(value) for value in file.variables[name][:])
    if not values or any(a >= b for a, b in pairwise(values)):
        raise WindError(f"{path}: coordinate {name} does not increase")
    return values


def _origin(path: Path, file: Any, dimensions: tuple[str, ...]) -> GeodeticPosition | None:
    units = [_text(getattr(file.variables[name], "units", b"")) for name in dimensions[2:]]
    if units == ["degrees_north", "degrees_east"]:
        return None
    if units != ["m", "m"]:
        raise WindError(f"{path}: units of {dimensions[2:]} are {units}: needed are degrees or m, both")
    try:
        return GeodeticPosition(float(file.origin_latitude), float(file.origin_longitude), 0.0)
    except (AttributeError, ValueError) as error:
        raise WindError(f"{path}: origin_latitude and origin_longitude: {error}") from None


def _values(variable: Any) -> Array:
    """A variable's numbers, unpacked (CF: scale_factor, add_offset)."""
    values = np.array(variable[:], dtype=np.float64)
    missing = getattr(variable, "_FillValue", None)
    if missing is not None:
        values[values == float(missing)] = np.nan
    return values * float(getattr(variable, "scale_factor", 1.0)) + float(
        getattr(variable, "add_offset", 0.0)
    )


def _text(value: object) -> str:
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value)
