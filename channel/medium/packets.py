"""Packets and what becomes of them, as columns."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from channel.checks import FloatArray

EVERYBODY = -1


class Packets(NamedTuple):
    """Packets as columns."""

    sim_time_ns: NDArray[np.int64]
    tx: NDArray[np.intp]
    seq: NDArray[np.int64]
    length_bytes: NDArray[np.int64]
    to: NDArray[np.intp]


@dataclass(frozen=True, slots=True)
class Receptions:
    """Fates as columns."""

    packets: Packets
    packet: NDArray[np.intp]
    rx: NDArray[np.intp]
    distance_m: FloatArray
    received_power_dbm: FloatArray
    snr_db: FloatArray
    per: FloatArray
    probability_of_delivery: FloatArray
    fate: NDArray[np.uint8]
