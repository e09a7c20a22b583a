"""The joint law of two powers on one link, by draws of its own: what random terms of known correlation add to them."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from channel.checks import FloatArray
from channel.fading.laws import FadingModel, scatter_gain_db
from channel.link.radio import Radio
from channel.link.tables.steps import STEPS_PER_DB
from channel.medium.judge.correlation import Correlations
from channel.medium.judge.heard import HeardPower
from channel.numbers import special
from channel.numbers.units import SPEED_OF_LIGHT_MPS

SHADOWING, SIGHT, FADING, FADING_THERE = slice(0, 2), slice(2, 4), slice(4, 6), slice(6, 8)
"""Rows of uniform numbers."""
ROWS = 8


def changes_in_steps(
    first: HeardPower, second: HeardPower, together: Correlations, uniform: FloatArray
) -> NDArray[np.int64]:
    """Return draws of the second power less the first, as they would be written: in whole steps, shape (n,).

    Args:
        first: where and when the first is.
        second: likewise.
        together: how their terms are correlated, one number each.
        uniform: shape (ROWS, n), over the open interval (0, 1).
    """
    shadows = _normals(float(together.shadowing[0]), uniform[SHADOWING])
    sights = _normals(float(together.sight[0]), uniform[SIGHT])
    fadings = _fadings_db(first, second, float(together.fading[0]), uniform)
    steps = [
        np.rint((look.mean_dbm + _shadowed_db(look, sight, shadow) + fading_db) * STEPS_PER_DB)
        for look, shadow, sight, fading_db in zip((first, second), shadows, sights, fadings, strict=True)
    ]
    return np.asarray(steps[1] - steps[0], dtype=np.int64)


def change_in_steps(first: HeardPower, second: HeardPower) -> int:
    """Return the second power less the first as they are written."""
    return round(second.power_dbm * STEPS_PER_DB) - round(first.power_dbm * STEPS_PER_DB)


def _normals(together: float, uniform: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return two normal variables of known correlation, from two uniform ones."""
    first, other = special.ndtri(uniform)
    return first, together * first + math.sqrt(max(1.0 - together * together, 0.0)) * other


def _shadowed_db(look: HeardPower, sight: FloatArray, shadow: FloatArray) -> FloatArray:
    """Return what line of sight and shadowing add."""
    radio, is_random = look.radio, look.radio.config.shadowing.is_random
    if radio.sight is not None:
        return -radio.sight.loss_db(look.path, sight, shadow if is_random else None)
    return -radio.config.shadowing.loss_db(shadow) if is_random else np.zeros_like(shadow)


def _fadings_db(
    first: HeardPower, second: HeardPower, together: float, uniform: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return what fading adds to both."""
    radio, here, there = first.radio, uniform[FADING], uniform[FADING_THERE]
    fading = radio.config.fading
    if not fading.is_random:
        return np.zeros(here.shape[1]), np.zeros(here.shape[1])
    if fading.coherence == "doppler":
        real, imaginary = (_normals(together, np.stack(each)) for each in zip(here, there, strict=True))
        return (
            _of_scatter_db(fading, radio, first, real[0], imaginary[0]),
            _of_scatter_db(fading, radio, second, real[1], imaginary[1]),
        )
    there = here if together == 1.0 else there  # each draw lasts for a while, or not at all
    return (
        fading.gain_db(here[0], here[1], first.path.elevation_deg),
        fading.gain_db(there[0], there[1], second.path.elevation_deg),
    )


def _of_scatter_db(
    fading: FadingModel, radio: Radio, look: HeardPower, real: FloatArray, imaginary: FloatArray
) -> FloatArray:
    turns = look.path.distance_m * (radio.config.frequency_hz / SPEED_OF_LIGHT_MPS)
    direct = np.exp(2j * math.pi * (turns % 1.0)).astype(np.complex128)
    scatter = np.asarray((real + 1j * imaginary) * math.sqrt(0.5), dtype=np.complex128)
    return scatter_gain_db(fading, scatter, direct, look.path.elevation_deg)
