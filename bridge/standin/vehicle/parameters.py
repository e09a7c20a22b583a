"""The parameter table, with ArduPilot's names and units, and ``--defaults`` files."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from enum import IntEnum
from math import isfinite
from pathlib import Path

NAME_MAX_BYTES = 16


class ParameterType(IntEnum):
    """MAV_PARAM_TYPE of the types that ArduPilot uses."""

    INT8 = 2
    INT16 = 4
    INT32 = 6
    REAL32 = 9


INT_RANGES = {
    ParameterType.INT8: (-128, 127),
    ParameterType.INT16: (-32768, 32767),
    ParameterType.INT32: (-(2**31), 2**31 - 1),
}


@dataclass(frozen=True, slots=True)
class Parameter:
    """One row of the table."""

    name: str
    default: float
    type: ParameterType = ParameterType.REAL32


def _rows() -> list[Parameter]:
    i8, i16, i32 = ParameterType.INT8, ParameterType.INT16, ParameterType.INT32
    return [
        Parameter("FORMAT_VERSION", 120, i16),
        Parameter("MAV_SYSID", 1, i16),
        Parameter("SYSID_THISMAV", 1, i16),
        Parameter("FRAME_CLASS", 1, i8),
        Parameter("FRAME_TYPE", 1, i8),
        Parameter("ARMING_CHECK", 1, i32),
        Parameter("DISARM_DELAY", 10, i8),
        Parameter("ANGLE_MAX", 3000, i16),
        Parameter("ATC_ANG_RLL_P", 6.0),
        Parameter("ATC_ANG_YAW_P", 3.0),
        Parameter("ATC_RAT_RLL_P", 0.10),
        Parameter("ATC_RAT_RLL_I", 0.10),
        Parameter("ATC_RAT_RLL_D", 0.004),
        Parameter("ATC_RAT_YAW_P", 0.25),
        Parameter("ATC_RAT_YAW_I", 0.03),
        Parameter("MOT_SPIN_ARM", 0.10),
        Parameter("MOT_SPIN_MIN", 0.15),
        Parameter("MOT_THST_HOVER", 0.35),
        Parameter("PSC_JERK_XY", 10.0),
        Parameter("PSC_JERK_Z", 8.0),
        Parameter("PSC_POSXY_P", 1.0),
        Parameter("PSC_POSZ_P", 1.5),
        Parameter("PSC_VELXY_P", 2.4),
        Parameter("PSC_VELXY_I", 0.8),
        Parameter("PSC_VELZ_P", 4.0),
        Parameter("WPNAV_SPEED", 1000),
        Parameter("WPNAV_SPEED_UP", 250),
        Parameter("WPNAV_SPEED_DN", 150),
        Parameter("WPNAV_ACCEL", 250),
        Parameter("WPNAV_ACCEL_Z", 100),
        Parameter("WPNAV_RADIUS", 200),
        Parameter("WP_YAW_BEHAVIOR", 2, i8),
        Parameter("GUID_TIMEOUT", 3.0),
        Parameter("RTL_ALT", 1500, i32),
        Parameter("RTL_ALT_FINAL", 0, i16),
        Parameter("RTL_CLIMB_MIN", 0, i16),
        Parameter("RTL_CONE_SLOPE", 3.0),
        Parameter("RTL_SPEED", 0, i16),
        Parameter("RTL_LOIT_TIME", 5000, i32),
        Parameter("LAND_SPEED", 50, i16),
        Parameter("LAND_SPEED_HIGH", 0, i16),
        Parameter("LAND_ALT_LOW", 1000, i16),
        Parameter("BATT_CAPACITY", 3300, i32),
        Parameter("RC_OVERRIDE_TIME", 3.0),
    ]


ALIASES = {"SYSID_THISMAV": "MAV_SYSID"}
"""Two names of one value: the older firmware's and the newer's."""


class UnknownParameterError(KeyError):
    """A name that is not in the table."""


class Parameters:
    """The values, by name and by index (the table's order)."""

    def __init__(self) -> None:
        self._rows = _rows()
        self._index = {row.name: index for index, row in enumerate(self._rows)}
        self._values = [float(row.default) for row in self._rows]
        self.revision = 0
        """Rises at each change, so that readers can keep derived values."""

    def __len__(self) -> int:
        return len(self._rows)

    def __contains__(self, name: str) -> bool:
        return name in self._index

    def __iter__(self) -> Iterator[str]:
        return iter(self._index)

    def __getitem__(self, name: str) -> float:
        return self._values[self._index[ALIASES.get(name, name)]]

    def index_of(self, name: str) -> int:
        """Return the place of a name in the table; raises UnknownParameterError."""
        try:
            return self._index[name]
        except KeyError:
            raise UnknownParameterError(name) from None

    def at(self, index: int) -> Parameter:
        """Return the row at an index; raises IndexError."""
        if index < 0:
            raise IndexError(index)
        return self._rows[index]

    def set(self, name: str, value: float) -> float:
        """Set a value, rounded and limited to its type; return what was stored.

        Raises:
            UnknownParameterError: no such name.
            ValueError: the value is not finite.
        """
        row = self._rows[self.index_of(name)]
        if not isfinite(value):
            raise ValueError(f"{name}: {value} is not a finite number")
        if row.type in INT_RANGES:
            low, high = INT_RANGES[row.type]
            value = float(max(low, min(high, round(value))))
        self._values[self._index[ALIASES.get(name, name)]] = value
        self.revision += 1
        return value


class DefaultsFileError(ValueError):
    """A line of a defaults file that is not ``NAME VALUE``."""

    def __init__(self, path: Path, line: int, text: str) -> None:
        super().__init__(f"{path}:{line}: expected NAME VALUE (or NAME,VALUE), found {text!r}")


def load_defaults(parameters: Parameters, paths: Iterable[Path]) -> list[str]:
    """Read parameter files, in their order: ``NAME VALUE`` or ``NAME,VALUE``, ``#`` comments.

    Returns:
        The names that the stand-in does not have (a file made for ArduPilot has many): ignored.

    Raises:
        OSError: a file cannot be read.
        DefaultsFileError: a line is not a name and a number.
    """
    unknown = []
    for path in paths:
        for number, raw in enumerate(
            path.read_text(encoding="utf-8", errors="replace").splitlines(), start=1
        ):
            words = raw.split("#", 1)[0].replace(",", " ").split()
            if not words:
                continue
            try:
                name, value = words[0].upper(), float(words[1])
                parameters.set(name, value)
            except UnknownParameterError:
                unknown.append(name)
            except (IndexError, ValueError):
                raise DefaultsFileError(path, number, raw.strip()) from None
    return unknown
