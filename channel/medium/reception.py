"""Packets and what became of them at their receivers, as columns."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from channel.checks import FloatArray

EVERYBODY = -1
"""In `Packets.to`: every other node is an intended receiver. Below it are groups (`channel.medium.addressees`)."""


class Fate(Enum):
    """What became of a packet at one receiver: delivered, or the cause of its loss."""

    DELIVERED = "delivered"
    CHANNEL_ERASURE = "channel_erasure"
    OUT_OF_RANGE = "out_of_range"
    BASE_LOSS = "base_loss"
    BURST = "burst"
    BELOW_PREAMBLE = "below_preamble"
    """Its errors would have let it through, but it was too weak for its receiver to lock on to (`preamble_dbm`)."""
    NO_POSITION = "no_position"
    RADIO_OFF = "radio_off"
    """The radio of its sender or of its receiver was switched off when it was sent."""
    QUEUE_FULL = "queue_full"
    """Fates from here on are a medium's that takes time (`channel.access.packets.Loss`)."""
    EXPIRED = "expired"
    REPLACED = "replaced"
    TOO_LONG_FOR_A_SLOT = "too_long_for_a_slot"
    HALF_DUPLEX = "half_duplex"
    INTERFERED = "interfered"
    COLLIDED = "collided"
    RETRIES_EXHAUSTED = "retries_exhausted"
    NO_PEER = "no_peer"
    NO_LOCK = "no_lock"
    OUTAGE = "outage"
    RUN_ENDED = "run_ended"
    """It waited, or was on the air, when the run ended."""
    NO_ROUTE = "no_route"
    """Of networks whose nodes hand packets on (`channel.routing`), as is the next."""
    HOP_LIMIT = "hop_limit"
    PARTITIONED = "partitioned"
    """Its sender and its receiver were in groups that do not hear each other (`channel.medium.stations.partitions`)."""


FATES = tuple(Fate)
"""By the numbers in `Receptions.fate`."""
DELIVERED, ERASED, OUT_OF_RANGE, BASE_LOSS, BURST, BELOW_PREAMBLE, NO_POSITION, RADIO_OFF = range(8)
PARTITIONED = FATES.index(Fate.PARTITIONED)
UNDECIDED_FROM = NO_POSITION
"""With fates from here on the channel has nothing to do: it computes nothing for them, and no distance bin has them."""


class Packets(NamedTuple):
    """P packets as columns, in canonical order: by sim time, transmitter, sequence number.

    Attributes:
        sim_time_ns: when each was sent, int64, shape (P,).
        tx: transmitting node, as its index in `Medium.nodes`, intp.
        seq: the transmitter's sequence number, int64.
        length_bytes: of the payload, as given, int64.
        to: index of the one addressee, EVERYBODY, or a group's code, intp.
    """

    sim_time_ns: NDArray[np.int64]
    tx: NDArray[np.intp]
    seq: NDArray[np.int64]
    length_bytes: NDArray[np.int64]
    to: NDArray[np.intp]

    @property
    def size(self) -> int:
        """How many packets."""
        return len(self.tx)

    def at(self, rows: NDArray[np.intp] | NDArray[np.bool_] | slice) -> Packets:
        """Return some of the packets."""
        return Packets(*(column[rows] for column in self))

    def in_order(self) -> Packets:
        """Return the packets in canonical order."""
        if self._is_in_order():
            return self
        return self.at(np.lexsort((self.seq, self.tx, self.sim_time_ns)))

    def _is_in_order(self) -> bool:
        """Return whether each packet has a later time than the one before it, or the same and a later transmitter."""
        if self.size < 2:
            return True
        time, tx = self.sim_time_ns, self.tx
        in_order = time[1:] > time[:-1]
        in_order |= (time[1:] == time[:-1]) & (tx[1:] > tx[:-1])
        return int(np.count_nonzero(in_order)) == in_order.size

    @classmethod
    def joined(cls, parts: list[Packets]) -> Packets:
        """Return the packets of all parts."""
        if len(parts) == 1:
            return parts[0]
        return cls(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))


NO_PACKETS = Packets(*(np.empty(0, dtype=kind) for kind in (np.int64, np.intp, np.int64, np.int64, np.intp)))


@dataclass(frozen=True, slots=True)
class Receptions:
    """R receptions as columns: by packet, then by receiving node.

    Attributes:
        packets: what was settled, in canonical order.
        packet: row of `packets`, shape (R,).
        rx: intended receiver, as its index in `Medium.nodes`.
        distance_m: between the two at that instant, to 1 mm; NaN with `Fate.NO_POSITION`, `Fate.RADIO_OFF` and
            `Fate.PARTITIONED`, as are the next three.
        received_power_dbm: with the drawn shadowing and fading, to 0.001 dB; NaN where no draw could have saved the
            packet, so that none was made.
        snr_db: likewise.
        per: packet error rate at that SNR, to 1e-7; 1 out of range, and where nothing was drawn.
        probability_of_delivery: what the model says for this geometry, averaged over the random terms; to 1e-7.
        fate: index into FATES, uint8.
    """

    packets: Packets
    packet: NDArray[np.intp]
    rx: NDArray[np.intp]
    distance_m: FloatArray
    received_power_dbm: FloatArray
    snr_db: FloatArray
    per: FloatArray
    probability_of_delivery: FloatArray
    fate: NDArray[np.uint8]

    @classmethod
    def joined(cls, parts: Sequence[Receptions]) -> Receptions:
        """Return the receptions of all parts, at least one, one after the other."""
        starts = np.cumsum([0, *(part.packets.size for part in parts[:-1])])
        columns = [
            np.concatenate([getattr(part, name) for part in parts])
            for name in ("rx", "distance_m", "received_power_dbm", "snr_db", "per", "probability_of_delivery")
        ]
        return cls(
            Packets.joined([part.packets for part in parts]),
            np.concatenate([part.packet + start for part, start in zip(parts, starts.tolist(), strict=True)]),
            columns[0],
            columns[1],
            columns[2],
            columns[3],
            columns[4],
            columns[5],
            np.concatenate([part.fate for part in parts]),
        )

    def at(self, rows: NDArray[np.intp]) -> Receptions:
        """Return some of the receptions, of the same packets, in the order of ``rows``."""
        return Receptions(
            self.packets,
            self.packet[rows],
            self.rx[rows],
            self.distance_m[rows],
            self.received_power_dbm[rows],
            self.snr_db[rows],
            self.per[rows],
            self.probability_of_delivery[rows],
            self.fate[rows],
        )

    @property
    def size(self) -> int:
        """How many receptions."""
        return len(self.rx)

    @property
    def tx(self) -> NDArray[np.intp]:
        """Transmitting node of each, as its index in `Medium.nodes`."""
        return self.packets.tx[self.packet]
