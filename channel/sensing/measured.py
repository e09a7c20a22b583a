"""What sensors measured at one instant, as columns."""

from __future__ import annotations

from enum import Enum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from channel.checks import FloatArray


class SensingOutcome(Enum):
    """What became of a measurement: it was reported to the node, or why not."""

    MEASURED = "measured"
    BELOW_THRESHOLD = "below_threshold"
    SILENT = "silent"
    """The emitter did not transmit."""
    OUT_OF_RANGE = "out_of_range"
    NO_POSITION = "no_position"


OUTCOMES = tuple(SensingOutcome)
"""By the numbers in `Measured.outcome`."""
MEASURED, BELOW_THRESHOLD, SILENT, OUT_OF_RANGE, NO_POSITION = range(len(OUTCOMES))


class Places(NamedTuple):
    """Where N stations are, in one frame.

    Attributes:
        position_ned_m: shape (N, 3).
        attitude_wxyz: body to north-east-down, shape (N, 4); None: level, nose north.
        velocity_ned_mps: shape (N, 3); None: they stand.
        known: which of them were ever seen, shape (N,); None: all.
    """

    position_ned_m: FloatArray
    attitude_wxyz: FloatArray | None = None
    velocity_ned_mps: FloatArray | None = None
    known: NDArray[np.bool_] | None = None


class Measured(NamedTuple):
    """R measurements of one instant, by sensor, then emitter; columns of shape (R,).

    Attributes:
        sensor: index in `Sensing.sensors`.
        emitter: index in `Sensing.emitters`.
        number: the sensor's count of its measurements: that of the instant, whatever was heard.
        distance_m: true one.
        mean_power_dbm: of the signal, by the link budget.
        shadowing_db: what shadowing, and a drawn line of sight, add to it.
        fading_db: what fading adds.
        reading_dbm: with the receiver's noise, to 0.001 dB; NaN if there was no signal to read.
        power_dbm: as reported, in the sensor's steps; NaN if it was not reported.
        outcome: index into OUTCOMES, uint8.
    """

    sensor: NDArray[np.intp]
    emitter: NDArray[np.intp]
    number: NDArray[np.int64]
    distance_m: FloatArray
    mean_power_dbm: FloatArray
    shadowing_db: FloatArray
    fading_db: FloatArray
    reading_dbm: FloatArray
    power_dbm: FloatArray
    outcome: NDArray[np.uint8]

    @property
    def size(self) -> int:
        """How many measurements."""
        return len(self.sensor)


def blank(sensor: NDArray[np.intp], emitter: NDArray[np.intp], number: NDArray[np.int64]) -> Measured:
    """Return measurements without numbers."""
    distance, mean, shadowing, fading, reading, power = np.full((6, len(sensor)), np.nan)
    outcome = np.full(len(sensor), NO_POSITION, dtype=np.uint8)
    return Measured(sensor, emitter, number, distance, mean, shadowing, fading, reading, power, outcome)


_NONE = np.zeros(0, dtype=np.intp)
NOTHING = blank(_NONE, _NONE, np.zeros(0, dtype=np.int64))
