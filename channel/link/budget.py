"""The link budget: every term by name, in order; together they are the received power."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from channel.antenna import to_body
from channel.checks import FloatArray
from channel.config import RadioConfig
from channel.geometry import LEVEL_WXYZ, Path
from channel.link.rays import with_reflection
from channel.propagation.atmosphere import ItuAtmosphere
from channel.propagation.path_loss import friis_db
from channel.propagation.spherical_earth import bulge_of


class BudgetTerm(NamedTuple):
    """One term: `contribution` is added, so a loss is negative; dBm for the first, dB for the others."""

    name: str
    contribution: float | FloatArray


@dataclass(frozen=True, slots=True)
class BudgetedLink:
    """One or many links, every intermediate value; arrays of one shape, or scalars.

    Attributes:
        distance_m: between the antennas, as given (not clamped).
        length_bytes: packet length that the error model counts.
        terms: the link budget, in order.
        path_loss_db: what the propagation model takes away.
        received_power_dbm: the sum of the terms: without shadowing and fading.
        noise_dbm: noise floor.
        snr_db: received power less noise.
        ber: bit error rate at that SNR.
        per: packet error rate at that SNR; 1 out of range. `base_loss` is not in it.
        in_range: whether the distance is within the radio's maximal range.
        base_loss: share of packets lost whatever the range.
    """

    distance_m: FloatArray
    length_bytes: FloatArray
    terms: tuple[BudgetTerm, ...]
    path_loss_db: FloatArray
    received_power_dbm: FloatArray
    noise_dbm: FloatArray
    snr_db: FloatArray
    ber: FloatArray
    per: FloatArray
    in_range: NDArray[np.bool_]
    base_loss: float


def total(terms: tuple[BudgetTerm, ...]) -> float | FloatArray:
    """Return the sum of the terms, in their order: the received power, dBm."""
    power: float | FloatArray = 0.0
    for term in terms:
        power = power + term.contribution
    return power


class LinkBudget:
    """The budget of links of one radio configuration.

    Attributes:
        needs_attitude: whether attitudes change it.
    """

    def __init__(self, config: RadioConfig) -> None:
        self._config = config
        self.needs_attitude = config.polarisation is not None or any(
            antenna.needs_direction for antenna in (config.antenna, config.receiving_antenna)
        )
        self._fixed = None if self.needs_attitude else self._before_the_way(None)
        """The terms that no geometry changes."""
        self._fixed_dbm = None if self._fixed is None else float(np.ravel(total(self._fixed))[0])

    def terms(self, path: Path) -> tuple[BudgetTerm, ...]:
        """Return the terms of the received power without its random part, in order."""
        before = self._fixed if self._fixed is not None else self._before_the_way(path)
        path = with_reflection(
            path, self._config.propagation, self._config.antenna, self._config.receiving_antenna
        )
        return (*before, *self._of_the_way(path))

    def power_dbm(self, path: Path) -> FloatArray:
        """Return the received power without its random part, dBm: the sum of `terms`."""
        if self._fixed_dbm is None:
            return np.asarray(total(self.terms(path)))
        return self._fixed_dbm - self.loss_db(path)

    def loss_db(self, path: Path) -> FloatArray:
        """Return what the way takes, all terms together, dB."""
        if isinstance(self._config.atmosphere, ItuAtmosphere):
            return np.negative(total(self._of_the_way(path)))
        loss_db = self._config.propagation.path_loss_db(path)
        bulge_db = self._bulge_db(path, loss_db)
        return loss_db if bulge_db is None else loss_db + bulge_db

    def _before_the_way(self, path: Path | None) -> tuple[BudgetTerm, ...]:
        config = self._config
        way = np.zeros((1, 3)) if path is None else path.way_ned
        tx, rx = (None, None) if path is None else (path.attitude_tx_wxyz, path.attitude_rx_wxyz)
        attitude_tx, attitude_rx = (LEVEL_WXYZ if each is None else each for each in (tx, rx))
        terms = [
            BudgetTerm("transmit_power_dbm", config.transmit_power_dbm),
            BudgetTerm("transmit_antenna_gain_db", config.antenna.towards_db(to_body(attitude_tx, way))),
            BudgetTerm(
                "receive_antenna_gain_db", config.receiving_antenna.towards_db(to_body(attitude_rx, -way))
            ),
        ]
        if config.polarisation is not None:
            terms.append(
                BudgetTerm("polarisation_db", -config.polarisation.loss_db(attitude_tx, attitude_rx, way))
            )
        if config.cable_loss_db:
            terms.append(BudgetTerm("transmit_cable_db", -config.cable_loss_db))
        if config.receiving_cable_loss_db:
            terms.append(BudgetTerm("receive_cable_db", -config.receiving_cable_loss_db))
        return (*terms, BudgetTerm("offset_db", config.offset_db))

    def _of_the_way(self, path: Path) -> tuple[BudgetTerm, ...]:
        """Return what the way takes: gases and rain if they are configured, the horizon, and the path loss last."""
        terms = []
        air = self._config.atmosphere
        if isinstance(air, ItuAtmosphere):
            terms.append(BudgetTerm("gas_db", -air.gas_loss_db(path.distance_m, path.frequency_hz)))
            terms.append(BudgetTerm("rain_db", -air.rain_loss_db(path.distance_m, path.frequency_hz)))
        loss_db = self._config.propagation.path_loss_db(path)
        bulge_db = self._bulge_db(path, loss_db)
        if bulge_db is not None:
            terms.append(BudgetTerm("horizon_db", -bulge_db))
        return (*terms, BudgetTerm("path_loss_db", -loss_db))

    def _bulge_db(self, path: Path, loss_db: FloatArray) -> FloatArray | None:
        """Return what the bulge of the Earth takes beyond the law's loss, dB; None: nothing."""
        factor, law = self._config.earth_radius_factor, self._config.propagation
        if factor is None or law.has_earth:
            return None
        bulge = bulge_of(path, factor)
        if bulge is None:
            return None
        if not law.has_ground:
            return bulge.share * bulge.loss_db
        smooth_db = friis_db(path.distance_m, path.frequency_hz) + bulge.loss_db
        return bulge.share * np.maximum(smooth_db - loss_db, 0.0)
