"""What a receiver knows of a packet beside its bytes, and how that travels on Zenoh."""

from __future__ import annotations

import math
import struct
from typing import NamedTuple

from bridge.bus.session import Sample, Stamp

_SIGNAL = struct.Struct("<ff")
"""RSSI and SNR, behind the stamp in the attachment of what was received."""


class Reception(NamedTuple):
    """One packet at one receiver, as a real receiver knows it.

    Attributes:
        seq: the sender's sequence number.
        sim_time_ns: when it was sent, by the sender's stamp.
        received_ns: the tick at which it came, sim time.
        rssi_dbm: power in which this very packet arrived, with its shadowing and fading; NaN where it is not known.
        snr_db: the same over the noise.
    """

    seq: int
    sim_time_ns: int
    received_ns: int
    rssi_dbm: float = math.nan
    snr_db: float = math.nan

    @property
    def age_s(self) -> float:
        """How old it was when it came, s."""
        return (self.received_ns - self.sim_time_ns) / 1e9


def attachment(stamp: bytes, rssi_dbm: float, snr_db: float) -> bytes:
    """The attachment of a packet that was received: its stamp's bytes, and how it came in."""
    return stamp + _SIGNAL.pack(rssi_dbm, snr_db)


def signal_of(sample: Sample) -> tuple[float, float]:
    """RSSI, dBm, and SNR, dB, of a sample with a stamp; NaN if it does not say."""
    raw = b"" if sample.attachment is None else sample.attachment.to_bytes()[Stamp.SIZE_BYTES :]
    if len(raw) != _SIGNAL.size:
        return math.nan, math.nan
    rssi_dbm, snr_db = _SIGNAL.unpack(raw)
    return rssi_dbm, snr_db
