"""Path loss between the air and the ground, by the probability of a line of sight."""

from __future__ import annotations

import math
from typing import ClassVar, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from channel.checks import FloatArray
from channel.geometry import Path
from channel.propagation.path_loss import PathLossModel, friis_db, spreading_db
from channel.validity import RangedVariant

HZ_PER_GHZ = 1e9

AL_HOURANI = {
    "suburban": (4.88, 0.43, 0.1, 21.0),
    "urban": (9.61, 0.16, 1.0, 20.0),
    "dense-urban": (12.08, 0.11, 1.6, 23.0),
    "highrise": (27.23, 0.08, 2.3, 34.0),
}
"""a, b, excess loss with and without line of sight in dB (Al-Hourani et al. 2014, table II)."""


class SightState(NamedTuple):
    """What a link is with a line of sight, or without one; fields broadcast against each other.

    Attributes:
        chance: probability of the state.
        path_loss_db: in the state.
        sigma_db: of the shadowing in the state, as the model's source has it; None: it has none.
    """

    chance: FloatArray
    path_loss_db: FloatArray
    sigma_db: FloatArray | None


class _BySight(RangedVariant, PathLossModel):
    """What models with and without line of sight share."""

    has_ground: ClassVar[bool] = True
    line_of_sight: Literal["drawn", "expected", "always", "never"] = Field(
        default="drawn",
        description="the state is drawn, and lasts over some way; or the mean in dB over both; or one of them",
    )
    sight_decorrelation_m: float = Field(
        default=50.0, gt=0.0, description="drawn: way over which the correlation of the state falls to 1/e"
    )

    @property
    def draws_sight(self) -> bool:
        """Whether the line of sight is drawn."""
        return self.line_of_sight == "drawn"

    def sight_states(self, path: Path) -> tuple[SightState, SightState]:
        """Return the state with line of sight and the one without."""
        raise NotImplementedError

    def path_loss_db(self, path: Path) -> FloatArray:
        """Return the loss, dB: of the state, or the mean in dB over both."""
        with_sight, without = self.sight_states(path)
        weight = {"always": 1.0, "never": 0.0}.get(self.line_of_sight)
        sight = with_sight.chance if weight is None else weight
        return np.asarray(sight * with_sight.path_loss_db + (1.0 - sight) * without.path_loss_db)


class AlHourani(_BySight):
    """Free space plus an excess loss that depends on the line of sight, whose probability is one of elevation.

    Al-Hourani, Kandeepan, Lardner, "Optimal LAP altitude for maximum coverage", IEEE Wireless Commun. Lett. 3
    (2014), eq. 3 to 5. Made for 700 to 5800 MHz and one end on the ground.
    """

    model: Literal["al-hourani"] = "al-hourani"
    environment: Literal["suburban", "urban", "dense-urban", "highrise"] = Field(default="suburban")

    @property
    def frequencies_hz(self) -> tuple[float, float]:
        """The carriers for which it was made."""
        return 700e6, 5800e6

    def line_of_sight_probability(self, path: Path) -> FloatArray:
        """Return 1 / (1 + a exp(-b (elevation - a))), elevation in degrees."""
        a, b, _, _ = AL_HOURANI[self.environment]
        return np.asarray(1.0 / (1.0 + a * np.exp(-b * (path.elevation_deg - a))))

    def sight_states(self, path: Path) -> tuple[SightState, SightState]:
        """Return the state with line of sight and the one without."""
        frequency_hz = self.within_frequencies(path.frequency_hz)
        self.within("height of the lower end", np.minimum(path.height_tx_m, path.height_rx_m), 0.0, 10.0)
        _, _, with_sight_db, without_db = AL_HOURANI[self.environment]
        sight, free_db = self.line_of_sight_probability(path), friis_db(path.distance_m, frequency_hz)
        return SightState(sight, free_db + with_sight_db, None), SightState(
            1.0 - sight, free_db + without_db, None
        )


class _AerialVehicle(_BySight):
    """What the aerial scenarios of TR 36.777 share: one end is a base on the ground, the other an aircraft.

    Between two of a kind, of which the tables know nothing, the lower end counts as the base if `outside` lets it.
    """

    needs_roles: ClassVar[bool] = True

    heights_m: ClassVar[tuple[float, float]]
    farthest_m: ClassVar[float]
    """Validity: heights of the aircraft, and distance over the ground."""
    sigma_db: ClassVar[tuple[float, float, float]]
    """TR 36.777, table B-3: with line of sight a exp(-b h), h in m; without."""

    @property
    def has_sigmas(self) -> bool:
        """Whether the states have a sigma of their own."""
        return self.draws_sight

    def line_of_sight_probability(self, path: Path) -> FloatArray:
        """Return the probability of a line of sight (TR 36.777, table B-1)."""
        raise NotImplementedError

    def _states_db(self, path: Path, height_m: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the losses with and without line of sight."""
        raise NotImplementedError

    def sight_states(self, path: Path) -> tuple[SightState, SightState]:
        """Return the state with line of sight and the one without."""
        inside, height_m = self._inside(path)
        spreading = spreading_db(path.distance_m, inside.distance_m)
        with_sight_db, without_db = (each + spreading for each in self._states_db(inside, height_m))
        sight = self.line_of_sight_probability(inside)
        a, b, sigma_without_db = self.sigma_db
        sigma_db = a * np.exp(-b * height_m)
        return SightState(sight, with_sight_db, sigma_db), SightState(
            1.0 - sight, without_db, np.asarray(sigma_without_db)
        )

    def _inside(self, path: Path) -> tuple[Path, FloatArray]:
        """Return the path and the aircraft's height to count with."""
        if not np.all(_is_covered(path)):
            self.say("ends of a link", "two of a kind", "a ground node, the base, and a UA")
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
    sigma_db: ClassVar[tuple[float, float, float]] = (4.64, 0.0066, 6.0)
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
    sigma_db: ClassVar[tuple[float, float, float]] = (4.2, 0.0046, 6.0)
    sight_decorrelation_m: float = Field(
        default=60.0, gt=0.0, description="drawn: way over which the correlation of the state falls to 1/e"
    )
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


def _is_covered(path: Path) -> NDArray[np.bool_]:
    """Return whether one end is the base and the other the aircraft."""
    return np.not_equal(path.tx_is_base, path.rx_is_base)


def _aircraft_height(path: Path) -> FloatArray:
    tx_m, rx_m = path.height_tx_m, path.height_rx_m
    height_m = np.where(path.tx_is_base, rx_m, tx_m)
    return np.where(_is_covered(path), height_m, np.maximum(tx_m, rx_m))


def _sight(ground_m: FloatArray, near_m: FloatArray, far_m: FloatArray) -> FloatArray:
    """Return 1 up to d1, else d1/d + exp(-d/p1) (1 - d1/d)."""
    share = np.minimum(near_m / np.maximum(ground_m, 1e-3), 1.0)
    return np.asarray(share + np.exp(-ground_m / far_m) * (1.0 - share))
