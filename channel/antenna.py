"""Antennas: gain in the direction of the other end, in the aircraft's attitude.

Body axes are forward, right, down. Azimuth is from forward to the right, elevation is up, both in degrees.
"""

from __future__ import annotations

import math
from functools import cached_property
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from channel.checks import FloatArray
from channel.numbers.units import db_from_ratio, ratio_from_db
from channel.variant import Variant
from sitl_configs.settings import Settings

DIPOLE_PEAK = 1.640922
"""Directivity of a half-wave dipole, 2.151 dBi (Balanis, Antenna Theory, sec. 4.6)."""
PEAK_DB = 10.0 * math.log10(DIPOLE_PEAK)


Vector = tuple[FloatArray, FloatArray, FloatArray]
"""Its components, each of one shape."""


class AntennaModel(Protocol):
    """A gain pattern in the body frame."""

    @property
    def needs_direction(self) -> bool:
        """Whether the gain depends on where the other end is."""
        ...

    def towards_db(self, direction_frd: FloatArray, /) -> FloatArray | float:
        """Return the gain in dB towards unit vectors in body axes, shape (..., 3) -> (...)."""
        ...


class Isotropic(Variant):
    """The same gain in every direction, whatever the attitude."""

    model: Literal["isotropic"] = "isotropic"
    gain_db: float = Field(default=0.0, ge=-100.0, le=100.0)

    @property
    def needs_direction(self) -> bool:
        """False."""
        return False

    def towards_db(self, _direction_frd: FloatArray, /) -> float:
        """Return the gain as configured."""
        return self.gain_db


class _Directed(Variant):
    """What directed antennas share."""

    @property
    def needs_direction(self) -> bool:
        """True."""
        return True


class HalfWaveDipole(_Directed):
    """A half-wave dipole along the body's vertical (Balanis, eq. 4-84): 2.15 dB abeam, nothing along its axis."""

    model: Literal["dipole"] = "dipole"
    loss_db: float = Field(default=0.0, ge=0.0, le=60.0, description="of feeder and matching")
    null_depth_db: float = Field(
        default=30.0, ge=0.0, le=200.0, description="how deep the nulls get below the peak"
    )

    def towards_db(self, direction_frd: FloatArray, /) -> FloatArray:
        """Return 10 log10(1.64 (cos(pi/2 cos t) / sin t)^2) for the angle t from the axis."""
        along = np.minimum(np.abs(direction_frd[..., 2]), 1.0)
        field = np.cos(0.5 * np.pi * along)
        pattern = field * field / np.maximum(1.0 - along * along, 1e-12)
        depth = np.maximum(db_from_ratio(np.maximum(pattern, 1e-30)), -self.null_depth_db)
        return depth + (PEAK_DB - self.loss_db)


class Sector(_Directed):
    """A sector antenna: -12 (angle / beamwidth)^2 dB in azimuth and elevation (3GPP TR 36.814, table A.2.1.1-2).

    Each falls no further than its own limit, and both together no further than `front_to_back_db`.
    """

    model: Literal["sector"] = "sector"
    gain_db: float = Field(default=14.0, ge=-100.0, le=100.0, description="in the middle of the sector")
    azimuth_deg: float = Field(default=0.0, ge=-360.0, le=360.0, description="from forward to the right")
    elevation_deg: float = Field(default=0.0, ge=-90.0, le=90.0, description="up")
    azimuth_beamwidth_deg: float = Field(default=70.0, gt=0.0, le=360.0, description="at -3 dB")
    elevation_beamwidth_deg: float = Field(default=10.0, gt=0.0, le=180.0, description="at -3 dB")
    front_to_back_db: float = Field(
        default=25.0, ge=0.0, le=200.0, description="how far the gain falls at most"
    )

    side_lobe_db: float = Field(
        default=20.0, ge=0.0, le=200.0, description="how far it falls at most above and below the beam"
    )

    def towards_db(self, direction_frd: FloatArray, /) -> FloatArray:
        """Return the gain, dB."""
        azimuth, elevation = azimuth_elevation_deg(direction_frd)
        off = (azimuth - self.azimuth_deg + 180.0) % 360.0 - 180.0
        across = np.minimum(12.0 * (off / self.azimuth_beamwidth_deg) ** 2, self.front_to_back_db)
        tilt = (elevation - self.elevation_deg) / self.elevation_beamwidth_deg
        upright = np.minimum(12.0 * tilt**2, self.side_lobe_db)
        return np.asarray(self.gain_db - np.minimum(across + upright, self.front_to_back_db))


