"""The link budget: every term by name, in order; together they are the received power."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from channel.checks import FloatArray


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
