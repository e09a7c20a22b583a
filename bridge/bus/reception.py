"""What a receiver knows of a packet beside its bytes, and how that travels on Zenoh."""

from __future__ import annotations

import math
import struct
from typing import NamedTuple

from bridge.bus.keys import MAIN
from bridge.bus.session import Sample, Stamp

_SIGNAL = struct.Struct("<ff4q")
"""RSSI, SNR and instants, behind the stamp in the attachment of what was received; the radio's name comes last."""


class Instants(NamedTuple):
    """When what happened to a packet, ns of sim time; -1: not known.

    Attributes:
        entered_ns: it entered its sender's radio.
        started_ns, ended_ns: the transmission that brought it began and ended, at the sender.
        arrived_ns: it was at the receiver.
    """

    entered_ns: int = -1
    started_ns: int = -1
    ended_ns: int = -1
    arrived_ns: int = -1


UNKNOWN = Instants()


class Reception(NamedTuple):
    """One packet at one receiver, as a real receiver knows it.

    Attributes:
        seq: the sender's sequence number.
        sim_time_ns: when it was sent, by the sender's stamp.
        received_ns: the tick at which it came, sim time.
        rssi_dbm: power in which this very packet arrived, with its shadowing and fading; NaN where it is not known.
        snr_db: the same over the noise.
        instants: of its way through the radios; with a medium that takes no time all are ``sim_time_ns``.
        radio: name of the receiver's radio that it came by, which is that of the network.
    """

    seq: int
    sim_time_ns: int
    received_ns: int
    rssi_dbm: float = math.nan
    snr_db: float = math.nan
    instants: Instants = UNKNOWN
    radio: str = MAIN

    @property
    def delay_s(self) -> float:
        """From its sender's stamp to its arrival, s; NaN where it is not known."""
        arrived_ns = self.instants.arrived_ns
        return math.nan if arrived_ns < 0 else (arrived_ns - self.sim_time_ns) / 1e9

    @property
    def age_s(self) -> float:
        """How old it was when it came, s."""
        return (self.received_ns - self.sim_time_ns) / 1e9


def attachment(
    stamp: bytes, rssi_dbm: float, snr_db: float, instants: Instants = UNKNOWN, radio: str = MAIN
) -> bytes:
    """The attachment of a packet that was received: its stamp's bytes, and how and by which radio it came in."""
    return stamp + _SIGNAL.pack(rssi_dbm, snr_db, *instants) + radio.encode()


def signal_of(sample: Sample) -> tuple[float, float, Instants]:
    """RSSI, dBm, SNR, dB, and instants of a sample with a stamp; NaN and unknown if it does not say."""
    raw = _behind_the_stamp(sample)
    if len(raw) < _SIGNAL.size:
        return math.nan, math.nan, UNKNOWN
    rssi_dbm, snr_db, *instants = _SIGNAL.unpack_from(raw)
    return rssi_dbm, snr_db, Instants(*instants)


def radio_of(sample: Sample) -> str:
    """Name of the radio that a sample came by; `main` if it does not say."""
    return _behind_the_stamp(sample)[_SIGNAL.size :].decode(errors="replace") or MAIN


def _behind_the_stamp(sample: Sample) -> bytes:
    return b"" if sample.attachment is None else sample.attachment.to_bytes()[Stamp.SIZE_BYTES :]
