"""Wind maps: a NetCDF grid of (time, altitude, y, x) -> wind, after the CF conventions.

Variables are found by their CF ``standard_name``: ``eastward_wind``, ``northward_wind`` and, optionally,
``upward_air_velocity``; units m s-1, km h-1 or knots. Their dimensions have coordinate variables, recognised by the
attribute ``axis``, the standard name, the units or the names time, altitude, y and x, in any order:

    time       s, min, h or d since the start of the run; with "since <date>", the first time is the start
    altitude   m, km or ft above mean sea level
    y          latitude, ``degrees_north``; or metres north of the file's ``origin_latitude``
    x          longitude, ``degrees_east``; or metres east of the file's ``origin_longitude``

Coordinates increase or decrease. A dimension that is missing, or of length 1, means "everywhere". Packed values are
unpacked, missing ones refused. Metres are on ArduPilot's scale (fdm.model.geodesy). The wind is interpolated linearly
in all four. Files are NetCDF classic or NetCDF-4 (sitl_configs.netcdf); fdm.air.wind_grid reads the grid.
"""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from fdm.air.wind_grid import AXES, Array, Coordinates, grid_of
from fdm.errors import WindError
from fdm.model.air_point import AirPoint
from fdm.model.geodesy import GeodeticPosition, ned_from_geodetic
from fdm.model.truth import Vector
from sitl_configs.netcdf import NetcdfError, read_netcdf


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
            # Maps run from -180 to 180 degrees or from 0 to 360: take the turn that is nearest.
            west_deg, east_deg = self.axes[3][0], self.axes[3][-1]
            middle_deg = 0.5 * (west_deg + east_deg)
            lon_deg = middle_deg + (point.lon_deg - middle_deg + 180.0) % 360.0 - 180.0
            if east_deg - west_deg >= 360.0:  # no edge there, but rounding
                lon_deg = min(max(lon_deg, west_deg), east_deg)
            return (time_s, point.alt_amsl_m, point.lat_deg, lon_deg)
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
        cell: list[int | slice] = []
        shares: list[float] = []
        for name, axis, at in zip(AXES, self.axes, coordinates, strict=True):
            if len(axis) == 1:
                cell.append(0)
                continue
            if not clamp and not axis[0] <= at <= axis[-1]:
                raise WindError(
                    f"{self.name}: {name} {at:g} is outside the map ({axis[0]:g} to {axis[-1]:g})"
                )
            below = min(max(bisect_right(axis, at) - 1, 0), len(axis) - 2)
            cell.append(slice(below, below + 2))
            shares.append(min(max((at - axis[below]) / (axis[below + 1] - axis[below]), 0.0), 1.0))
        values: Array = self.ned_mps[tuple(cell)]
        for share in shares:
            values = (1.0 - share) * values[0] + share * values[1]
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


def load_wind_map(path: Path) -> WindMap:
    """Read a wind map; several UA share one.

    Raises:
        WindError: the file is missing or is no wind map; the text says why.
    """
    try:
        changed_ns = path.stat().st_mtime_ns
    except OSError as error:
        raise WindError(f"{path}: {error.strerror or error}") from None
    return _load(path, changed_ns)


@lru_cache(maxsize=8)
def _load(path: Path, _changed_ns: int) -> WindMap:
    try:
        contents = read_netcdf(path)
    except NetcdfError as error:
        raise WindError(str(error)) from None
    grid = grid_of(str(path), contents)
    return WindMap(str(path), grid.axes, grid.origin, grid.ned_mps)
