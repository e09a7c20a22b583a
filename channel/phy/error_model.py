"""From the signal-to-noise ratio to the probability that a packet is lost."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field, model_validator

from channel.checks import FloatArray
from channel.numbers.units import ratio_from_db
from channel.phy import golay, modulation
from channel.variant import Variant

MAX_BER = 1.0 - 2.0**-53
"""The highest bit error rate below 1."""
LOG_OF_NONE = -1e100
"""For log(1 - ber) where ber is 1: the least part of a packet is lost, and no packet at all is not."""
BITS_PER_BYTE = 8
MAX_SNR_DB = 3000.0


@dataclass(frozen=True, slots=True)
class Band:
    """What turns SNR into Eb/N0: noise bandwidth in Hz and bit rate on air in bit/s."""

    bandwidth_hz: float
    bit_rate_bps: float


class ErrorModel(Protocol):
    """SNR in, bit and packet error rate out."""

    @property
    def breaks_db(self) -> tuple[float, ...]:
        """SNRs at which the packet error rate jumps or bends, from low to high."""
        ...

    def ber(self, snr_db: FloatArray, band: Band, /) -> FloatArray:
        """Return the bit error rate, in [0, 1], same shape."""
        ...

    def per(self, snr_db: FloatArray, length_bytes: FloatArray | float, band: Band, /) -> FloatArray:
        """Return the packet error rate, in [0, 1], broadcast shape."""
        ...


def packet_error(ber: FloatArray, trials: FloatArray | float) -> FloatArray:
    """Return 1 - (1 - ber)^trials, exact down to ber 1e-300: -expm1(n log1p(-ber)).

    Args:
        ber: error rate of one trial (a bit, or the paper's byte), in [0, 1].
        trials: how many of them a packet has, >= 0.
    """
    kept = np.where(np.less(ber, 1.0), np.log1p(np.negative(np.minimum(ber, MAX_BER))), LOG_OF_NONE)
    return np.negative(np.expm1(np.multiply(trials, kept)))


def linear_snr(snr_db: FloatArray) -> FloatArray:
    """Return the linear ratio, with SNR held to 3000 dB so that nothing overflows."""
    return ratio_from_db(np.minimum(snr_db, MAX_SNR_DB))


class Smooth(Variant):
    """What error models without jumps share."""

    @property
    def breaks_db(self) -> tuple[float, ...]:
        """None."""
        return ()


class ErfcBytes(Smooth):
    """The paper's error model: ber = erfc(sqrt(SNR)), per = 1 - (1 - ber)^bytes (eq. 5 and 6).

    Bytes stand where bits belong, and a factor of one half is missing: as printed, and as the simulators
    it comes from have it.
    """

    model: Literal["erfc-bytes"] = "erfc-bytes"

    def ber(self, snr_db: FloatArray, _band: Band, /) -> FloatArray:
        """Return erfc(sqrt(SNR))."""
        return modulation.erfc_of_root(linear_snr(snr_db))

    def per(self, snr_db: FloatArray, length_bytes: FloatArray | float, band: Band, /) -> FloatArray:
        """Return 1 - (1 - ber)^length_bytes."""
        return packet_error(self.ber(snr_db, band), length_bytes)


class UncodedAwgn(Smooth):
    """Textbook modulation over white noise, no coding: Eb/N0 = SNR * bandwidth / bit rate, bits as trials."""

    model: Literal["uncoded-awgn"] = "uncoded-awgn"
    modulation: Literal["bpsk", "qpsk", "16qam", "64qam"] = Field(default="qpsk")

    def ber(self, snr_db: FloatArray, band: Band, /) -> FloatArray:
        """Return the bit error rate of the modulation."""
        return _AWGN_BER[self.modulation](linear_snr(snr_db) * (band.bandwidth_hz / band.bit_rate_bps))

    def per(self, snr_db: FloatArray, length_bytes: FloatArray | float, band: Band, /) -> FloatArray:
        """Return 1 - (1 - ber)^(8 length_bytes)."""
        trials = np.multiply(length_bytes, BITS_PER_BYTE)
        return packet_error(self.ber(snr_db, band), trials)


_AWGN_BER: dict[str, Callable[[ArrayLike], FloatArray]] = {
    "bpsk": modulation.ber_bpsk,
    "qpsk": modulation.ber_qpsk,
    "16qam": lambda ebn0: modulation.ber_square_qam(ebn0, 16),
    "64qam": lambda ebn0: modulation.ber_square_qam(ebn0, 64),
}


class NoncoherentFsk(Smooth):
    """Binary FSK or GFSK of index 1 or more, detected without its phase, plain or coded by Golay(23,12).

    Coded, 12 bits of the packet become a word of 23 bits, of which any three may be wrong. The length is that before
    coding: what counts as a part of a word.
    """

    model: Literal["noncoherent-fsk"] = "noncoherent-fsk"
    coding: Literal["none", "golay"] = Field(default="none", description="golay: Golay(23,12), as SiK's ECC")

    def ber(self, snr_db: FloatArray, band: Band, /) -> FloatArray:
        """Return the bit error rate on the air, before decoding."""
        return modulation.ber_noncoherent_fsk(linear_snr(snr_db) * (band.bandwidth_hz / band.bit_rate_bps))

    def per(self, snr_db: FloatArray, length_bytes: FloatArray | float, band: Band, /) -> FloatArray:
        """Return 1 - (1 - p)^n: of bits, or of words."""
        ber, bits = self.ber(snr_db, band), np.multiply(length_bytes, BITS_PER_BYTE)
        if self.coding == "none":
            return packet_error(ber, bits)
        return packet_error(golay.word_error(ber), np.divide(bits, golay.DATA_BITS))


class Lossless(Smooth):
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

    @property
    def breaks_db(self) -> tuple[float, ...]:
        """The threshold."""
        return (self.snr_min_db,)

    def ber(self, snr_db: FloatArray, _band: Band, /) -> FloatArray:
        """Return 0 at or above the threshold, 0.5 below it."""
        return np.where(np.greater_equal(snr_db, self.snr_min_db), 0.0, 0.5)

    def per(self, snr_db: FloatArray, length_bytes: FloatArray | float, _band: Band, /) -> FloatArray:
        """Return 0 at or above the threshold, 1 below it."""
        below = np.less(snr_db, self.snr_min_db)
        return np.where(below, 1.0, np.multiply(length_bytes, 0.0))


class SnrTable(Variant):
    """A measured curve: packet error rates by SNR at one length, between them linear in SNR.

    Beyond its ends the table stays at its last value. Other lengths follow from the same error rate per byte:
    1 - (1 - per)^(length / reference_length_bytes), which is 1 for all of them where the table has 1.
    """

    model: Literal["snr-table"] = "snr-table"
    table: tuple[tuple[float, float], ...] = Field(
        min_length=2, description="rows of snr_db, per; or table_file"
    )
    reference_length_bytes: int = Field(default=100, gt=0)

    @model_validator(mode="after")
    def _is_a_curve(self) -> SnrTable:
        snr_db, per = np.asarray(self.table).T
        if np.any(np.diff(snr_db) <= 0.0):
            raise ValueError("snr_db has to rise from row to row")
        if np.any((per < 0.0) | (per > 1.0)) or np.any(np.diff(per) > 0.0):
            raise ValueError("per has to be in [0, 1] and must not rise with SNR")
        return self

    @property
    def breaks_db(self) -> tuple[float, ...]:
        """The SNRs of the rows."""
        return tuple(snr_db for snr_db, _ in self.table)

    def _reference_per(self, snr_db: FloatArray) -> FloatArray:
        grid_db, per = np.asarray(self.table).T
        return np.asarray(np.interp(snr_db, grid_db, per))

    def ber(self, snr_db: FloatArray, _band: Band, /) -> FloatArray:
        """Return the bit error rate that gives the table's packet error rate at its length."""
        return packet_error(self._reference_per(snr_db), 1.0 / (BITS_PER_BYTE * self.reference_length_bytes))

    def per(self, snr_db: FloatArray, length_bytes: FloatArray | float, _band: Band, /) -> FloatArray:
        """Return the table's rate, scaled to the length."""
        return packet_error(self._reference_per(snr_db), np.divide(length_bytes, self.reference_length_bytes))