class Pattern(_Directed):
    """A measured pattern: rows of azimuth, elevation, gain on a full grid; bilinear in between.

    Azimuths wrap around; elevations beyond the grid count as its border.
    """

    model: Literal["pattern"] = "pattern"
    pattern: tuple[tuple[float, float, float], ...] = Field(
        min_length=1, description="rows of azimuth_deg, elevation_deg, gain_db; or pattern_file, a CSV"
    )

    @model_validator(mode="after")
    def _is_a_grid(self) -> Pattern:
        rows = np.asarray(self.pattern)
        azimuths, elevations = np.unique(rows[:, 0]), np.unique(rows[:, 1])
        if len(rows) != len(azimuths) * len(elevations) or len(np.unique(rows[:, :2], axis=0)) != len(rows):
            raise ValueError("the rows have to be a full grid of azimuths by elevations, each once")
        if max(-elevations[0], elevations[-1]) > 90.0:
            raise ValueError("elevations have to be from -90 to 90 degrees: they count from the horizon, up")
        if azimuths[-1] - azimuths[0] >= 360.0:
            raise ValueError("azimuths have to span less than 360 degrees: the pattern wraps around")
        return self

    @cached_property
    def _table(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Azimuths, the first again after a full turn; elevations; gains in dB, shape (azimuths, elevations)."""
        rows = np.asarray(self.pattern)
        azimuths, elevations = np.unique(rows[:, 0]), np.unique(rows[:, 1])
        grid = rows[np.lexsort((rows[:, 1], rows[:, 0])), 2].reshape(len(azimuths), len(elevations))
        return np.append(azimuths, azimuths[0] + 360.0), elevations, np.concatenate((grid, grid[:1]))

    def towards_db(self, direction_frd: FloatArray, /) -> FloatArray:
        """Return the gain, dB."""
        azimuths, elevations, grid = self._table
        azimuth, elevation = azimuth_elevation_deg(direction_frd)
        i, u = _cell(azimuths, (azimuth - azimuths[0]) % 360.0 + azimuths[0])
        if len(elevations) == 1:
            return np.asarray(grid[i, 0] * (1.0 - u) + grid[i + 1, 0] * u)
        j, v = _cell(elevations, np.clip(elevation, elevations[0], elevations[-1]))
        low = grid[i, j] * (1.0 - v) + grid[i, j + 1] * v
        high = grid[i + 1, j] * (1.0 - v) + grid[i + 1, j + 1] * v
        return np.asarray(low * (1.0 - u) + high * u)


class Polarisation(Settings):
    """Loss between two linearly polarised antennas along the bodies' verticals, with finite cross-polar discrimination.

    The field of each goes as the part a of its axis across the way. The share of power that arrives is
    ((a1 . a2)^2 + q) / (|a1|^2 |a2|^2 + q), q = X / (1 - X), X = 10^(-cross_polar_db / 10): X + (1 - X) cos^2 where
    both are seen from abeam; without a jump where one is seen along its axis and has no direction of its own.
    """

    cross_polar_db: float = Field(
        default=20.0, ge=0.01, le=100.0, description="the loss is never more than this"
    )

    def loss_db(
        self, attitude_tx_wxyz: FloatArray, attitude_rx_wxyz: FloatArray, way_ned: FloatArray
    ) -> FloatArray:
        """Return the loss in dB for attitudes of shape (..., 4) and unit vectors from tx to rx, shape (..., 3)."""
        tx, rx = _down_axis(attitude_tx_wxyz), _down_axis(attitude_rx_wxyz)
        way = way_ned[..., 0], way_ned[..., 1], way_ned[..., 2]
        along_tx, along_rx = _dot(tx, way), _dot(rx, way)
        leak = float(ratio_from_db(-self.cross_polar_db))
        leak /= 1.0 - leak
        together = np.square(_dot(tx, rx) - along_tx * along_rx)  # of the parts across the way
        both = (1.0 - along_tx * along_tx) * (1.0 - along_rx * along_rx)
        return np.asarray(np.maximum(db_from_ratio((both + leak) / (together + leak)), 0.0))


def rotate(attitude_wxyz: FloatArray, vector: FloatArray) -> FloatArray:
    """Return vectors of body axes in the north-east-down frame; both broadcast, shapes (..., 4) and (..., 3)."""
    w, x, y, z = (attitude_wxyz[..., k] for k in range(4))
    a, b, c = (vector[..., k] for k in range(3))
    p, q, r = 2.0 * (y * c - z * b), 2.0 * (z * a - x * c), 2.0 * (x * b - y * a)
    turned = (a + w * p + y * r - z * q, b + w * q + z * p - x * r, c + w * r + x * q - y * p)
    return np.stack(turned, axis=-1)


def to_body(attitude_wxyz: FloatArray, vector_ned: FloatArray) -> FloatArray:
    """Return vectors of the north-east-down frame in body axes."""
    return rotate(attitude_wxyz * np.array([1.0, -1.0, -1.0, -1.0]), vector_ned)


def azimuth_elevation_deg(direction_frd: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return azimuth (forward to right) and elevation (up) of unit vectors in body axes, degrees."""
    azimuth = np.degrees(np.arctan2(direction_frd[..., 1], direction_frd[..., 0]))
    return np.asarray(azimuth), np.degrees(np.arcsin(np.clip(-direction_frd[..., 2], -1.0, 1.0)))


def _cell(grid: FloatArray, value: FloatArray) -> tuple[NDArray[np.intp], FloatArray]:
    index = np.clip(np.searchsorted(grid, value, side="right") - 1, 0, len(grid) - 2)
    return index, (value - grid[index]) / (grid[index + 1] - grid[index])


def _down_axis(attitude_wxyz: FloatArray) -> Vector:
    """Return where the body's down axis points, in north-east-down."""
    w, x, y, z = (attitude_wxyz[..., k] for k in range(4))
    return 2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)


def _dot(a: Vector, b: Vector) -> FloatArray:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
