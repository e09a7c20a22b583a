"""Where the ends of links are, as people give it: distances, or positions; checked."""

from __future__ import annotations

from typing import Literal, TypedDict

import numpy as np
from numpy.typing import ArrayLike

from channel import checks
from channel.checks import ChannelInputError, FloatArray
from channel.config import RadioConfig
from channel.geometry import LEVEL_WXYZ, MIN_HEIGHT_M, Path, separation_m

MAX_WAY_M = 1e12
"""Farther than any radio, and near enough that squares do not overflow."""
MAX_FREQUENCY_HZ = 1e12


class Geometry(TypedDict, total=False):
    """Arguments of `LinkPaths.given` beside the distance."""

    ground_distance_m: ArrayLike | None
    position_tx_ned_m: ArrayLike | None
    position_rx_ned_m: ArrayLike | None
    attitude_tx_wxyz: ArrayLike | None
    attitude_rx_wxyz: ArrayLike | None
    height_tx_m: ArrayLike | None
    height_rx_m: ArrayLike | None
    frequency_hz: ArrayLike | None
    base: Literal["tx", "rx"]


class LinkPaths:
    """The geometry of links of one radio configuration."""

    def __init__(self, config: RadioConfig) -> None:
        self._config = config

    def given(
        self,
        slant_distance_m: ArrayLike | None = None,
        *,
        ground_distance_m: ArrayLike | None = None,
        position_tx_ned_m: ArrayLike | None = None,
        position_rx_ned_m: ArrayLike | None = None,
        attitude_tx_wxyz: ArrayLike | None = None,
        attitude_rx_wxyz: ArrayLike | None = None,
        height_tx_m: ArrayLike | None = None,
        height_rx_m: ArrayLike | None = None,
        frequency_hz: ArrayLike | None = None,
        base: Literal["tx", "rx"] = "tx",
    ) -> Path:
        """Return the checked geometry of links, from distances or from positions.

        With distances, tx stands above the origin of the frame and rx due north of it.

        Args:
            slant_distance_m: between the antennas, any shape.
            ground_distance_m: or over the ground, any shape.
            position_tx_ned_m: or positions, shape (..., 3), in a common frame whose origin is on the ground.
            position_rx_ned_m: likewise.
            attitude_tx_wxyz: body to north-east-down, shape (..., 4); level with the nose north if not given.
            attitude_rx_wxyz: likewise.
            height_tx_m: above ground, with distances; the radio's default height if not given.
            height_rx_m: likewise.
            frequency_hz: another carrier than the radio's.
            base: which end is the base on the ground, and the other the aircraft: for `uma-av` and `rma-av`.

        Raises:
            ChannelInputError: a value out of range, a wrong shape, or not one of distances and positions.
        """
        carrier = self._config.frequency_hz if frequency_hz is None else frequency_hz
        frequency = checks.finite("frequency_hz", carrier, 0.0, MAX_FREQUENCY_HZ, low_open=True)
        attitude_tx = _attitude("attitude_tx_wxyz", attitude_tx_wxyz)
        attitude_rx = _attitude("attitude_rx_wxyz", attitude_rx_wxyz)
        _only_one(slant_distance_m, ground_distance_m, position_tx_ned_m, position_rx_ned_m)
        if slant_distance_m is None and ground_distance_m is None:
            start = _place("position_tx_ned_m", position_tx_ned_m)
            end = _place("position_rx_ned_m", position_rx_ned_m)
            checks.broadcast(position_tx_ned_m=start, position_rx_ned_m=end)
        else:
            heights = self._heights(height_tx_m, height_rx_m)
            start, end = self._places(slant_distance_m, ground_distance_m, *heights, frequency)
        checks.broadcast(
            position_tx_ned_m=start[..., 0],
            position_rx_ned_m=end[..., 0],
            attitude_tx_wxyz=LEVEL_WXYZ[0] if attitude_tx is None else attitude_tx[..., 0],
            attitude_rx_wxyz=LEVEL_WXYZ[0] if attitude_rx is None else attitude_rx[..., 0],
            frequency_hz=frequency,
        )
        if base not in ("tx", "rx"):
            raise ChannelInputError("base", base, "tx or rx")
        path = self.of(start, end, separation_m(start, end), attitude_tx, attitude_rx, frequency)
        return path._replace(tx_is_base=base == "tx", rx_is_base=base == "rx")

    def _heights(
        self, height_tx_m: ArrayLike | None, height_rx_m: ArrayLike | None
    ) -> tuple[FloatArray, FloatArray]:
        default = self._config.default_height_m
        tx = checks.finite(
            "height_tx_m", default if height_tx_m is None else height_tx_m, MIN_HEIGHT_M, MAX_WAY_M
        )
        rx = checks.finite(
            "height_rx_m", default if height_rx_m is None else height_rx_m, MIN_HEIGHT_M, MAX_WAY_M
        )
        return tx, rx

    def _places(
        self,
        slant_m: ArrayLike | None,
        ground_m: ArrayLike | None,
        tx_m: FloatArray,
        rx_m: FloatArray,
        frequency_hz: FloatArray,
    ) -> tuple[FloatArray, FloatArray]:
        """Return positions of both ends, shape (..., 3)."""
        if slant_m is None:
            ground = checks.finite("ground_distance_m", np.asarray(ground_m), 0.0, MAX_WAY_M)
        else:
            slant = checks.finite("slant_distance_m", slant_m, 0.0, MAX_WAY_M)
            checks.broadcast(
                slant_distance_m=slant, height_tx_m=tx_m, height_rx_m=rx_m, frequency_hz=frequency_hz
            )
            spare = slant - np.abs(tx_m - rx_m)
            if np.any(spare < -1e-9):
                worst = float(np.min(spare))
                raise ChannelInputError(
                    "slant_distance_m - |height_tx_m - height_rx_m|", worst, ">= 0: the way is slant"
                )
            ground = np.sqrt(np.maximum(np.square(slant) - np.square(tx_m - rx_m), 0.0))
        checks.broadcast(distance_m=ground, height_tx_m=tx_m, height_rx_m=rx_m, frequency_hz=frequency_hz)
        ground, tx, rx, _ = np.broadcast_arrays(ground, tx_m, rx_m, frequency_hz)
        zero = np.zeros_like(ground)
        return np.stack((zero, zero, -tx), axis=-1), np.stack((ground, zero, -rx), axis=-1)

    def of(
        self,
        tx_ned_m: FloatArray,
        rx_ned_m: FloatArray,
        distance_m: FloatArray,
        attitude_tx_wxyz: FloatArray | None = None,
        attitude_rx_wxyz: FloatArray | None = None,
        frequency_hz: FloatArray | float | None = None,
    ) -> Path:
        """Return the geometry of positions that are known to be good, without checks."""
        return Path(
            self._config.frequency_hz if frequency_hz is None else frequency_hz,
            np.maximum(distance_m, self._config.min_distance_m),
            np.maximum(-tx_ned_m[..., 2], MIN_HEIGHT_M),
            np.maximum(-rx_ned_m[..., 2], MIN_HEIGHT_M),
            tx_ned_m,
            rx_ned_m,
            attitude_tx_wxyz,
            attitude_rx_wxyz,
        )


