"""Bit error rates by modulation over additive white Gaussian noise, uncoded."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from channel.checks import ChannelInputError, FloatArray, finite
from channel.numbers import special


def erfc_of_root(ratio: FloatArray) -> FloatArray:
    """Return erfc(sqrt(x)) of what is known to be >= 0."""
    result: FloatArray = special.erfc(np.sqrt(ratio))
    return result


def ber_bpsk(ebn0: ArrayLike) -> FloatArray:
    """Return 0.5 erfc(sqrt(Eb/N0)) (Proakis, Digital Communications, 5th ed., eq. 4.3-13).

    Args:
        ebn0: energy per bit over noise density, linear, >= 0, any shape.

    Raises:
        ChannelInputError: `ebn0` is negative or not finite.
    """
    return 0.5 * erfc_of_root(finite("ebn0", ebn0, 0.0))


def ber_qpsk(ebn0: ArrayLike) -> FloatArray:
    """Return the bit error rate of Gray-coded QPSK: that of BPSK (Proakis, sec. 4.3-2)."""
    return ber_bpsk(ebn0)


def ber_noncoherent_fsk(ebn0: ArrayLike) -> FloatArray:
    """Return 0.5 exp(-Eb / 2 N0): orthogonal binary FSK, detected without its phase (Proakis, eq. 4.5-46).

    Raises:
        ChannelInputError: `ebn0` is negative or not finite.
    """
    return np.asarray(0.5 * np.exp(-0.5 * finite("ebn0", ebn0, 0.0)))


def ber_square_qam(ebn0: ArrayLike, order: int) -> FloatArray:
    """Return the exact bit error rate of Gray-coded square M-QAM.

    Cho & Yoon, "On the general BER expression of one- and two-dimensional amplitude modulations",
    IEEE Trans. Commun. 50 (2002), eq. 14 and 16; valid at any SNR, not only high ones.

    Args:
        ebn0: energy per bit over noise density, linear, >= 0, any shape.
        order: M, a power of 4 (4, 16, 64, 256).

    Raises:
        ChannelInputError: `ebn0` is negative or not finite, or `order` is none of these.
    """
    if order not in (4, 16, 64, 256):
        raise ChannelInputError("order", order, "4, 16, 64 or 256")
    ebn0 = finite("ebn0", ebn0, 0.0)
    side = math.isqrt(order)
    bits_per_axis = side.bit_length() - 1
    argument = np.sqrt(np.multiply(ebn0, 3.0 * math.log2(order) / (2.0 * (order - 1))))
    total = np.zeros_like(argument)
    for k in range(1, bits_per_axis + 1):
        step = 2 ** (k - 1)
        for i in range(side - side // 2**k):
            sign = (-1) ** (i * step // side)
            weight = step - math.floor(i * step / side + 0.5)
            total = total + sign * weight * special.erfc((2 * i + 1) * argument)
    return np.asarray(np.clip(total / (side * bits_per_axis), 0.0, 0.5))
