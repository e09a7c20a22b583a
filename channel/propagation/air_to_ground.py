"""Path loss between the air and the ground, by the probability of a line of sight."""

from __future__ import annotations

import math
from typing import ClassVar, Literal

import numpy as np
from pydantic import Field

from channel.checks import FloatArray
from channel.geometry import Path
from channel.propagation.path_loss import friis_db, spreading_db
from channel.validity import RangedVariant

HZ_PER_GHZ = 1e9

AL_HOURANI = {
    "suburban": (4.88, 0.43, 0.1, 21.0),
    "urban": (9.61, 0.16, 1.0, 20.0),
    "dense-urban": (12.08, 0.11, 1.6, 23.0),
    "highrise": (27.23, 0.08, 2.3, 34.0),
}
"""a, b, excess loss with and without line of sight in dB (Al-Hourani et al. 2014, table II)."""


class AlHourani(RangedVariant):
    """Free space plus an excess loss, averaged over the probability of a line of sight by elevation angle.

    Al-Hourani, Kandeepan, Lardner, "Optimal LAP altitude for maximum coverage", IEEE Wireless Commun. Lett. 3
    (2014), eq. 3 to 5. Made for 700 to 5800 MHz and one end on the ground.
    """

    model: Literal["al-hourani"] = "al-hourani"
    environment: Literal["suburban", "urban", "dense-urban", "highrise"] = Field(default="suburban")

    def line_of_sight_probability(self, path: Path) -> FloatArray:
        """Return 1 / (1 + a exp(-b (elevation - a))), elevation in degrees."""
        a, b, _, _ = AL_HOURANI[self.environment]
        return np.asarray(1.0 / (1.0 + a * np.exp(-b * (path.elevation_deg - a))))

    def path_loss_db(self, path: Path) -> FloatArray:
        """Return the mean over both states, in dB."""
        frequency_hz = self.within("frequency_hz", path.frequency_hz, 700e6, 5800e6)
        self.within("height of the lower end", np.minimum(path.height_tx_m, path.height_rx_m), 0.0, 10.0)
        _, _, with_sight_db, without_db = AL_HOURANI[self.environment]
        sight = self.line_of_sight_probability(path)
        return friis_db(path.distance_m, frequency_hz) + sight * with_sight_db + (1.0 - sight) * without_db


