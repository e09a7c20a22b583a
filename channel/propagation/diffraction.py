"""Diffraction: over an edge, and over the bulge of the Earth (ITU-R P.526)."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from channel.checks import FloatArray, finite
from channel.geometry import Path
from channel.units import wavelength_m

NU_CLEAR = -0.78
"""Below this Fresnel-Kirchhoff parameter an edge costs nothing (ITU-R P.526-15, eq. 31)."""
EARTH_RADIUS_M = 6_371_000.0
NEAR = 0.03
"""Of the distance of the horizon: up to here the bulge changes less than 0.01 dB, and is left out."""
EDGES = 17
"""Places between which the worst one inside the horizon is looked for: within 0.02 dB."""


def knife_edge_loss_db(nu: ArrayLike) -> FloatArray:
    """Return J(nu) = 6.9 + 20 log10(sqrt((nu - 0.1)^2 + 1) + nu - 0.1), 0 below nu = -0.78.

    ITU-R P.526-15, eq. 31: an approximation, made for nu above -0.78. It gives 6.0 dB for a grazing ray (nu = 0),
    13.9 dB at nu = 1 and 20.5 dB at nu = 2.4.
    """
    return edge_db(finite("nu", nu))


def edge_db(nu: FloatArray) -> FloatArray:
    """Return what `knife_edge_loss_db` returns, for values that are known to be good."""
    shifted = np.maximum(nu, NU_CLEAR) - 0.1
    loss_db = 6.9 + 20.0 * np.log10(np.sqrt(shifted**2 + 1.0) + shifted)
    return np.where(np.less_equal(nu, NU_CLEAR), 0.0, loss_db)


def horizon_m(path: Path, radius_factor: float) -> FloatArray:
    """Return how far over the ground the two ends still see each other: sqrt(2 k a h1) + sqrt(2 k a h2).

    Args:
        path: the links.
        radius_factor: k, of the Earth's radius a, by which the air bends rays: 4/3 in a standard atmosphere.
    """
    diameter_m = 2.0 * radius_factor * EARTH_RADIUS_M
    return np.sqrt(np.multiply(diameter_m, path.height_tx_m)) + np.sqrt(
        np.multiply(diameter_m, path.height_rx_m)
    )


def bulge_loss_db(path: Path, radius_factor: float) -> FloatArray | None:
    """Return what the bulge of a smooth Earth costs, dB; None if nothing anywhere.

    Beyond the horizon it counts as one knife edge where the horizon rays of both ends meet (Bullington 1947; ITU-R
    P.526-15, sec. 4.5.1), inside as the worst of its points. Near by, a flat Earth takes as much of the first Fresnel
    zone, and that is the propagation law's: inside the horizon J over a flat Earth is taken off, less and less, by
    the share 1 - (D / horizon)^2. A smooth sphere attenuates more than an edge (P.526-15, sec. 3): deep behind the
    horizon the loss is too small.
    """
    if _all_are_near(path, radius_factor):
        return None
    edge_m = horizon_m(path, radius_factor)
    if np.all(path.distance_m <= NEAR * edge_m):
        return None
    ground_m = np.maximum(path.ground_distance_m, 1e-3)
    bend = 1.0 / (2.0 * radius_factor * EARTH_RADIUS_M)
    low, high = (np.asarray(each, dtype=np.float64) for each in (path.height_tx_m, path.height_rx_m))
    inside, beyond = _worst_point(ground_m, low, high, bend), _behind(ground_m, low, high, bend)
    reach = np.sqrt(2.0 / (wavelength_m(path.frequency_hz) * ground_m))
    nu = np.where(ground_m < edge_m, inside, beyond) * reach
    flat_nu = -2.0 * np.sqrt(low * high) * reach
    near = np.maximum(1.0 - np.square(ground_m / edge_m), 0.0)
    loss_db = np.maximum(edge_db(nu) - near * edge_db(flat_nu), 0.0)
    return np.where(path.distance_m <= NEAR * edge_m, 0.0, loss_db)


def _all_are_near(path: Path, radius_factor: float) -> bool:
    """Return whether the longest way is short of the horizon even between the lowest ends: so it is in most ticks."""
    if not np.size(path.distance_m):
        return True
    tx_m, rx_m = (
        np.minimum.reduce(path.height_tx_m, axis=None),
        np.minimum.reduce(path.height_rx_m, axis=None),
    )
    edge_m = 2.0 * math.sqrt(2.0 * radius_factor * EARTH_RADIUS_M * min(tx_m, rx_m))
    return bool(np.maximum.reduce(path.distance_m, axis=None) <= NEAR * edge_m)


def _worst_point(ground_m: FloatArray, tx_m: FloatArray, rx_m: FloatArray, bend: float) -> FloatArray:
    """Return the largest of h / sqrt(t (1 - t)), h the height of the bulge over the ray at the share t of the way.

    With u = sqrt(t / (1 - t)) it is bend D^2 u / (1 + u^2) - h1 / u - h2 u: its peak lies between 1, the middle, and
    sqrt(h1 / h2), the peak over a flat Earth.
    """
    shares = np.linspace(0.0, 1.0, EDGES)
    u = np.exp(0.5 * np.log(tx_m / rx_m)[..., np.newaxis] * shares)
    ground, tx, rx = (each[..., np.newaxis] for each in (np.asarray(ground_m), tx_m, rx_m))
    return np.asarray(np.max(bend * ground**2 * u / (1.0 + u**2) - tx / u - rx * u, axis=-1))


def _behind(ground_m: FloatArray, tx_m: FloatArray, rx_m: FloatArray, bend: float) -> FloatArray:
    """Return h / sqrt(t (1 - t)) of the place where the horizon rays of both ends meet."""
    rise_tx = bend * ground_m - 2.0 * np.sqrt(bend * tx_m)
    rise_rx = bend * ground_m - 2.0 * np.sqrt(bend * rx_m)
    both = np.maximum(rise_tx + rise_rx, 1e-12)
    share = np.clip((rx_m - tx_m + rise_rx * ground_m) / (both * ground_m), 1e-6, 1.0 - 1e-6)
    over_m = rise_tx * share * ground_m - share * (rx_m - tx_m)
    return np.asarray(over_m / np.sqrt(share * (1.0 - share)))


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
