"""Diffraction over edges (ITU-R P.526); over the smooth Earth: `spherical_earth`."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from channel.checks import FloatArray

NU_CLEAR = -0.78
"""Below this Fresnel-Kirchhoff parameter an edge costs nothing (ITU-R P.526-15, eq. 31)."""
EARTH_RADIUS_M = 6_371_000.0


def edge_db(nu: FloatArray) -> FloatArray:
    """Return J(nu) = 6.9 + 20 log10(sqrt((nu - 0.1)^2 + 1) + nu - 0.1), 0 below nu = -0.78.

    ITU-R P.526-15, eq. 31: an approximation, made for nu above -0.78. It gives 6.0 dB for a grazing ray (nu = 0),
    13.9 dB at nu = 1 and 20.5 dB at nu = 2.4.
    """
    shifted = np.maximum(nu, NU_CLEAR) - 0.1
    loss_db = 6.9 + 20.0 * np.log10(np.sqrt(shifted**2 + 1.0) + shifted)
    return np.where(np.less_equal(nu, NU_CLEAR), 0.0, loss_db)


class Profile(NamedTuple):
    """Ground between the ends of links; the last axis goes along the way, the ends themselves left out.

    Attributes:
        length_m: of the ways over the ground, shape (...).
        along_m: how far from the transmitter each point is, shape (..., points).
        height_m: of the ground there, the Earth's bulge with it.
        is_point: which points count.
    """

    length_m: FloatArray
    along_m: FloatArray
    height_m: FloatArray
    is_point: NDArray[np.bool_]


def bulge_m(along_m: FloatArray, length_m: FloatArray, radius_factor: float | None) -> FloatArray:
    """Return how far the Earth bulges over the straight line between the ends of a way, m; 0 for a flat Earth."""
    if radius_factor is None:
        return np.zeros(np.broadcast_shapes(along_m.shape, length_m.shape))
    return along_m * (length_m - along_m) / (2.0 * radius_factor * EARTH_RADIUS_M)


def worst_nu(profile: Profile, tx_m: FloatArray, rx_m: FloatArray, wave_m: FloatArray | float) -> FloatArray:
    """Return the largest Fresnel-Kirchhoff parameter h sqrt(2 d / (lambda d1 d2)) along each way.

    Args:
        profile: the ground.
        tx_m: heights of the transmitting antennas, above the same level as the ground's.
        rx_m: of the receiving ones.
        wave_m: wavelengths.
    """
    length = profile.length_m[..., np.newaxis]
    share = profile.along_m / length
    over_m = profile.height_m - _column(tx_m) * (1.0 - share) - _column(rx_m) * share
    nu = over_m * np.sqrt(2.0 / (_column(wave_m) * length * share * (1.0 - share)))
    return np.asarray(np.max(np.where(profile.is_point, nu, -np.inf), axis=-1))


def bullington_db(
    profile: Profile, tx_m: FloatArray, rx_m: FloatArray, wave_m: FloatArray | float
) -> FloatArray:
    """Return the loss over all edges of the ground by Bullington's construction, dB (ITU-R P.526-15, sec. 4.5.1).

    With a line of sight the worst edge counts; without one, the edge where the horizon rays of both ends meet. Its
    loss J becomes J + (1 - exp(-J / 6)) (10 + 0.02 D), D the length of the way in km. Arguments as of `worst_nu`.
    """
    length, start, end = profile.length_m, np.asarray(tx_m), np.asarray(rx_m)
    to_end = length[..., np.newaxis] - profile.along_m
    rise_tx = _steepest(profile, profile.height_m - _column(start), profile.along_m)
    rise_rx = _steepest(profile, profile.height_m - _column(end), to_end)
    hidden = rise_tx >= (end - start) / length
    both = np.where(hidden, rise_tx + rise_rx, 1.0)
    share = np.clip(
        np.where(hidden, (end - start + rise_rx * length) / (both * length), 0.5), 1e-6, 1.0 - 1e-6
    )
    over_m = rise_tx * share * length - (end - start) * share
    behind = over_m * np.sqrt(2.0 / (wave_m * length * share * (1.0 - share)))
    edge = edge_db(np.where(hidden, behind, worst_nu(profile, start, end, wave_m)))
    return np.asarray(edge + (1.0 - np.exp(-edge / 6.0)) * (10.0 + 2e-5 * length))


def _steepest(profile: Profile, over_m: FloatArray, away_m: FloatArray) -> FloatArray:
    slopes = over_m / np.where(profile.is_point, away_m, 1.0)
    return np.asarray(np.max(np.where(profile.is_point, slopes, -np.inf), axis=-1))


def _column(value: FloatArray | float) -> FloatArray:
    return np.asarray(value)[..., np.newaxis]