class _AerialVehicle(RangedVariant):
    """What the aerial scenarios of TR 36.777 share: the higher end is the aircraft."""

    heights_m: ClassVar[tuple[float, float]]
    farthest_m: ClassVar[float]
    """Validity: heights of the aircraft, and distance over the ground."""
    line_of_sight: Literal["expected", "always", "never"] = Field(
        default="expected", description="mean in dB over both states, or one of them"
    )

    def line_of_sight_probability(self, path: Path) -> FloatArray:
        """Return the probability of a line of sight (TR 36.777, table B-1)."""
        raise NotImplementedError

    def _states_db(self, path: Path, height_m: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the losses with and without line of sight."""
        raise NotImplementedError

    def path_loss_db(self, path: Path) -> FloatArray:
        """Return the loss, dB."""
        inside, height_m = self._inside(path)
        with_sight, without = self._states_db(inside, height_m)
        weight = {"always": 1.0, "never": 0.0}.get(self.line_of_sight)
        sight = self.line_of_sight_probability(inside) if weight is None else weight
        loss_db = sight * with_sight + (1.0 - sight) * without
        return np.asarray(loss_db + spreading_db(path.distance_m, inside.distance_m))

    def _inside(self, path: Path) -> tuple[Path, FloatArray]:
        """Return the path and the aircraft's height to count with."""
        height_m = self.within("height of the aircraft", _aircraft_height(path), *self.heights_m)
        ground_m = self.within("ground distance", path.ground_distance_m, 0.0, self.farthest_m)
        if self.outside != "clamp":
            return path, height_m
        drop_m = np.subtract(path.height_tx_m, path.height_rx_m)
        nearer_m = np.sqrt(np.square(ground_m) + np.square(drop_m))
        return path._replace(distance_m=np.minimum(path.distance_m, nearer_m)), height_m


class UmaAv(_AerialVehicle):
    """Urban macro cell to an aircraft: 3GPP TR 36.777 V15.0.0, annex B, UMa-AV. Height 22.5 to 300 m, up to 4 km."""

    heights_m: ClassVar[tuple[float, float]] = (22.5, 300.0)
    farthest_m: ClassVar[float] = 4000.0
    model: Literal["uma-av"] = "uma-av"

    def line_of_sight_probability(self, path: Path) -> FloatArray:
        """Return 1 above 100 m, else by ground distance and height."""
        height = np.maximum(_aircraft_height(path), 22.5)
        near = np.maximum(460.0 * np.log10(height) - 700.0, 18.0)
        far = 4300.0 * np.log10(height) - 3800.0
        return np.where(height > 100.0, 1.0, _sight(path.ground_distance_m, near, far))

    def _states_db(self, path: Path, height_m: FloatArray) -> tuple[FloatArray, FloatArray]:
        f_ghz = np.divide(path.frequency_hz, HZ_PER_GHZ)
        log_d = np.log10(path.distance_m)
        with_sight = 28.0 + 22.0 * log_d + 20.0 * np.log10(f_ghz)
        slope = 46.0 - 7.0 * np.log10(np.clip(height_m, 22.5, 100.0))
        without = -17.5 + slope * log_d + 20.0 * np.log10(40.0 * math.pi * f_ghz / 3.0)
        return np.asarray(with_sight), np.asarray(np.maximum(without, with_sight))


class RmaAv(_AerialVehicle):
    """Rural macro cell to an aircraft: 3GPP TR 36.777 V15.0.0, annex B, RMa-AV. Height 10 to 300 m, up to 10 km."""

    heights_m: ClassVar[tuple[float, float]] = (10.0, 300.0)
    farthest_m: ClassVar[float] = 10_000.0
    model: Literal["rma-av"] = "rma-av"

    def line_of_sight_probability(self, path: Path) -> FloatArray:
        """Return 1 above 40 m, else by ground distance and height."""
        height = np.maximum(_aircraft_height(path), 10.0)
        near = np.maximum(1350.8 * np.log10(height) - 1602.0, 18.0)
        far = np.maximum(15021.0 * np.log10(height) - 16053.0, 1000.0)
        return np.where(height > 40.0, 1.0, _sight(path.ground_distance_m, near, far))

    def _states_db(self, path: Path, height_m: FloatArray) -> tuple[FloatArray, FloatArray]:
        log_d = np.log10(path.distance_m)
        constant = 20.0 * np.log10(40.0 * math.pi * np.divide(path.frequency_hz, HZ_PER_GHZ) / 3.0)
        log_h = np.log10(np.maximum(height_m, 10.0))
        with_sight = np.maximum(23.9 - 1.8 * log_h, 20.0) * log_d + constant
        log_h_low = np.log10(np.clip(height_m, 10.0, 40.0))
        without = np.maximum(with_sight, -12.0 + (35.0 - 5.3 * log_h_low) * log_d + constant)
        return np.asarray(with_sight), np.asarray(without)


def _aircraft_height(path: Path) -> FloatArray:
    return np.asarray(np.maximum(path.height_tx_m, path.height_rx_m))


def _sight(ground_m: FloatArray, near_m: FloatArray, far_m: FloatArray) -> FloatArray:
    """Return 1 up to d1, else d1/d + exp(-d/p1) (1 - d1/d)."""
    share = np.minimum(near_m / np.maximum(ground_m, 1e-3), 1.0)
    return np.asarray(share + np.exp(-ground_m / far_m) * (1.0 - share))
