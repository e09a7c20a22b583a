"""Coded 802.11a/g OFDM: convolutional code over white noise, hard decisions, union bounds.

Two readings of the same physics. NIST: Chernoff bound over the code's weight spectrum (Miller, "Validation of
802.11a/UWB coexistence simulation", NIST 2003; Pei & Henderson, "Validation of OFDM error rate model in ns-3",
2010). YANS: first terms of the union bound (Lacage & Henderson, "Yet another network simulator", 2006).
"""

from __future__ import annotations

import math
from typing import Literal, NamedTuple

import numpy as np

from channel.checks import FloatArray
from channel.numbers import special
from channel.phy.error_model import BITS_PER_BYTE, Band, Smooth, linear_snr, packet_error

CHANNEL_WIDTH_HZ = 20e6
RateMbps = Literal[6, 9, 12, 18, 24, 36, 48, 54]


class OfdmRate(NamedTuple):
    """One rate of 802.11a.

    Attributes:
        order: constellation points.
        code: k of the code rate k / (k + 1).
        free_distance: of the punctured code.
        paths: how many paths have that distance.
        next_paths: how many have one more; 0 where the YANS model stops before.
    """

    order: int
    code: int
    free_distance: int
    paths: int
    next_paths: int


RATES: dict[int, OfdmRate] = {
    6: OfdmRate(2, 1, 10, 11, 0),
    9: OfdmRate(2, 3, 5, 8, 0),
    12: OfdmRate(4, 1, 10, 11, 0),
    18: OfdmRate(4, 3, 5, 8, 31),
    24: OfdmRate(16, 1, 10, 11, 0),
    36: OfdmRate(16, 3, 5, 8, 31),
    48: OfdmRate(64, 2, 6, 1, 16),
    54: OfdmRate(64, 3, 5, 8, 31),
}

WEIGHT_SPECTRA: dict[int, tuple[int, int, tuple[int, ...]]] = {
    1: (10, 2, (36, 211, 1404, 11633, 77433, 502690, 3322763, 21292910, 134365911)),
    2: (6, 1, (3, 70, 285, 1276, 6160, 27128, 117019, 498860, 2103891, 8784123)),
    3: (5, 1, (42, 201, 1492, 10469, 62935, 379644, 2253373, 13073811, 75152755, 428005675)),
}
"""By code: first exponent of D, step, bit-error weights of the (133, 171) code (Frenger et al. 1999, table I)."""
_TERMS = {
    code: tuple((weight, 0.5 * (first + step * number)) for number, weight in enumerate(weights))
    for code, (first, step, weights) in WEIGHT_SPECTRA.items()
}
"""By code: weights, and the exponents of D^2."""


def nist_bit_error_rate(snr: FloatArray, order: int) -> FloatArray:
    """Return the uncoded bit error rate of the NIST model for a linear SNR per subcarrier."""
    if order == 2:
        return np.asarray(0.5 * special.erfc(np.sqrt(snr)))
    side = math.isqrt(order)
    factor = (side - 1.0) / (side * math.log2(side))
    return np.asarray(factor * special.erfc(np.sqrt(snr / (2.0 * (order - 1.0) / 3.0))))


def yans_bit_error_rate(ebn0: FloatArray, order: int) -> FloatArray:
    """Return the uncoded bit error rate of the YANS model for a linear Eb/N0."""
    if order == 2:
        return np.asarray(0.5 * special.erfc(np.sqrt(ebn0)))
    bits = math.log2(order)
    axis = (1.0 - 1.0 / math.sqrt(order)) * special.erfc(np.sqrt(1.5 * bits * ebn0 / (order - 1.0)))
    return np.asarray((2.0 * axis - axis**2) / bits)


def _wrong_path(ber: FloatArray, distance: int) -> FloatArray:
    """Return the probability that a path at this distance wins: more than half of its bits wrong.

    As in the YANS model, the case that every bit is wrong is left out.
    """
    total = 0.5 * _binomial(distance // 2, ber, distance) if distance % 2 == 0 else np.zeros_like(ber)
    for wrong in range(distance // 2 + 1, distance):
        total = total + _binomial(wrong, ber, distance)
    return np.asarray(total)


def _binomial(k: int, p: FloatArray, n: int) -> FloatArray:
    return np.asarray(float(special.binom(n, k)) * p**k * (1.0 - p) ** (n - k))


class OfdmNist(Smooth):
    """802.11a OFDM, error rates of the NIST model."""

    model: Literal["ofdm-nist"] = "ofdm-nist"
    rate_mbps: RateMbps = 6

    def ber(self, snr_db: FloatArray, _band: Band, /) -> FloatArray:
        """Return the bit error rate before decoding."""
        return nist_bit_error_rate(linear_snr(snr_db), RATES[self.rate_mbps].order)

    def per(self, snr_db: FloatArray, length_bytes: FloatArray | float, band: Band, /) -> FloatArray:
        """Return 1 - (1 - p)^bits with the union bound p of an error event per bit."""
        raw = self.ber(snr_db, band)
        squared = 4.0 * raw * (1.0 - raw)
        bound: FloatArray | float = 0.0
        for weight, exponent in _TERMS[RATES[self.rate_mbps].code]:
            bound = bound + weight * squared**exponent
        decoded = np.minimum(bound / (2.0 * RATES[self.rate_mbps].code), 1.0)
        return packet_error(decoded, np.multiply(length_bytes, BITS_PER_BYTE))


class OfdmYans(Smooth):
    """802.11a OFDM, error rates of the YANS model: more hopeful than NIST by some 3 dB."""

    model: Literal["ofdm-yans"] = "ofdm-yans"
    rate_mbps: RateMbps = 6

    def ber(self, snr_db: FloatArray, _band: Band, /) -> FloatArray:
        """Return the bit error rate before decoding."""
        rate = RATES[self.rate_mbps]
        coded_bps = self.rate_mbps * 1e6 * (rate.code + 1) / rate.code
        return yans_bit_error_rate(linear_snr(snr_db) * (CHANNEL_WIDTH_HZ / coded_bps), rate.order)

    def per(self, snr_db: FloatArray, length_bytes: FloatArray | float, band: Band, /) -> FloatArray:
        """Return 1 - (1 - p)^bits with the first terms of the union bound as p."""
        rate = RATES[self.rate_mbps]
        raw = self.ber(snr_db, band)
        decoded = rate.paths * _wrong_path(raw, rate.free_distance)
        if rate.next_paths:
            decoded = decoded + rate.next_paths * _wrong_path(raw, rate.free_distance + 1)
        return packet_error(np.minimum(decoded, 1.0), np.multiply(length_bytes, BITS_PER_BYTE))
