"""The senders: who numbers which packets, and what is not taken from them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from enum import StrEnum

from bridge.record.packets import SentPacket
from bridge.record.tables.deliveries import Cause, Gap
from channel.medium.reception import EVERYBODY

MAX_GAP = 100_000
"""A sequence number that jumps further than this is taken for garbage, not for lost packets."""
TAKEN_MAX_BYTES = 64 << 20
"""Payload that one node's packets of one tick may have together; more is more than any radio of ours sends."""
TAKEN_MAX = 100_000
"""Packets of one node in one tick."""


class Refused(StrEnum):
    """Why something that came in from Zenoh was not taken."""

    UNKNOWN_NODE = "unknown_node"
    UNKNOWN_ADDRESS = "unknown_address"
    UNKNOWN_RADIO = "unknown_radio"
    MALFORMED = "malformed"
    WITHOUT_STAMP = "without_stamp"
    REPEATED = "repeated_sequence_number"
    BACKWARDS = "stamped_before_the_one_before"
    OVERLOAD = "overload"
    REPEATS = "repeats_a_record"


@dataclass(frozen=True, slots=True, kw_only=True)
class TxPacket(SentPacket):
    """What a node gave to the radio, with its ends.

    Attributes:
        tx: index of the sender.
        to: index of the addressee, EVERYBODY, or a group's code.
        network: place of its radio network among those of the run.
    """

    tx: int
    to: int
    network: int = 0


class Senders:
    """Takes packets of numbered senders.

    Args:
        mtu_bytes: by network, of each node's radio, by index.
        on_gap: called with packets that are lost before the channel.
    """

    def __init__(self, mtu_bytes: Iterable[Sequence[int]], on_gap: Callable[[Gap], object]) -> None:
        self._mtu_bytes = tuple(mtu_bytes)
        nodes = len(self._mtu_bytes[0])
        self._next_seq = [0] * nodes
        self._bytes = [0] * nodes
        self._counts = [0] * nodes
        self._latest_ns = [0] * nodes
        self._on_gap = on_gap
        self._taken: list[TxPacket] = []
        self.refused: Counter[Refused] = Counter()

    def take(self, packet: TxPacket) -> bool:
        """Take a packet; returns whether it was."""
        why = self._why_refused(packet)
        if why is not None:
            self.refused[why] += 1
            if why is Refused.OVERLOAD:  # its sender goes on from here
                self.book_missing(packet.tx, packet.seq + 1, packet.sim_time_ns)
            return False
        self.book_missing(packet.tx, packet.seq, packet.sim_time_ns)
        self._next_seq[packet.tx] = packet.seq + 1
        self._latest_ns[packet.tx] = packet.sim_time_ns
        self._counts[packet.tx] += 1
        length = len(packet.payload)
        if length > self._mtu_bytes[packet.network][packet.tx]:
            what = (length, Cause.TOO_LONG, packet.channel, packet.encoding, packet.radio)
            self._on_gap(Gap(packet.sim_time_ns, packet.tx, packet.to, packet.seq, 1, *what))
            return True
        self._bytes[packet.tx] += length
        self._taken.append(packet)
        return True

    def _why_refused(self, packet: TxPacket) -> Refused | None:
        tx, ahead = packet.tx, packet.seq - self._next_seq[packet.tx]
        if ahead < 0:
            return Refused.REPEATED
        if ahead > MAX_GAP:
            return Refused.MALFORMED
        if packet.sim_time_ns < self._latest_ns[tx]:
            return Refused.BACKWARDS
        if self._counts[tx] >= TAKEN_MAX or self._bytes[tx] + len(packet.payload) > TAKEN_MAX_BYTES:
            return Refused.OVERLOAD
        return None

    def book_missing(self, tx: int, seq: int, sim_time_ns: int) -> None:
        """Book the packets before ``seq`` that never came."""
        first, count = self._next_seq[tx], seq - self._next_seq[tx]
        if count > 0:
            self._on_gap(Gap(sim_time_ns, tx, EVERYBODY, first, count, 0, Cause.TRANSPORT))
            self._next_seq[tx] = seq

    def lose(self, gap: Gap) -> None:
        """Book packets of which it is known what they were lost to."""
        self._next_seq[gap.tx] = max(self._next_seq[gap.tx], gap.first_seq + gap.packets)
        self._on_gap(gap)

    def told_total(self, tx: int, sent: int, sim_time_ns: int) -> bool:
        """Take a sender's own count of what it gave to the radio; returns whether it can be true."""
        if not 0 <= sent <= self._next_seq[tx] + MAX_GAP:
            return False
        self.book_missing(tx, sent, sim_time_ns)
        return True

    def next_packet(self, tx: int) -> tuple[int, int]:
        """Number of a sender's next packet, and the sim time that it may not be before, ns."""
        return self._next_seq[tx], self._latest_ns[tx]

    def taken(self) -> list[TxPacket]:
        """The packets since the last call, in the order of time, sender and number, whoever's came first."""
        taken, self._taken = self._taken, []
        self._bytes = [0] * len(self._bytes)
        self._counts = [0] * len(self._counts)
        taken.sort(key=lambda packet: (packet.sim_time_ns, packet.tx, packet.seq))
        return taken
