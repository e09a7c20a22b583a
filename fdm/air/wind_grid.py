"""Takes a wind's grid out of a NetCDF file, after the CF conventions (1.10).

Each error names the file, the variable and, where it is one, the attribute.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from statistics import median
from typing import Any

import numpy as np
import numpy.typing as npt

from fdm.errors import WindError
from fdm.model.geodesy import GeodeticPosition
from sitl_configs.netcdf import NetcdfFile, Variable

Array = npt.NDArray[np.float64]
Coordinates = tuple[float, ...]

AXES = ("time", "altitude", "y", "x")
LETTERS = {"T": "time", "Z": "altitude", "Y": "y", "X": "x"}
STANDARD_NAMES = {
    "time": "time",
    "altitude": "altitude",
    "height_above_mean_sea_level": "altitude",
    "height_above_geopotential_datum": "altitude",
    "latitude": "y",
    "projection_y_coordinate": "y",
    "longitude": "x",
    "projection_x_coordinate": "x",
}
COMPONENTS = {"northward_wind": 1.0, "eastward_wind": 1.0, "upward_air_velocity": -1.0}
"""Standard names in the order north, east, down, and the sign that makes them so."""
MAY_BE_MISSING = "upward_air_velocity"
WIND_MAX_MPS = 200.0
"""Faster air is a mistake: a fill value that the file does not declare, or wrong units or packing."""

LATITUDE_MAX_DEG = 90.0 + 1e-4
"""With the rounding of axes in single precision."""

METRES = {
    "m": 1.0,
    "metre": 1.0,
    "meter": 1.0,
    "metres": 1.0,
    "meters": 1.0,
    "km": 1000.0,
    "ft": 0.3048,
    "feet": 0.3048,
}
SPEEDS = {
    "m s-1": 1.0,
    "m/s": 1.0,
    "m s^-1": 1.0,
    "m s**-1": 1.0,
    "m.s-1": 1.0,
    "meter second-1": 1.0,
    "km h-1": 1 / 3.6,
}
SPEEDS |= {"km/h": 1 / 3.6, "knot": 1852 / 3600, "knots": 1852 / 3600, "kt": 1852 / 3600}
SECONDS = {
    "second": 1.0,
    "sec": 1.0,
    "s": 1.0,
    "minute": 60.0,
    "min": 60.0,
    "hour": 3600.0,
    "hr": 3600.0,
    "h": 3600.0,
}
SECONDS |= {"day": 86400.0, "d": 86400.0}
NORTH = {"degrees_north", "degree_north", "degrees_N", "degree_N", "degreesN", "degreeN"}
EAST = {"degrees_east", "degree_east", "degrees_E", "degree_E", "degreesE", "degreeE"}


@dataclass(frozen=True)
class Grid:
    """A wind's grid.

    Attributes:
        axes: the four coordinates (time s, altitude m, y, x), each increasing; one that the file lacks has the
            single value 0.
        origin: where x and y are metres from; None = they are degrees.
        ned_mps: wind, shape (time, altitude, y, x, 3).
    """

    axes: tuple[Coordinates, Coordinates, Coordinates, Coordinates]
    origin: GeodeticPosition | None
    ned_mps: Array


def grid_of(name: str, file: NetcdfFile) -> Grid:
    """The wind's grid in a file.

    Args:
        name: of the file, for messages.
        file: its contents.

    Raises:
        WindError: it holds no wind map; the text says why.
    """
    return _Reader(name, file).grid()


def _goes_around(lon_deg: Coordinates) -> bool:
    """Whether what is missing to the whole turn is no more than a usual cell."""
    if len(lon_deg) < 3:
        return False
    missing_deg = 360.0 - (lon_deg[-1] - lon_deg[0])
    return 0.0 < missing_deg <= 1.001 * median(b - a for a, b in pairwise(lon_deg))


class _Reader:
    def __init__(self, name: str, file: NetcdfFile) -> None:
        self._name = name
        self._file = file

    def grid(self) -> Grid:
        wind = self._components()
        dimensions = wind["eastward_wind"].dimensions
        roles = self._roles(dimensions)
        coordinates = {role: self._coordinate(role, name) for role, name in roles.items()}
        flips = {role: len(axis) > 1 and axis[0] > axis[1] for role, axis in coordinates.items()}
        parts = []
        for standard_name, sign in COMPONENTS.items():
            if standard_name in wind:
                variable = wind[standard_name]
                if variable.dimensions != dimensions:
                    raise self._error(variable, f"has the dimensions {variable.dimensions}, not {dimensions}")
                parts.append(sign * self._ordered(variable, roles, flips))
            else:
                parts.append(np.zeros_like(parts[0]))
        axes = tuple(self._increasing(role, coordinates.get(role, (0.0,))) for role in AXES)
        ned_mps = np.stack(parts, axis=-1)
        if ned_mps.shape[:-1] != tuple(len(axis) for axis in axes):
            raise WindError(f"{self._name}: the wind is not on the grid of its coordinates")
        time_s, altitude_m, y, x = axes
        origin = self._origin(roles)
        if origin is None and _goes_around(x):
            x = (*x, x[0] + 360.0)
            ned_mps = np.concatenate((ned_mps, ned_mps[..., :1, :]), axis=3)
        return Grid((time_s, altitude_m, y, x), origin, ned_mps)

    def _components(self) -> dict[str, Variable]:
        found: dict[str, Variable] = {}
        for variable in self._file.variables.values():
            standard_name = variable.text("standard_name")
            if standard_name not in COMPONENTS:
                continue
            if standard_name in found:
                raise self._error(
                    variable, f"{found[standard_name].name} has the same standard_name {standard_name}"
                )
            found[standard_name] = variable
        missing = [name for name in COMPONENTS if name not in found and name != MAY_BE_MISSING]
        if missing:
            raise WindError(f"{self._name}: no variable has the standard_name {' or '.join(missing)}")
        return found

    def _roles(self, dimensions: tuple[str, ...]) -> dict[str, str]:
        """Which dimension is which axis; dimensions of length 1 may be none."""
        roles: dict[str, str] = {}
        for dimension in dimensions:
            variable = self._file.variables.get(dimension)
            if variable is None:
                raise WindError(f"{self._name}: dimension {dimension} has no coordinate variable")
            role = _role_of(variable)
            if role in roles:
                raise self._error(variable, f"is a second axis for {role}; the first is {roles[role]}")
            if role is not None:
                roles[role] = dimension
            elif variable.values.size != 1:
                raise self._error(
                    variable, "is no axis of a wind map: give it the attribute axis (T, Z, Y or X)"
                )
        return roles

    def _coordinate(self, role: str, name: str) -> Coordinates:
        """A coordinate's values in s, m or degrees, in the file's order."""
        variable = self._file.variables[name]
        if variable.values.ndim != 1:
            raise self._error(variable, f"has {variable.values.ndim} dimensions: needed is one")
        values = self._unpacked(variable) * self._factor(role, variable)
        steps = np.diff(values)
        if not (np.all(steps > 0) or np.all(steps < 0)):
            raise self._error(variable, "neither increases nor decreases")
        if (
            role == "y"
            and variable.text("units").strip() in NORTH
            and np.abs(values).max() > LATITUDE_MAX_DEG
        ):
            raise self._error(
                variable, f"goes from {values.min():g} to {values.max():g}: latitudes are within 90"
            )
        if role == "time" and " since " in variable.text("units"):
            values = values - values.min()
        return tuple(values.tolist())

    def _factor(self, role: str, variable: Variable) -> float:
        units = variable.text("units").strip()
        if role == "time":
            word = units.split(" since ")[0].strip().lower()
            return self._scale(variable, SECONDS, word if word in SECONDS else word.removesuffix("s"), units)
        if units in (NORTH if role == "y" else EAST if role == "x" else ()):
            return 1.0
        if role == "altitude" and variable.text("standard_name") == "height":
            raise self._error(
                variable, "attribute standard_name is 'height', above the ground: needed is 'altitude'"
            )
        if role == "altitude" and variable.text("positive").lower() == "down":
            raise self._error(
                variable, "attribute positive is 'down': needed are heights above mean sea level"
            )
        return self._scale(variable, METRES, units, units)

    def _scale(self, variable: Variable, known: dict[str, float], key: str, units: str) -> float:
        if not units:
            return 1.0
        if key not in known:
            raise self._error(variable, f"attribute units is {units!r}: known are {', '.join(known)}")
        return known[key]

    def _ordered(self, variable: Variable, roles: dict[str, str], flips: dict[str, bool]) -> Array:
        """A component in m/s, its axes in our order and increasing."""
        values = self._unpacked(variable) * self._scale(
            variable, SPEEDS, *(variable.text("units").strip(),) * 2
        )
        fastest_mps = float(np.abs(values).max())
        if not fastest_mps <= WIND_MAX_MPS:
            raise self._error(
                variable,
                f"has a wind of {fastest_mps:g} m/s, more than {WIND_MAX_MPS:g}: see its units, _FillValue, "
                "scale_factor and add_offset",
            )
        present = [role for role in AXES if role in roles]
        places = [variable.dimensions.index(roles[role]) for role in present]
        rest = [place for place in range(values.ndim) if place not in places]
        values = np.transpose(values, (*places, *rest))
        values = values.reshape([values.shape[present.index(r)] if r in roles else 1 for r in AXES])
        for index, role in enumerate(AXES):
            if flips.get(role):
                values = np.flip(values, axis=index)
        return np.ascontiguousarray(values)

    def _unpacked(self, variable: Variable) -> Array:
        """A variable's numbers (CF, section 8.1: scale_factor, add_offset), none of them missing."""
        stored = self._numbers(variable)
        missing = ~np.isfinite(stored)
        for attribute in ("_FillValue", "missing_value"):
            if attribute in variable.attributes:
                missing |= np.isin(stored, _as_stored(variable.attributes[attribute], variable.values.dtype))
        count = int(missing.sum())
        if count:
            raise self._error(variable, f"has {count} values that are missing or not finite")
        scale, offset = (
            variable.attributes.get(a, d) for a, d in (("scale_factor", 1.0), ("add_offset", 0.0))
        )
        if isinstance(scale, str) or isinstance(offset, str):
            raise self._error(variable, "attribute scale_factor or add_offset is no number")
        with np.errstate(over="ignore", invalid="ignore"):
            return stored * scale + offset

    def _numbers(self, variable: Variable) -> Array:
        if variable.values.ndim != len(variable.dimensions):
            raise self._error(variable, f"has the shape {variable.values.shape}, but {variable.dimensions}")
        if variable.values.dtype.kind not in "iuf" or not variable.values.size:
            raise self._error(
                variable, f"holds no numbers ({variable.values.size} of {variable.values.dtype})"
            )
        return variable.values.astype(np.float64)

    def _increasing(self, role: str, values: Coordinates) -> Coordinates:
        ordered = values if len(values) < 2 or values[0] < values[1] else values[::-1]
        if any(a >= b for a, b in pairwise(ordered)):
            raise WindError(f"{self._name}: {role} does not increase")
        return ordered

    def _origin(self, roles: dict[str, str]) -> GeodeticPosition | None:
        units = [
            self._file.variables[roles[role]].text("units").strip() for role in ("y", "x") if role in roles
        ]
        in_degrees = [unit in NORTH | EAST for unit in units]
        if all(in_degrees):
            return None
        if any(in_degrees):
            raise WindError(f"{self._name}: units of y and x are {units}: needed are degrees or metres, both")
        try:
            given = [self._file.attributes[f"origin_{what}"] for what in ("latitude", "longitude")]
            place = [float(each) for each in given if not isinstance(each, tuple)]  # of missing_value alone
            return GeodeticPosition(place[0], place[1], 0.0)
        except (KeyError, ValueError) as error:
            raise WindError(
                f"{self._name}: y and x are metres: the attributes origin_latitude and origin_longitude have to say "
                f"from where ({type(error).__name__}: {error})"
            ) from None

    def _error(self, variable: Variable, text: str) -> WindError:
        return WindError(f"{self._name}: variable {variable.name}: {text}")


def _as_stored(declared: str | float | tuple[float, ...], kind: np.dtype[Any]) -> Any:
    """What is declared as missing, as the variable has it: in single precision no number is a double's -99.9."""
    if isinstance(declared, str) or kind.kind != "f":
        return declared
    with np.errstate(over="ignore"):
        return np.asarray(declared, np.float64).astype(kind)


def _role_of(variable: Variable) -> str | None:
    """Which of AXES a coordinate variable is, found by axis, standard_name, units or name; or None."""
    units = variable.text("units").strip()
    by_units = "y" if units in NORTH else "x" if units in EAST else "time" if " since " in units else None
    return (
        LETTERS.get(variable.text("axis").upper())
        or STANDARD_NAMES.get(variable.text("standard_name"))
        or by_units
        or (variable.name if variable.name in AXES else None)
    )