def _only_one(
    slant_m: ArrayLike | None, ground_m: ArrayLike | None, tx: ArrayLike | None, rx: ArrayLike | None
) -> None:
    """Refuse no geometry, and more than one."""
    positions = tx is not None or rx is not None
    if positions and (tx is None or rx is None):
        missing = "position_tx_ned_m" if tx is None else "position_rx_ned_m"
        raise ChannelInputError(missing, None, "a position, as there is one of the other end")
    if (slant_m is not None) + (ground_m is not None) + positions != 1:
        given = None if slant_m is None else slant_m
        raise ChannelInputError(
            "slant_distance_m", given, "a distance, slant or over the ground, or both positions: one of them"
        )


def _place(name: str, value: ArrayLike | None) -> FloatArray:
    place = checks.vectors(name, np.asarray(value), 3)
    return checks.finite(name, place, -MAX_WAY_M, MAX_WAY_M)


def _attitude(name: str, value: ArrayLike | None) -> FloatArray | None:
    """Return checked quaternions at length 1."""
    if value is None:
        return None
    attitude = checks.vectors(name, value, 4)
    length = np.sqrt(np.sum(np.square(np.clip(attitude, -10.0, 10.0)), axis=-1, keepdims=True))
    if not np.all((length > 0.5) & (length < 2.0)):
        bad = attitude[~((length > 0.5) & (length < 2.0))[..., 0]]
        raise ChannelInputError(name, bad.reshape(-1, 4)[0].tolist(), "a quaternion of length about 1")
    return np.asarray(attitude / length)
