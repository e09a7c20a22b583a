"""A radio at work: geometry in, link budget, error rates and probability of delivery out."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from channel import checks
from channel.checks import ChannelInputError, FloatArray
from channel.config import RadioConfig
from channel.error_model import Band
from channel.geometry import MIN_HEIGHT_M, Path
from channel.link_budget import BudgetTerm, Link, total
from channel.quadrature import standard_normal_rule

PANELS = 32
CHUNK_VALUES = 1 << 20
"""Integrands are evaluated in chunks of about this many values: bounds memory, changes no result."""
CURVE_STEP_DB = 0.02
CURVE_TAIL = 1e-9


@dataclass(frozen=True, slots=True)
class Delivery:
    """A probability of delivery averaged over the random terms, and a bound of its quadrature error."""

    probability: FloatArray
    error_bound: FloatArray


class Radio:
    """The physics of one radio configuration; the same at both ends.

    Args:
        config: the radio, see `presets.load_radio`.
    """

    def __init__(self, config: RadioConfig) -> None:
        self.config = config
        self._band = Band(config.bandwidth_hz, config.bit_rate_bps)
        self._noise_dbm = config.noise.noise_floor_dbm(config.bandwidth_hz)
        self._max_range_m = np.inf if config.max_range_m is None else config.max_range_m
        self._curve = lru_cache(maxsize=64)(self._make_curve)

    @property
    def noise_floor_dbm(self) -> float:
        """Noise power at the receiver, dBm."""
        return self._noise_dbm

    @property
    def max_range_m(self) -> float:
        """Distance beyond which nothing is received; inf if there is none."""
        return self._max_range_m

    def length_bytes(self, payload_bytes: int) -> int:
        """Return the length that the error model counts for a payload of `payload_bytes`.

        Raises:
            ChannelInputError: a negative length.
        """
        if payload_bytes < 0:
            raise ChannelInputError("payload_bytes", payload_bytes, ">= 0")
        return self.config.length.length_bytes(payload_bytes)

    def path(
        self,
        distance_m: ArrayLike | None = None,
        *,
        position_tx_ned_m: ArrayLike | None = None,
        position_rx_ned_m: ArrayLike | None = None,
        height_tx_m: ArrayLike | None = None,
        height_rx_m: ArrayLike | None = None,
        frequency_hz: ArrayLike | None = None,
    ) -> Path:
        """Return the checked geometry of links, from distances or from positions.

        Args:
            distance_m: slant distances, any shape; or leave it out and give both positions.
            position_tx_ned_m: shape (..., 3) in a common north-east-down frame whose origin is on the ground.
            position_rx_ned_m: likewise.
            height_tx_m: above ground, with `distance_m`; the radio's default height if not given.
            height_rx_m: likewise.
            frequency_hz: another carrier than the radio's.

        Raises:
            ChannelInputError: a value out of range, a wrong shape, or neither distances nor positions.
        """
        carrier = self.config.frequency_hz if frequency_hz is None else frequency_hz
        frequency = checks.finite("frequency_hz", carrier, 0.0, low_open=True)
        if distance_m is None:
            if position_tx_ned_m is None or position_rx_ned_m is None:
                raise ChannelInputError("distance_m", None, "a distance, or both positions")
            return self._path_between(position_tx_ned_m, position_rx_ned_m, frequency)
        distance = checks.finite("distance_m", distance_m, 0.0)
        default = self.config.default_height_m
        tx = checks.finite("height_tx_m", default if height_tx_m is None else height_tx_m, MIN_HEIGHT_M)
        rx = checks.finite("height_rx_m", default if height_rx_m is None else height_rx_m, MIN_HEIGHT_M)
        checks.broadcast(distance_m=distance, height_tx_m=tx, height_rx_m=rx, frequency_hz=frequency)
        if np.any(distance < np.abs(tx - rx) * (1.0 - 1e-12)):
            short = float(np.min(distance - np.abs(tx - rx)))
            raise ChannelInputError(
                "distance_m - |height_tx_m - height_rx_m|", short, ">= 0: the way is slant"
            )
        return Path(frequency, np.maximum(distance, self.config.min_distance_m), tx, rx)

    def _path_between(self, tx: ArrayLike, rx: ArrayLike, frequency_hz: FloatArray) -> Path:
        start = checks.vectors("position_tx_ned_m", tx, 3)
        end = checks.vectors("position_rx_ned_m", rx, 3)
        checks.broadcast(position_tx_ned_m=start, position_rx_ned_m=end)
        return self.path_of(start, end, separation_m(start, end), frequency_hz)

    def path_of(
        self,
        tx_ned_m: FloatArray,
        rx_ned_m: FloatArray,
        distance_m: FloatArray,
        frequency_hz: FloatArray | float | None = None,
    ) -> Path:
        """Return the geometry of positions that are known to be good, without checks."""
        return Path(
            self.config.frequency_hz if frequency_hz is None else frequency_hz,
            np.maximum(distance_m, self.config.min_distance_m),
            np.maximum(-tx_ned_m[..., 2], MIN_HEIGHT_M),
            np.maximum(-rx_ned_m[..., 2], MIN_HEIGHT_M),
            tx_ned_m,
            rx_ned_m,
        )

    def budget(self, path: Path) -> tuple[BudgetTerm, ...]:
        """Return the terms of the received power without its random part, in order."""
        config = self.config
        gain_db = config.antenna.gain_db(None)
        return (
            BudgetTerm("transmit_power_dbm", config.transmit_power_dbm),
            BudgetTerm("transmit_antenna_gain_db", gain_db),
            BudgetTerm("receive_antenna_gain_db", gain_db),
            BudgetTerm("offset_db", config.offset_db),
            BudgetTerm("path_loss_db", -config.propagation.path_loss_db(path)),
        )

    def mean_power_dbm(self, path: Path) -> FloatArray:
        """Return the received power without its random part, dBm: the sum of `budget`."""
        return np.asarray(total(self.budget(path)))

    def per(self, snr_db: FloatArray, length_bytes: FloatArray | float) -> FloatArray:
        """Return the packet error rate at an SNR, range and `base_loss` aside."""
        return self.config.error.per(snr_db, length_bytes, self._band)

    def link(
        self,
        distance_m: ArrayLike | None = None,
        *,
        length_bytes: ArrayLike | None = None,
        **geometry: ArrayLike,
    ) -> Link:
        """Return the link budget and the error rates without shadowing and fading.

        Args:
            distance_m: see `path`.
            length_bytes: payload length; the radio's nominal length if not given. Broadcasts.
            **geometry: positions, heights, frequency: see `path`.

        Raises:
            ChannelInputError: see `path`; or a negative length.
        """
        path = self.path(distance_m, **geometry)
        length = self._lengths(length_bytes)
        terms = self.budget(path)
        power = np.asarray(total(terms))
        checks.broadcast(distance_m=power, length_bytes=length)
        snr = power - self._noise_dbm
        distance = self._true_distance(distance_m, path)
        in_range = np.less_equal(distance, self._max_range_m)
        return Link(
            distance_m=distance,
            length_bytes=length,
            terms=terms,
            path_loss_db=np.negative(terms[-1].contribution),
            received_power_dbm=power,
            noise_dbm=np.asarray(self._noise_dbm),
            snr_db=snr,
            ber=self.config.error.ber(snr, self._band),
            per=np.where(in_range, self.per(snr, length), 1.0),
            in_range=in_range,
            base_loss=self.config.base_loss,
        )

    def probability_of_delivery(
        self,
        distance_m: ArrayLike | None = None,
        length_bytes: ArrayLike | None = None,
        **geometry: ArrayLike,
    ) -> FloatArray:
        """Return the probability that a packet arrives, averaged over the random terms by quadrature."""
        return self.delivery(distance_m, length_bytes, **geometry).probability

    def delivery(
        self,
        distance_m: ArrayLike | None = None,
        length_bytes: ArrayLike | None = None,
        **geometry: ArrayLike,
    ) -> Delivery:
        """Return the probability of delivery with a bound of the quadrature's error.

        The bound is the difference to a rule of twice the nodes, plus the weight of the tails left out.
        Arguments as of `link`.
        """
        path = self.path(distance_m, **geometry)
        length = self._lengths(length_bytes)
        snr = self.mean_power_dbm(path) - self._noise_dbm
        checks.broadcast(distance_m=snr, length_bytes=length)
        coarse = self._averaged(snr, length, PANELS)
        fine = self._averaged(snr, length, 2 * PANELS)
        kept = np.where(
            self._true_distance(distance_m, path) <= self._max_range_m, 1.0 - self.config.base_loss, 0.0
        )
        return Delivery(kept * fine, kept * (np.abs(fine - coarse) + 1e-14))

    def expected_delivery(
        self, mean_snr_db: FloatArray, distance_m: FloatArray, length_bytes: int
    ) -> FloatArray:
        """Return the probability of delivery at a mean SNR from a table: fast, within 1e-5 of `delivery`."""
        grid_db, success = self._curve(length_bytes)
        kept = np.where(np.less_equal(distance_m, self._max_range_m), 1.0 - self.config.base_loss, 0.0)
        return kept * np.interp(mean_snr_db, grid_db, success)

    def _lengths(self, length_bytes: ArrayLike | None) -> FloatArray:
        if length_bytes is None:
            return np.asarray(float(self.length_bytes(self.config.nominal_payload_bytes)))
        payload = checks.finite("length_bytes", length_bytes, 0.0)
        return np.asarray(np.vectorize(self.config.length.length_bytes, otypes=[np.float64])(payload))

    def _true_distance(self, distance_m: ArrayLike | None, path: Path) -> FloatArray:
        if distance_m is not None:
            return np.asarray(distance_m, dtype=np.float64)
        assert path.position_tx_ned_m is not None
        assert path.position_rx_ned_m is not None
        return separation_m(path.position_tx_ned_m, path.position_rx_ned_m)

    def _averaged(self, snr_db: FloatArray, length_bytes: FloatArray | float, panels: int) -> FloatArray:
        """Return E[1 - PER] over the shadowing, in the broadcast shape of SNR and length."""
        if not self.config.shadowing.is_random:
            return 1.0 - self.per(snr_db, length_bytes)
        nodes, weights = standard_normal_rule(panels)
        loss_db = self.config.shadowing.loss_db(nodes)
        snr, length = np.broadcast_arrays(snr_db, length_bytes)
        flat_snr, flat_length = snr.reshape(-1, 1), length.reshape(-1, 1)
        out = np.empty(flat_snr.shape[0])
        rows = max(1, CHUNK_VALUES // nodes.size)
        for start in range(0, out.size, rows):
            part = slice(start, start + rows)
            out[part] = (1.0 - self.per(flat_snr[part] - loss_db, flat_length[part])) @ weights
        return np.clip(out, 0.0, 1.0).reshape(snr.shape)

    def _make_curve(self, length_bytes: int) -> tuple[FloatArray, FloatArray]:
        """Return a fine table of E[1 - PER] against the mean SNR, over where it is neither 0 nor 1."""
        coarse_db = np.arange(-150.0, 250.0, 1.0)
        coarse = self._averaged(coarse_db, float(length_bytes), PANELS)
        first, last = np.searchsorted(coarse, (CURVE_TAIL, coarse[-1] - CURVE_TAIL))
        low, high = coarse_db[max(first - 1, 0)], coarse_db[min(last + 1, coarse_db.size - 1)]
        grid_db = np.arange(low, high + CURVE_STEP_DB, CURVE_STEP_DB)
        return grid_db, self._averaged(grid_db, float(length_bytes), PANELS)


def separation_m(tx_ned_m: FloatArray, rx_ned_m: FloatArray) -> FloatArray:
    """Return the distance between positions of shape (..., 3), m."""
    way = rx_ned_m - tx_ned_m
    return np.sqrt(way[..., 0] ** 2 + way[..., 1] ** 2 + way[..., 2] ** 2)
