"""Two rays over flat ground: the direct one and the one that the ground reflects."""

from __future__ import annotations

import math
from typing import ClassVar, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from channel.checks import FloatArray
from channel.geometry import Path
from channel.numbers.units import SPEED_OF_LIGHT_MPS, ratio_from_db, wavelength_m
from channel.propagation.path_loss import PathLossModel, friis_db

TWO_PI_EPSILON_0 = 2.0 * math.pi * 8.8541878188e-12
LOWEST_AMPLITUDE = 1e-10
"""Of both rays together against the direct one: nulls are held above -200 dB."""


class Rays(NamedTuple):
    """Geometry of the reflected ray.

    Attributes:
        length_m: of the reflected ray, over the ground and back up.
        longer_m: how much longer it is than the direct one.
        sine: of the grazing angle at the ground.
    """

    length_m: FloatArray
    longer_m: FloatArray
    sine: FloatArray


def rays_of(path: Path) -> Rays:
    """Return the reflected ray over flat ground: the receiver is seen as far below the ground as it is above."""
    product = 4.0 * np.multiply(path.height_tx_m, path.height_rx_m)
    length_m = np.sqrt(np.square(path.distance_m) + product)
    sine = np.minimum(np.add(path.height_tx_m, path.height_rx_m) / length_m, 1.0)
    return Rays(length_m, product / (length_m + path.distance_m), sine)


class TwoRay(PathLossModel):
    """Direct and ground-reflected ray, added with their phases.

    L = free space - 20 log10 |1 + G rho g d/r exp(-2 pi i (r - d) / lambda)|: d and r the lengths of the two rays, G
    Fresnel's reflection coefficient of the ground (Rappaport, eq. 4.19 to 4.26; permittivity eps - i sigma / (2 pi f
    eps0)), rho = exp(-8 (pi s sin(psi) / lambda)^2) what roughness s leaves of it (Ament 1953; Rappaport, eq. 4.62),
    psi the grazing angle, g the two antennas' amplitude gain along the reflected ray over that along the direct one.

    Flat ground, plane waves: heights above ground over a wavelength, roughness small against them.
    """

    by_rays: ClassVar[bool] = True
    has_ground: ClassVar[bool] = True
    model: Literal["two-ray"] = "two-ray"
    polarisation: Literal["vertical", "horizontal"] = Field(default="vertical", description="of the antennas")
    ground_permittivity: float = Field(default=15.0, ge=1.0, le=100.0, description="relative; ITU-R P.527")
    ground_conductivity_s_per_m: float = Field(default=0.005, ge=0.0, le=10.0)
    roughness_m: float = Field(
        default=0.0, ge=0.0, le=10.0, description="standard deviation of the ground's height"
    )

    def path_loss_db(self, path: Path) -> FloatArray:
        """Return the loss, dB; below free space where the rays add."""
        rays = rays_of(path)
        turn = 2.0 * math.pi / wavelength_m(path.frequency_hz)
        weight = self.reflection(rays.sine, path.frequency_hz) * (path.distance_m / rays.length_m)
        if path.reflected_gain_db is not None:
            weight = weight * np.sqrt(ratio_from_db(path.reflected_gain_db))
        together = np.abs(1.0 + weight * np.exp(-1j * (turn * rays.longer_m)))
        return np.asarray(
            friis_db(path.distance_m, path.frequency_hz)
            - 20.0 * np.log10(np.maximum(together, LOWEST_AMPLITUDE))
        )

    def reflection(self, sine: FloatArray, frequency_hz: FloatArray | float) -> NDArray[np.complex128]:
        """Return the coherent reflection coefficient of the ground at a grazing angle's sine."""
        loss = self.ground_conductivity_s_per_m / np.multiply(TWO_PI_EPSILON_0, frequency_hz)
        ground = self.ground_permittivity - 1j * loss
        root = np.sqrt(ground - (1.0 - np.square(sine)))
        upright = ground * sine if self.polarisation == "vertical" else sine
        phase = math.pi * self.roughness_m * sine * np.divide(frequency_hz, SPEED_OF_LIGHT_MPS)
        return np.asarray((upright - root) / (upright + root) * np.exp(-8.0 * np.square(phase)))


class TwoSlope(PathLossModel):
    """The two rays' envelope without interference: free space up to a crossover, h1^2 h2^2 / d^4 beyond it.

    Crossover at d = 4 pi h1 h2 / lambda (Rappaport, eq. 4.52 and 4.53). Both parts and the crossover take the
    slant distance, as ns-3's two-ray ground model does. At the crossover itself the law steps by nothing.
    """

    has_ground: ClassVar[bool] = True
    model: Literal["two-slope"] = "two-slope"

    def path_loss_db(self, path: Path) -> FloatArray:
        """Return the loss, dB."""
        product = np.multiply(path.height_tx_m, path.height_rx_m)
        crossover_m = 4.0 * math.pi * product * np.divide(path.frequency_hz, SPEED_OF_LIGHT_MPS)
        beyond = 40.0 * np.log10(path.distance_m) - 20.0 * np.log10(product)
        return np.where(path.distance_m <= crossover_m, friis_db(path.distance_m, path.frequency_hz), beyond)
