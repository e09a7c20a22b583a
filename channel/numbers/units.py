"""Conversions between decibel, dBm and linear units, and the constants of radio work."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from channel.checks import FloatArray

SPEED_OF_LIGHT_MPS = 299_792_458.0
"""Exact, by definition of the metre."""

BOLTZMANN_J_PER_K = 1.380649e-23
"""Exact, by definition of the kelvin."""

MW_PER_W = 1000.0
LN10_OVER_10 = math.log(10.0) / 10.0


def ratio_from_db(value_db: ArrayLike) -> FloatArray:
    """Return 10^(x/10): a power ratio from decibel, any shape."""
    return np.exp(np.multiply(value_db, LN10_OVER_10))


def db_from_ratio(ratio: ArrayLike) -> FloatArray:
    """Return 10 log10(x): decibel from a power ratio > 0, any shape."""
    return np.multiply(np.log10(ratio), 10.0)


def watt_from_dbm(power_dbm: ArrayLike) -> FloatArray:
    """Return watt from dBm: 0.001 * 10^(x/10) (Moon et al. 2020, eq. 8)."""
    return np.divide(ratio_from_db(power_dbm), MW_PER_W)


def dbm_from_watt(power_w: ArrayLike) -> FloatArray:
    """Return dBm from watt > 0."""
    return db_from_ratio(np.multiply(power_w, MW_PER_W))


def wavelength_m(frequency_hz: ArrayLike) -> FloatArray:
    """Return the free-space wavelength in metre of a frequency in hertz."""
    return np.divide(SPEED_OF_LIGHT_MPS, frequency_hz)
