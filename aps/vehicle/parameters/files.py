"""Files of parameters: ArduPilot's .parm (``NAME VALUE``, also with a comma) and QGroundControl's .params."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Final, NamedTuple

from aps.vehicle.parameters.transfer import as_float32, checked_name

_FLAG: Final = "@"
"""Begins what ArduPilot's own defaults have behind a value: ``@READONLY``."""
WHOLE_MAX: Final = 2**32 - 1
"""The largest number of a whole parameter (MAV_PARAM_TYPE_UINT32)."""


class ParameterDifference(NamedTuple):
    """A parameter that differs; ``None``: the one or the other side has no such parameter."""

    name: str
    ours: float | None
    theirs: float | None


def read_parameters(text: str) -> dict[str, float]:
    """The parameters in the text of a .parm or .params file; of one that is there twice the last counts.

    Raises:
        ValueError: a line is none; the text says which.
    """
    found: dict[str, float] = {}
    for number, line in enumerate(text.splitlines(), 1):
        words = line.split("#", 1)[0].replace(",", " ").split()
        if not words:
            continue
        if len(words) == 5 and words[0].isdigit() and words[1].isdigit():
            words = words[2:4]  # QGroundControl: system, component, name, value, type
        try:
            if len(words) != 2 and (len(words) < 2 or not words[2].startswith(_FLAG)):
                raise ValueError("a name and a value are expected")
            value = float(words[1])
            if not math.isfinite(value):
                raise ValueError(f"{words[1]} is no value")
            as_float32(value)
            found[checked_name(words[0])] = value
        except ValueError as error:
            raise ValueError(f"line {number}: {error}") from error
    return found


def write_parameters(values: Mapping[str, float]) -> str:
    """Text of a .parm file, sorted by name, as MAVProxy and Mission Planner read it."""
    return "".join(f"{name:<16} {_shortest(value)}\n" for name, value in sorted(values.items()))


def _shortest(value: float) -> str:
    """A whole number as it is (PX4 keeps 32 bits of it), else the shortest decimals of the same four-byte float."""
    if value.is_integer() and abs(value) <= WHOLE_MAX:
        return f"{value:.0f}"
    for digits in range(6, 10):
        text = f"{value:.{digits}g}"
        if as_float32(float(text)) == as_float32(value):
            return text
    return repr(value)


def compare(ours: Mapping[str, float], theirs: Mapping[str, float]) -> list[ParameterDifference]:
    """What differs, whole numbers exactly and others as four-byte floats; sorted by name."""
    found = []
    for name in sorted(ours.keys() | theirs.keys()):
        mine, other = ours.get(name), theirs.get(name)
        if mine is None or other is None or not _is_same(mine, other):
            found.append(ParameterDifference(name, mine, other))
    return found


def _is_same(one: float, other: float) -> bool:
    if one.is_integer() and other.is_integer() and max(abs(one), abs(other)) <= WHOLE_MAX:
        return one == other
    return as_float32(one) == as_float32(other)
