"""What UA send each other: readings, estimates and the plan, as bytes."""

from __future__ import annotations

import math
import struct
from typing import NamedTuple

from localisation.model import Reading

VERSION = 1
_HEAD = struct.Struct("<BBBB")
_READING = struct.Struct("<IBqffff")
_ESTIMATE = struct.Struct("<Bfffff")
_WAYPOINT = struct.Struct("<qff")
PART_MAX = 255
"""Readings, estimates or waypoints in one message."""


class SharedEstimate(NamedTuple):
    """An estimate as it is transmitted: emitter, north, east (m), and the covariance's three terms (m^2)."""

    emitter: int
    north_m: float
    east_m: float
    north_m2: float
    both_m2: float
    east_m2: float


class PlannedPoint(NamedTuple):
    """Where a UA plans to be at an instant, m."""

    sim_time_ns: int
    north_m: float
    east_m: float


class Shared(NamedTuple):
    """One message."""

    readings: tuple[Reading, ...] = ()
    estimates: tuple[SharedEstimate, ...] = ()
    plan: tuple[PlannedPoint, ...] = ()


def pack(shared: Shared) -> bytes:
    """The bytes of a message.

    Raises:
        ValueError: more than PART_MAX of a kind.
    """
    counts = tuple(map(len, shared))
    if max(counts) > PART_MAX:
        raise ValueError(f"{counts} readings, estimates, waypoints: at most {PART_MAX} of each")
    parts = [_HEAD.pack(VERSION, *counts)]
    for number, emitter, sim_time_ns, place, power_dbm in shared.readings:
        parts.append(_READING.pack(number, emitter, sim_time_ns, *place, power_dbm))
    parts += [_ESTIMATE.pack(*each) for each in shared.estimates]
    parts += [_WAYPOINT.pack(*each) for each in shared.plan]
    return b"".join(parts)


def unpack(payload: bytes) -> Shared | None:
    """The message in some bytes; None if they are none."""
    if len(payload) < _HEAD.size:
        return None
    version, readings, estimates, plan = _HEAD.unpack_from(payload)
    ends = [_HEAD.size]
    for count, part in ((readings, _READING), (estimates, _ESTIMATE), (plan, _WAYPOINT)):
        ends.append(ends[-1] + count * part.size)
    if version != VERSION or len(payload) != ends[-1]:
        return None
    found = Shared(
        tuple(
            Reading(number, emitter, ns, (north, east, down), power)
            for number, emitter, ns, north, east, down, power in _READING.iter_unpack(
                payload[ends[0] : ends[1]]
            )
        ),
        tuple(map(SharedEstimate._make, _ESTIMATE.iter_unpack(payload[ends[1] : ends[2]]))),
        tuple(map(PlannedPoint._make, _WAYPOINT.iter_unpack(payload[ends[2] : ends[3]]))),
    )
    return found if _is_finite(found) else None


def _is_finite(shared: Shared) -> bool:
    numbers = [number for each in shared.readings for number in (*each.place_ned_m, each.power_dbm)]
    numbers += [number for part in (shared.estimates, shared.plan) for each in part for number in each]
    return all(map(math.isfinite, numbers))
