"""From the signal-to-noise ratio to the probability that a packet is lost."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field

from channel import checks, modulation
from channel.checks import FloatArray
from channel.units import ratio_from_db
from channel.variant import Variant

MAX_BER = 1.0 - 2.0**-53
"""The highest bit error rate that 1 - ber can tell from 1: keeps log(1 - ber) finite."""
BITS_PER_BYTE = 8
MAX_SNR_DB = 3000.0


@dataclass(frozen=True, slots=True)
class Band:
    """What turns SNR into Eb/N0: noise bandwidth in Hz and bit rate on air in bit/s."""

    bandwidth_hz: float
    bit_rate_bps: float


class ErrorModel(Protocol):
    """SNR in, bit and packet error rate out."""

    def ber(self, snr_db: FloatArray, band: Band, /) -> FloatArray:
        """Return the bit error rate, in [0, 1], same shape."""
        ...

    def per(self, snr_db: FloatArray, length_bytes: FloatArray | float, band: Band, /) -> FloatArray:
        """Return the packet error rate, in [0, 1], broadcast shape."""
        ...


def packet_error_rate(ber: ArrayLike, trials: ArrayLike) -> FloatArray:
    """Return 1 - (1 - ber)^trials, exact down to ber 1e-300: -expm1(n log1p(-ber)).

    Args:
        ber: error rate of one trial (a bit, or the paper's byte), in [0, 1].
        trials: how many of them a packet has, >= 0.

    Raises:
        ChannelInputError: a rate outside [0, 1] or a negative count.
    """
    rate = checks.finite("ber", ber, 0.0, 1.0)
    count = checks.finite("trials", trials, 0.0)
    checks.broadcast(ber=rate, trials=count)
    return _per(rate, count)


def _per(ber: FloatArray, trials: FloatArray | float) -> FloatArray:
    return -np.expm1(np.multiply(trials, np.log1p(-np.minimum(ber, MAX_BER))))


def linear_snr(snr_db: FloatArray) -> FloatArray:
    """Return the linear ratio, with SNR held to 3000 dB so that nothing overflows."""
    return ratio_from_db(np.minimum(snr_db, MAX_SNR_DB))


class ErfcBytes(Variant):
    """The paper's error model: ber = erfc(sqrt(SNR)), per = 1 - (1 - ber)^bytes (eq. 5 and 6).

    Bytes stand where bits belong, and a factor of one half is missing: as printed, and as the simulators
    it comes from have it.
    """

    model: Literal["erfc-bytes"] = "erfc-bytes"

    def ber(self, snr_db: FloatArray, _band: Band, /) -> FloatArray:
        """Return erfc(sqrt(SNR))."""
        return modulation.ber_erfc(linear_snr(snr_db))

    def per(self, snr_db: FloatArray, length_bytes: FloatArray | float, band: Band, /) -> FloatArray:
        """Return 1 - (1 - ber)^length_bytes."""
        return _per(self.ber(snr_db, band), length_bytes)


class UncodedAwgn(Variant):
    """Textbook modulation over white noise, no coding: Eb/N0 = SNR * bandwidth / bit rate, bits as trials."""

    model: Literal["uncoded-awgn"] = "uncoded-awgn"
    modulation: Literal["bpsk", "qpsk", "16qam", "64qam"] = Field(default="qpsk")

    def ber(self, snr_db: FloatArray, band: Band, /) -> FloatArray:
        """Return the bit error rate of the modulation."""
        return _AWGN_BER[self.modulation](linear_snr(snr_db) * (band.bandwidth_hz / band.bit_rate_bps))

    def per(self, snr_db: FloatArray, length_bytes: FloatArray | float, band: Band, /) -> FloatArray:
        """Return 1 - (1 - ber)^(8 length_bytes)."""
        trials = np.multiply(length_bytes, BITS_PER_BYTE)
        return _per(self.ber(snr_db, band), trials)


_AWGN_BER: dict[str, Callable[[ArrayLike], FloatArray]] = {
    "bpsk": modulation.ber_bpsk,
    "qpsk": modulation.ber_qpsk,
    "16qam": lambda ebn0: modulation.ber_square_qam(ebn0, 16),
    "64qam": lambda ebn0: modulation.ber_square_qam(ebn0, 64),
}


class Lossless(Variant):
    """Every packet within range arrives: the baseline that the paper argues against."""

    model: Literal["lossless"] = "lossless"

    def ber(self, snr_db: FloatArray, _band: Band, /) -> FloatArray:
        """Return zeros."""
        return np.zeros_like(snr_db)

    def per(self, snr_db: FloatArray, length_bytes: FloatArray | float, _band: Band, /) -> FloatArray:
        """Return zeros."""
        return np.zeros(np.broadcast(snr_db, length_bytes).shape)


class Threshold(Variant):
    """A receiver that gets everything at or above an SNR and nothing below it."""

    model: Literal["threshold"] = "threshold"
    snr_min_db: float = Field(description="lowest SNR at which a packet is received")

    def ber(self, snr_db: FloatArray, _band: Band, /) -> FloatArray:
        """Return 0 at or above the threshold, 0.5 below it."""
        return np.where(np.greater_equal(snr_db, self.snr_min_db), 0.0, 0.5)

    def per(self, snr_db: FloatArray, length_bytes: FloatArray | float, _band: Band, /) -> FloatArray:
        """Return 0 at or above the threshold, 1 below it."""
        below = np.less(snr_db, self.snr_min_db)
        return np.where(np.broadcast_arrays(below, length_bytes)[0], 1.0, 0.0)
