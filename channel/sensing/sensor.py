"""One RF sensor: the law of its readings.

A reading is the mean power of M independent complex samples of signal and receiver noise. With signal power S, which is
steady while a reading is taken, and noise floor N it is N / 2M times a noncentral chi-square variable with 2M degrees
of freedom and noncentrality 2M S / N (Urkowitz, "Energy detection of unknown deterministic signals", Proc. IEEE 55,
1967): mean S + N, variance (N^2 + 2 S N) / M.
"""

from __future__ import annotations

import math
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from channel import checks
from channel.antenna import Isotropic
from channel.checks import FloatArray
from channel.config import Antenna, RadioConfig
from channel.link.expectation import PANELS
from channel.link.radio import Radio
from channel.link.tables.steps import STEPS_PER_DB, in_steps
from channel.numbers import special
from channel.numbers.units import LN10_OVER_10, db_from_ratio, ratio_from_db
from channel.sensing.settings import SensorSettings

ISOTROPIC = Isotropic()


class SensorConfig(SensorSettings):
    """A sensor with its radio.

    Of the radio its receiver counts (antenna, cable, offset, noise, bandwidth, range), and the way (path loss,
    atmosphere, shadowing, fading, polarisation); transmitter, error model, interference and bursts do not.
    """

    radio: RadioConfig


class Sensor:
    """What is known of a sensor: its settings, and the law that it was calibrated to.

    Args:
        config: the sensor.
        is_base: whether its node stands on the ground: what it hears is an aircraft then to laws with `needs_roles`,
            and stands on the ground itself if not, as with the sources that a radio hears.

    Attributes:
        config, is_base: as given.
        period_ns: sim time between two measurements.
        band_hz: lowest and highest frequency that it measures.
        noise_floor_dbm: of its receiver.
        threshold_dbm: readings below are not reported.
        shadowing_sigma_db: standard deviation of the shadowing (with line of sight, if that matters); 0: there is none;
            nan: the propagation law has a table of its own, by height.
        decorrelation_m: distance over which shadowing falls to 1/e; None: it is drawn anew for each measurement.
    """

    def __init__(self, config: SensorConfig, *, is_base: bool = False) -> None:
        self.config, self.is_base = config, is_base
        radio, shadowing = config.radio, config.radio.shadowing
        half_hz = 0.5 * radio.bandwidth_hz
        self.period_ns = config.period_ns
        self.band_hz = config.band_hz or (radio.frequency_hz - half_hz, radio.frequency_hz + half_hz)
        self.noise_floor_dbm = radio.noise_floor_dbm
        self.threshold_dbm = float(
            in_steps(np.asarray(self.noise_floor_dbm + config.threshold_db), STEPS_PER_DB)
        )
        sigma_db = shadowing.in_sight(True) if shadowing.is_random else 0.0
        self.shadowing_sigma_db = math.nan if sigma_db is None else sigma_db
        self.decorrelation_m = shadowing.decorrelation_m if shadowing.is_random else None

    def hears(self, frequency_hz: float) -> bool:
        """Return whether a frequency is in the band."""
        return self.band_hz[0] <= frequency_hz <= self.band_hz[1]

    def radio_towards(self, antenna: Antenna) -> Radio:
        """Return the physics of the way from an emitter with this antenna, which transmits with 0 dBm."""
        own = self.config.radio
        ends = {
            "transmit_power_dbm": 0.0,
            "antenna": antenna,
            "cable_loss_db": 0.0,
            "receive_antenna": own.receiving_antenna,
            "receive_cable_loss_db": own.receiving_cable_loss_db,
        }
        return Radio(own.model_copy(update=ends))

    @cached_property
    def fading_db(self) -> tuple[float, float]:
        """Mean and standard deviation of the fading gain in dB, at the horizon; (0, 0) if there is none."""
        gains_db, weights = self.config.radio.fading.rule(np.zeros(()), PANELS)
        mean_db = float(np.sum(weights * gains_db))
        return mean_db, math.sqrt(float(np.sum(weights * np.square(gains_db - mean_db))))

    @cached_property
    def _law(self) -> Radio:
        return self.radio_towards(ISOTROPIC)

    def expected_power_dbm(
        self,
        emitter_ned_m: ArrayLike,
        own_ned_m: ArrayLike,
        *,
        power_dbm: ArrayLike,
        frequency_hz: ArrayLike | None = None,
        attitude_wxyz: ArrayLike | None = None,
    ) -> FloatArray:
        """Return the signal power at the receiver without shadowing, fading and receiver noise, dBm.

        Args:
            emitter_ned_m: shape (..., 3), in the fleet's frame.
            own_ned_m: of the sensor, likewise; all broadcast.
            power_dbm: radiated (EIRP).
            frequency_hz: of the emitter; the sensor's own if not given.
            attitude_wxyz: of the sensor, shape (..., 4); level with the nose north if not given.

        Raises:
            ChannelInputError: a value that is not finite, or a wrong shape.
        """
        radiated_dbm = checks.finite("power_dbm", power_dbm)
        path = self._law.path(
            position_tx_ned_m=emitter_ned_m,
            position_rx_ned_m=own_ned_m,
            attitude_rx_wxyz=attitude_wxyz,
            frequency_hz=frequency_hz,
            base="rx" if self.is_base else "tx",
        )
        return np.asarray(self._law.mean_power_dbm(path) + radiated_dbm)

    def with_noise_dbm(self, signal_dbm: ArrayLike) -> FloatArray:
        """Return the mean reading at a signal power: signal and noise floor, summed in watt, dBm."""
        total = ratio_from_db(signal_dbm) + ratio_from_db(self.noise_floor_dbm)
        return np.asarray(db_from_ratio(total))

    def noise_sigma_db(self, signal_dbm: ArrayLike) -> FloatArray:
        """Return how far the receiver's noise spreads readings at a signal power, dB: to first order, one sigma."""
        signal, noise = ratio_from_db(signal_dbm), ratio_from_db(self.noise_floor_dbm)
        variance = (noise * noise + 2.0 * signal * noise) / self.config.averages
        return np.asarray(np.sqrt(variance) / (signal + noise) / LN10_OVER_10)

    def reading_dbm(self, signal_dbm: FloatArray, normal: FloatArray, uniform: FloatArray) -> FloatArray:
        """Return readings, to 0.001 dB, same shape.

        Args:
            signal_dbm: with shadowing and fading.
            normal: z ~ N(0, 1): the noise of one degree of freedom, that in phase with the signal.
            uniform: u ~ U(0, 1): that of the 2M - 1 others.
        """
        samples = self.config.averages
        signal, noise = ratio_from_db(signal_dbm), ratio_from_db(self.noise_floor_dbm)
        in_phase = np.sqrt(samples * signal) + np.sqrt(0.5 * noise) * normal
        others = noise * special.gammaincinv(samples - 0.5, uniform)
        power = (in_phase * in_phase + others) / samples
        return in_steps(np.asarray(db_from_ratio(power)), STEPS_PER_DB)

    def told_dbm(self, reading_dbm: FloatArray) -> FloatArray:
        """Return readings in whole steps of the sensor, same shape."""
        step_db = self.config.step_db
        return in_steps(np.rint(reading_dbm / step_db) * step_db, STEPS_PER_DB)
