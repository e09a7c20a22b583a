"""What became of a packet at one receiver."""

from __future__ import annotations

from enum import Enum
from typing import NamedTuple


class Fate(Enum):
    """What became of a packet at one receiver: delivered, or the cause of its loss."""

    DELIVERED = "delivered"
    CHANNEL_ERASURE = "channel_erasure"
    OUT_OF_RANGE = "out_of_range"
    BASE_LOSS = "base_loss"
    BURST = "burst"
    NO_POSITION = "no_position"


class Reception(NamedTuple):
    """One packet at one receiver.

    Attributes:
        sim_time_ns: when it was transmitted.
        tx: transmitting node.
        rx: intended receiver.
        seq: the transmitter's sequence number.
        length_bytes: as the error model counted it.
        distance_m: between the two at that instant, to 1 mm; NaN with `Fate.NO_POSITION`, as are the next three.
        received_power_dbm: with the drawn shadowing and fading, to 0.001 dB.
        snr_db: likewise.
        per: packet error rate at that SNR, to 1e-7; 1 out of range.
        fate: delivered, or the cause of the loss.
        probability_of_delivery: what the model says for this geometry, averaged over the random terms; to 1e-7.
    """

    sim_time_ns: int
    tx: str
    rx: str
    seq: int
    length_bytes: int
    distance_m: float
    received_power_dbm: float
    snr_db: float
    per: float
    fate: Fate
    probability_of_delivery: float


class Packet(NamedTuple):
    """A packet on its way, its transmitter by index.

    Ordered by time, then transmitter, then sequence number: the order in which packets settle.
    """

    sim_time_ns: int
    tx: int
    seq: int
    length_bytes: int


FATES = tuple(Fate)
