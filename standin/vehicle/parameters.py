"""The parameter table, with ArduPilot's names and units."""

from __future__ import annotations

from enum import IntEnum
from math import copysign, isfinite
from typing import NamedTuple


class ParameterType(IntEnum):
    """MAV_PARAM_TYPE of the types that ArduPilot uses."""

    INT8 = 2
    INT16 = 4
    INT32 = 6
    REAL32 = 9


CUT_MARGIN = 0.01
"""ArduPilot cuts what it gets for a whole number, this much further from zero (``AP_Param::set_float``)."""
_BITS = {ParameterType.INT8: 8, ParameterType.INT16: 16, ParameterType.INT32: 32}


class Parameter(NamedTuple):
    """One row of the table."""

    name: str
    default: float
    type: ParameterType = ParameterType.REAL32


_I8, _I16, _I32 = ParameterType.INT8, ParameterType.INT16, ParameterType.INT32
TABLE = (
    Parameter("MAV_SYSID", 1, _I16),
    Parameter("FRAME_CLASS", 1, _I8),
    Parameter("FRAME_TYPE", 1, _I8),
    Parameter("ARMING_CHECK", 1, _I32),
    Parameter("DISARM_DELAY", 10, _I8),
    Parameter("ANGLE_MAX", 3000, _I16),
    Parameter("MOT_THST_HOVER", 0.35),
    Parameter("WPNAV_SPEED", 1000),
    Parameter("WPNAV_SPEED_UP", 250),
    Parameter("WPNAV_SPEED_DN", 150),
    Parameter("WPNAV_ACCEL", 250),
    Parameter("WPNAV_ACCEL_Z", 100),
    Parameter("WPNAV_RADIUS", 200),
    Parameter("WP_YAW_BEHAVIOR", 2, _I8),
    Parameter("GUID_TIMEOUT", 3.0),
    Parameter("RTL_ALT", 1500, _I32),
    Parameter("RTL_CONE_SLOPE", 3.0),
    Parameter("RTL_LOIT_TIME", 5000, _I32),
    Parameter("LAND_SPEED", 50, _I16),
    Parameter("LAND_ALT_LOW", 1000, _I16),
    Parameter("BATT_CAPACITY", 3300, _I32),
)
"""Each is used: there is none that only lies in the list."""
_INDEX = {row.name: index for index, row in enumerate(TABLE)}


class UnknownParameterError(KeyError):
    """A name that is not in the table."""


class StandinParameters:
    """The values, by name."""

    def __init__(self) -> None:
        self._values = {row.name: float(row.default) for row in TABLE}
        self.revision = 0
        """Rises at each change, so that readers can keep derived values."""

    def __contains__(self, name: str) -> bool:
        return name in self._values

    def __getitem__(self, name: str) -> float:
        return self._values[name]

    def row(self, name: str) -> Parameter:
        """Return the row of a name; raises UnknownParameterError."""
        try:
            return TABLE[_INDEX[name]]
        except KeyError:
            raise UnknownParameterError(name) from None

    def set(self, name: str, value: float) -> float:
        """Set a value, cut to a whole number and limited where its type is; return what was stored.

        Raises:
            UnknownParameterError: no such name.
            ValueError: the value is not finite.
        """
        row = self.row(name)
        if not isfinite(value):
            raise ValueError(f"{name}: {value} is not a finite number")
        if row.type in _BITS:
            half = 1 << (_BITS[row.type] - 1)
            value = float(max(-half, min(half - 1, int(value + copysign(CUT_MARGIN, value)))))
        self._values[name] = value
        self.revision += 1
        return value
