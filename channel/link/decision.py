"""From powers to what a receiver gets of a packet: the numbers that are written down and that decide its fate."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from channel.checks import FloatArray
from channel.link.radio import Radio
from channel.link.tables.lengths import Lengths
from channel.link.tables.steps import STEPS_PER_DB, STEPS_PER_M, in_steps


class Signal(NamedTuple):
    """One packet or many at receivers; all fields broadcast against each other.

    Attributes:
        distance_m: to 1 mm.
        received_power_dbm: with the drawn shadowing and fading, to 0.001 dB.
        snr_db: likewise, to 0.001 dB.
        per: packet error rate at that SNR, to 1e-7; 1 beyond the radio's range.
    """

    distance_m: FloatArray
    received_power_dbm: FloatArray
    snr_db: FloatArray
    per: FloatArray


def signal_of(
    radio: Radio,
    distance_m: FloatArray,
    power_dbm: FloatArray,
    noise_dbm: FloatArray | float,
    lengths: Lengths,
) -> Signal:
    """Return what receivers get, rounded (see `steps`): the error rate is that of the rounded SNR.

    Args:
        radio: whose range and error model count.
        distance_m: between the ends.
        power_dbm: with the drawn shadowing and fading.
        noise_dbm: noise floor and interference.
        lengths: as the error model counts them.
    """
    snr_db = in_steps(power_dbm - noise_dbm, STEPS_PER_DB)
    per = radio.per_in_steps(snr_db, lengths)
    if math.isfinite(radio.max_range_m):
        per = np.where(radio.in_range(distance_m), per, 1.0)
    return Signal(in_steps(distance_m, STEPS_PER_M), in_steps(power_dbm, STEPS_PER_DB), snr_db, per)
