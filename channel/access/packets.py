"""What enters a medium, what it puts on the air, and what comes out of it."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray


class Loss(StrEnum):
    """Why a packet did not come to a receiver."""

    TOO_LONG = "too_long"
    """No frame of this radio has room for it."""
    QUEUE_FULL = "queue_full"
    EXPIRED = "expired"
    """It waited longer than its life time."""
    REPLACED = "replaced"
    """A newer packet with its key took its place in the queue."""
    HALF_DUPLEX = "half_duplex"
    """The receiver transmitted."""
    INTERFERED = "interfered"
    """It would have come through without what emitters, other sources of interference and other networks add."""
    COLLIDED = "collided"
    """It would have come through if no other frame of the network had been on the air."""
    NOISE = "noise"
    """Too weak, or too many errors of the channel alone."""
    RETRIES = "retries_exhausted"
    """A unicast was never acknowledged."""
    RADIO_OFF = "radio_off"
    """The radio of its sender, or of the node that a unicast is for, was switched off."""
    NO_LOCK = "no_lock"
    """The receiver listened on another channel: hopping radios that have not found each other."""
    NO_PEER = "no_peer"
    """The radio has no link to that node."""
    OUTAGE = "outage"
    """The link of the sender or of the receiver was down."""
    NO_ROUTE = "no_route"
    """A node on its way knew no next one (`channel.routing`)."""
    HOP_LIMIT = "hop_limit"
    """It was handed on as often as it may be."""
    PARTITIONED = "partitioned"
    """Its sender and the node that it was for were in groups that do not hear each other."""


class Handling(NamedTuple):
    """What an agent wants of its radio for a packet.

    Attributes:
        priority: packets of higher ones leave the queue first.
        lifetime_ns: after so long in the queue it is dropped; None: it waits for ever.
        key: a queued packet of the same node and key gives way to it; empty: none does.
    """

    priority: int = 0
    lifetime_ns: int | None = None
    key: str = ""


PLAIN: Final = Handling()


@dataclass(frozen=True, slots=True)
class AirPacket:
    """One packet as its sender gives it to its radio.

    Attributes:
        node: who sends it.
        number: of its sender, rising.
        to: the node that it is for; None: all that hear it, or a group of these, without acknowledgement.
        length_bytes: of what the sender gave, 0 or more.
        at_ns: the instant at which it enters the radio.
        priority: packets of higher ones leave the queue first.
        lifetime_ns: after so long in the queue it is dropped; None: it waits for ever.
        key: a queued packet of the same node and key gives way to it; empty: none does.
        members: of the group that it is for, without acknowledgement, and ``to`` is None; None: it is for no group.
    """

    node: int
    number: int
    to: int | None
    length_bytes: int
    at_ns: int
    priority: int = 0
    lifetime_ns: int | None = None
    key: str = ""
    members: frozenset[int] | None = None

    @property
    def is_from_above(self) -> bool:
        """Whether a layer above routing sent it, with headers of its own, as IP does; else it is routing's own."""
        return True

    @property
    def order(self) -> int:
        """Of two packets of one sender and key the newer one has the higher."""
        return self.number

    def is_for(self, node: int) -> bool:
        """Whether a node is to have it; of others that hear it there is no fate."""
        if self.to is not None:
            return node == self.to
        return node != self.node and (self.members is None or node in self.members)


@dataclass(slots=True, eq=False)
class AirFrame:
    """What is on the air: who, when, and how much of what.

    Attributes:
        node: the transmitter.
        number: of its transmissions, rising from 0: what is drawn for a frame hangs on it.
        kind: what a medium distinguishes frames by.
        length_bytes: on the air, with its headers.
        started_ns, ended_ns: at the transmitter.
        packet: what it carries; None for control.
        to: the node that a control frame is for.
        reserved_ns: how long after its end others keep quiet (NAV).
        attempt: the how-manieth transmission of the same.
        channel: on which only those hear it that listen there.
        bit_rate_bps: at which its errors are reckoned; None: the radio's.
        in_turn: it is its node's turn, which transmits something whatever became of its frames before.
        met: what its world keeps of it; nobody else's.
    """

    node: int
    number: int
    kind: str
    length_bytes: int
    started_ns: int
    ended_ns: int
    packet: AirPacket | None = None
    to: int | None = None
    reserved_ns: int = 0
    attempt: int = 1
    channel: int = 0
    bit_rate_bps: float | None = None
    in_turn: bool = False
    met: object = field(default=None, repr=False)

    @property
    def is_fair(self) -> bool:
        """Whether it shows how good the channel is: frames that are tried again are more where it is bad."""
        return self.in_turn or (self.kind == "data" and self.attempt == 1)

    @property
    def is_broadcast(self) -> bool:
        """Whether it carries a packet for all, so that nobody answers it."""
        packet = self.packet
        return packet is not None and packet.to is None and self.to is None and not self.reserved_ns


@dataclass(frozen=True, slots=True)
class AirFate:
    """What became of a packet at one receiver.

    Attributes:
        packet: which.
        receiver: the node.
        at_ns: when it arrived, or was lost for good.
        started_ns, ended_ns: the transmission that decided; -1 if it never was on the air.
        attempts: how often it was on the air.
        loss: why it was lost; None: it arrived.
        frame: that transmission; None if it never was on the air.
        met_at: the node at which that was heard or lost; None: the receiver.
        way: who transmitted it, from its sender on, if others handed it on (`channel.routing`).
        parts: in how many pieces the receiver's radio had it, each as it came; what was tried again counts once.
    """

    packet: AirPacket
    receiver: int
    at_ns: int
    started_ns: int
    ended_ns: int
    attempts: int
    loss: Loss | None
    frame: AirFrame | None = field(default=None, compare=False, repr=False)
    met_at: int | None = None
    way: tuple[int, ...] = ()
    parts: int = 1


@dataclass(frozen=True, slots=True, eq=False)
class AirFates:
    """What became of a packet at several receivers by its only transmission, as columns: it came, or noise took it.

    Attributes:
        packet: which.
        frame: that transmission.
        receiver: the nodes.
        at_ns: when it arrived at each, or was lost.
        came: whether it arrived.
    """

    packet: AirPacket
    frame: AirFrame
    receiver: NDArray[np.intp]
    at_ns: NDArray[np.int64]
    came: NDArray[np.bool_]

    def singly(self) -> list[AirFate]:
        """One by one."""
        packet, frame = self.packet, self.frame
        columns = self.receiver.tolist(), self.at_ns.tolist(), self.came.tolist()
        return [
            AirFate(packet, rx, at, frame.started_ns, frame.ended_ns, 1, None if came else Loss.NOISE, frame)
            for rx, at, came in zip(*columns, strict=True)
        ]


@dataclass(frozen=True, slots=True)
class Reply:
    """What a sender learns of its unicast: acknowledged, or given up."""

    packet: AirPacket
    at_ns: int
    acknowledged: bool
    attempts: int


Outcome = AirFate | Reply
