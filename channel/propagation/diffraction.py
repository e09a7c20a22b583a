"""Diffraction: over an edge, and over the bulge of the Earth (ITU-R P.526)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from channel.checks import FloatArray, finite
from channel.geometry import Path
from channel.units import wavelength_m

NU_CLEAR = -0.78
"""Below this Fresnel-Kirchhoff parameter an edge costs nothing (ITU-R P.526-15, eq. 31)."""
EARTH_RADIUS_M = 6_371_000.0
NEAR = 0.03
"""Of the distance of the horizon: up to here the bulge changes less than 0.005 dB, and is left out."""
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
    """Return what the curvature of a smooth Earth costs over a flat one, dB; None if nothing anywhere.

    Beyond the horizon the bulge counts as one knife edge where the horizon rays of both ends meet (Bullington 1947;
    ITU-R P.526-15, sec. 4.5.1), inside as the worst of its points. The loss over a flat Earth at the same
    heights, which is the propagation law's, is taken off. A smooth sphere attenuates more than an edge (P.526-15, sec.
    3): deep behind the horizon the loss is too small.
    """
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
    loss_db = np.maximum(edge_db(nu) - edge_db(flat_nu), 0.0)
    return np.where(path.distance_m <= NEAR * edge_m, 0.0, loss_db)


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
