"""How long a frame lasts."""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, inf
from typing import Protocol

US = 1_000
NS_PER_S = 1_000_000_000
LEAST_BPS = 1e-3
"""So that the longest packet ends at an instant that can be counted in ns."""


class FrameTiming(Protocol):
    """From a packet's length to its time on the air."""

    @property
    def max_length_bytes(self) -> int:
        """The longest packet."""

    @property
    def header_bytes(self) -> int:
        """That each packet gets."""

    def duration_ns(self, length_bytes: int) -> int:
        """Of a frame that carries so much."""


@dataclass(frozen=True, slots=True)
class BitRate:
    """A plain serial radio: preamble, then headers and packet at one rate.

    Attributes:
        bitrate_bps: on the air.
        preamble_ns: before each frame.
        header_bytes: that each packet gets.
        max_length_bytes: the longest packet.
    """

    bitrate_bps: float
    preamble_ns: int = 0
    header_bytes: int = 0
    max_length_bytes: int = 65_535

    def __post_init__(self) -> None:
        if not LEAST_BPS <= self.bitrate_bps < inf:
            raise ValueError(f"bit rate {self.bitrate_bps:g} bit/s: at least {LEAST_BPS:g}")

    def duration_ns(self, length_bytes: int) -> int:
        """To the nearest ns, half up; at least 1."""
        bits = 8 * (length_bytes + self.header_bytes)
        return max(1, self.preamble_ns + int(bits * NS_PER_S / self.bitrate_bps + 0.5))


MAC_HEADER_BYTES, FCS_BYTES, LLC_BYTES = 24, 4, 8
MAX_MSDU_BYTES = 2304
"""IEEE 802.11-2020, 9.2.4.8.1: the longest MSDU, of which LLC and SNAP are a part."""
ACK_BYTES, CTS_BYTES, RTS_BYTES = 14, 14, 20
"""IEEE 802.11-2020, 9.3: a data frame with three addresses, LLC and SNAP in its body; control frames with FCS."""

OFDM_MBPS = 6.0, 9.0, 12.0, 18.0, 24.0, 36.0, 48.0, 54.0
LOWEST_B_MBPS, LOWEST_OFDM_MBPS = 1.0, 6.0
SHORT_FROM_MBPS = 2.0
"""IEEE 802.11-2020, 16.2.2.3: the body of a frame with the short preamble is at 2 Mb/s or more."""


@dataclass(frozen=True, slots=True)
class Wifi:
    """Timing of IEEE 802.11: DSSS and HR-DSSS (clauses 15, 16) or OFDM (clauses 17, 18).

    Attributes:
        rate_mbps: of data.
        basic_rate_mbps: of control frames and broadcasts.
        slot_ns, sifs_ns: of the PHY.
        cw_min, cw_max: contention windows, slots.
        preamble_ns: preamble and PLCP header.
        symbol_ns: of OFDM; 0: DSSS, which has none.
        extension_ns: signal extension after an OFDM frame at 2.4 GHz.
        header_bytes: MAC header, LLC and FCS.
        max_length_bytes: the longest packet.
        lowest_rate_mbps: that the PHY must have; None: the basic rate.
        short_preamble_ns: of frames at 2 Mb/s or more, if these have the short one; None: they have not.
    """

    rate_mbps: float
    basic_rate_mbps: float
    slot_ns: int
    sifs_ns: int
    cw_min: int
    cw_max: int
    preamble_ns: int
    symbol_ns: int = 0
    extension_ns: int = 0
    header_bytes: int = MAC_HEADER_BYTES + LLC_BYTES + FCS_BYTES
    max_length_bytes: int = MAX_MSDU_BYTES - LLC_BYTES
    lowest_rate_mbps: float | None = None
    short_preamble_ns: int | None = None

    @property
    def difs_ns(self) -> int:
        """SIFS and two slots (10.3.2.3.5)."""
        return self.sifs_ns + 2 * self.slot_ns

    @property
    def eifs_ns(self) -> int:
        """SIFS, an ACK at the lowest rate, DIFS (10.3.2.3.7)."""
        return (
            self.sifs_ns + self._ns(ACK_BYTES, self.lowest_rate_mbps or self.basic_rate_mbps) + self.difs_ns
        )

    def duration_ns(self, length_bytes: int) -> int:
        """Of a data frame at the data rate."""
        return self._ns(length_bytes + self.header_bytes, self.rate_mbps)

    def broadcast_ns(self, length_bytes: int) -> int:
        """Of a data frame at the basic rate."""
        return self._ns(length_bytes + self.header_bytes, self.basic_rate_mbps)

    def control_ns(self, length_bytes: int) -> int:
        """Of an ACK, RTS or CTS, at the basic rate."""
        return self._ns(length_bytes, self.basic_rate_mbps)

    def _ns(self, length_bytes: int, rate_mbps: float) -> int:
        if not self.symbol_ns:  # bits last whole microseconds, rounded up (16.3.4)
            preamble_ns = self.preamble_ns
            if self.short_preamble_ns is not None and rate_mbps >= SHORT_FROM_MBPS:
                preamble_ns = self.short_preamble_ns
            return preamble_ns + ceil(8 * length_bytes / rate_mbps - 1e-9) * US
        bits_per_symbol = rate_mbps * self.symbol_ns / US
        symbols = ceil((22 + 8 * length_bytes) / bits_per_symbol - 1e-9)  # service and tail bits (17.4.3)
        return self.preamble_ns + symbols * self.symbol_ns + self.extension_ns


