"""Diffraction over the bulge of a smooth spherical Earth (ITU-R P.526-15, sections 3.1.1 and 3.2)."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from channel.checks import FloatArray
from channel.geometry import Path
from channel.numbers.units import wavelength_m
from channel.propagation.diffraction import EARTH_RADIUS_M

NEAR = 0.03
"""Of the distance of the horizon: up to here the bulge changes less than 0.05 dB, and is left out."""
PERMITTIVITY, CONDUCTIVITY_S_PER_M = 15.0, 0.005
"""Average ground (ITU-R P.527), in vertical polarisation: both matter to antennas near the ground only."""


class Bulge(NamedTuple):
    """What the bulge makes of links: `share` of the way's law gives place to `loss_db` over free space."""

    share: FloatArray
    loss_db: FloatArray


def bulge_of(path: Path, radius_factor: float) -> Bulge | None:
    """Return what the bulge of the Earth makes of links; None if nothing anywhere.

    At the horizon and beyond, the share is 1 and the loss that of sec. 3.1.1. Inside it is sec. 3.2: the loss A at the
    horizon of an Earth so small that the ends just see each other counts by the share 1 - h / h0 of the clearance h0
    that is missing; less that share over a flat Earth, which is the propagation law's, by 1 - (D / horizon)^2.

    Args:
        path: the links.
        radius_factor: k, of the Earth's radius, by which the air bends rays: 4/3 in a standard atmosphere.
    """
    radius_m = radius_factor * EARTH_RADIUS_M
    if _all_are_near(path, radius_m):
        return None
    tx_m, rx_m = np.asarray(path.height_tx_m), np.asarray(path.height_rx_m)
    ground_m = np.maximum(path.ground_distance_m, 1e-3)
    wave_m = wavelength_m(path.frequency_hz)
    roots = np.sqrt(tx_m) + np.sqrt(rx_m)
    horizon_m = math.sqrt(2.0 * radius_m) * roots
    is_near = ground_m <= NEAR * horizon_m
    if np.all(is_near):
        return None
    inside = ground_m < horizon_m
    counted_m = np.where(inside, 0.5 * np.square(ground_m / roots), radius_m)  # eq. 24
    loss_db = np.maximum(beyond_horizon_db(ground_m, tx_m, rx_m, wave_m, counted_m), 0.0)
    missing = missing_share(ground_m, tx_m, rx_m, wave_m, radius_m)
    flat = missing_share(ground_m, tx_m, rx_m, wave_m, np.inf) * (1.0 - np.square(ground_m / horizon_m))
    share = np.where(inside, np.maximum(missing - flat, 0.0), 1.0)
    return Bulge(np.where(is_near, 0.0, share), loss_db)


def beyond_horizon_db(
    ground_m: FloatArray, tx_m: FloatArray, rx_m: FloatArray, wave_m: FloatArray | float, radius_m: FloatArray
) -> FloatArray:
    """Return the loss over free space at the horizon and beyond, dB: the first term of the residue series.

    ITU-R P.526-15, sec. 3.1.1, eq. 11 to 18, in vertical polarisation over average ground.
    """
    admittance = _admittance(radius_m, wave_m)
    square = np.square(admittance)
    beta = (1.0 + 1.6 * square + 0.67 * square**2) / (1.0 + 4.5 * square + 1.53 * square**2)
    x = beta * ground_m * np.cbrt(math.pi / (wave_m * np.square(radius_m)))
    per_m = 2.0 * beta * np.cbrt(math.pi**2 / (np.square(wave_m) * radius_m))
    least_db = 2.0 + 20.0 * np.log10(admittance)
    heights_db = [np.maximum(_height_gain_db(beta * per_m * height_m), least_db) for height_m in (tx_m, rx_m)]
    return np.asarray(-_distance_db(x) - heights_db[0] - heights_db[1])


def missing_share(
    ground_m: FloatArray, tx_m: FloatArray, rx_m: FloatArray, wave_m: FloatArray | float, radius_m: float
) -> FloatArray:
    """Return 1 - h / h0, h the least clearance of the ray inside the horizon, h0 what it takes to lose nothing.

    ITU-R P.526-15, eq. 22 and 23; 0 where there is more than enough.
    """
    both_m = tx_m + rx_m
    m = np.square(ground_m) / (4.0 * radius_m * both_m)
    c = (tx_m - rx_m) / both_m
    if radius_m == np.inf:
        b = c
    else:
        angle = np.arccos(np.clip(1.5 * c * np.sqrt(3.0 * m / (m + 1.0) ** 3), -1.0, 1.0))
        b = 2.0 * np.sqrt((m + 1.0) / (3.0 * m)) * np.cos((math.pi + angle) / 3.0)
    first_m = 0.5 * ground_m * (1.0 + b)
    second_m = ground_m - first_m
    over_tx_m = (tx_m - np.square(first_m) / (2.0 * radius_m)) * second_m
    over_rx_m = (rx_m - np.square(second_m) / (2.0 * radius_m)) * first_m
    enough_m = 0.552 * np.sqrt(first_m * second_m * wave_m / ground_m)
    return np.maximum(1.0 - (over_tx_m + over_rx_m) / (ground_m * enough_m), 0.0)


def _admittance(radius_m: FloatArray, wave_m: FloatArray | float) -> FloatArray:
    """Return K, the normalised surface admittance for vertical polarisation (eq. 11, 12)."""
    loss = 60.0 * np.multiply(wave_m, CONDUCTIVITY_S_PER_M)
    horizontal = np.cbrt(wave_m / (2.0 * math.pi * radius_m)) * np.power(
        (PERMITTIVITY - 1.0) ** 2 + loss**2, -0.25
    )
    return np.asarray(horizontal * np.sqrt(PERMITTIVITY**2 + loss**2))


def _distance_db(x: FloatArray) -> FloatArray:
    """Return F(X) (eq. 17)."""
    far = 11.0 + 10.0 * np.log10(x) - 17.6 * x
    return np.where(x >= 1.6, far, -20.0 * np.log10(x) - 5.6488 * np.power(x, 1.425))


def _height_gain_db(y: FloatArray) -> FloatArray:
    """Return G(Y) for B = beta Y (eq. 18)."""
    over = np.maximum(y - 1.1, 0.9)
    high = 17.6 * np.sqrt(over) - 5.0 * np.log10(over) - 8.0
    return np.where(y > 2.0, high, 20.0 * np.log10(y + 0.1 * y**3))


def _all_are_near(path: Path, radius_m: float) -> bool:
    """Return whether the longest way is short of the horizon even between the lowest ends: so it is in most ticks."""
    if not np.size(path.distance_m):
        return True
    tx_m, rx_m = (
        np.minimum.reduce(path.height_tx_m, axis=None),
        np.minimum.reduce(path.height_rx_m, axis=None),
    )
    edge_m = 2.0 * math.sqrt(2.0 * radius_m * min(tx_m, rx_m))
    return bool(np.maximum.reduce(path.distance_m, axis=None) <= NEAR * edge_m)