def wifi_b(rate_mbps: float = 11.0, basic_rate_mbps: float = 1.0, *, short_preamble: bool = False) -> Wifi:
    """802.11b."""
    _known("802.11b", rate_mbps, basic_rate_mbps, (1.0, 2.0, 5.5, 11.0))
    return Wifi(
        rate_mbps,
        basic_rate_mbps,
        20 * US,
        10 * US,
        31,
        1023,
        192 * US,
        lowest_rate_mbps=LOWEST_B_MBPS,
        short_preamble_ns=96 * US if short_preamble else None,
    )


def wifi_a(rate_mbps: float = 6.0, basic_rate_mbps: float = 6.0, *, clock: float = 1.0) -> Wifi:
    """802.11a; ``clock`` 0.5 and 0.25 are the channels of 10 and 5 MHz, whose rates and times scale with it.

    Args:
        rate_mbps: nominal, that of 20 MHz.
        basic_rate_mbps: likewise.
        clock: of the symbols, 1 at 20 MHz.
    """
    _known("802.11a", rate_mbps, basic_rate_mbps, OFDM_MBPS)
    scaled = {1.0: (9, 16), 0.5: (13, 32), 0.25: (21, 64)}
    if clock not in scaled:
        raise ValueError(f"clock {clock:g}: 1, 0.5 or 0.25")
    slot_us, sifs_us = scaled[clock]
    return Wifi(
        rate_mbps * clock,
        basic_rate_mbps * clock,
        slot_us * US,
        sifs_us * US,
        15,
        1023,
        int(20 * US / clock),
        symbol_ns=int(4 * US / clock),
        lowest_rate_mbps=LOWEST_OFDM_MBPS * clock,
    )


def wifi_g(rate_mbps: float = 6.0, basic_rate_mbps: float = 6.0) -> Wifi:
    """802.11g alone (no 802.11b about): as 802.11a, with a SIFS of 10 us and a signal extension of 6 us."""
    _known("802.11g", rate_mbps, basic_rate_mbps, OFDM_MBPS)
    return Wifi(
        rate_mbps,
        basic_rate_mbps,
        9 * US,
        10 * US,
        15,
        1023,
        20 * US,
        symbol_ns=4 * US,
        extension_ns=6 * US,
        lowest_rate_mbps=LOWEST_OFDM_MBPS,
    )


def _known(standard: str, rate_mbps: float, basic_rate_mbps: float, rates: tuple[float, ...]) -> None:
    for text, rate in (("", rate_mbps), ("a basic rate of ", basic_rate_mbps)):
        if rate not in rates:
            known = ", ".join(f"{each:g}" for each in rates)
            raise ValueError(f"{standard} at {text}{rate:g} Mb/s: one of {known}")
