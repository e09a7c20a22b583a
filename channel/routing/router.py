"""What a way of routing decides: where a node sends a packet on, and what nodes tell each other about routes.

A router knows no medium: it is asked at instants, and answers with what is to enter the radio after how long.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from channel.access.packets import AirPacket, Loss
from channel.access.words import WordStream
from channel.draws import Draws


class Hop(NamedTuple):
    """One transmission of a packet by a node.

    Attributes:
        to: the next node; None: all that hear it.
        delay_ns: before it enters the radio.
    """

    to: int | None
    delay_ns: int = 0


class Notice(NamedTuple):
    """What a node tells its neighbours about routes.

    Attributes:
        content: the router's own.
        length_bytes: as the medium gets it: with headers of its own, of IP too if it has them.
        delay_ns: before it enters the radio.
    """

    content: object
    length_bytes: int
    delay_ns: int = 0


Onward = Sequence[Hop] | Loss
"""How a packet goes on; or why it cannot."""


class Forwarding(NamedTuple):
    """How long a node takes to hand a packet on.

    Attributes:
        least_ns: always.
        spread_ns: up to so much is added, drawn for each packet and node.
    """

    least_ns: int = 0
    spread_ns: int = 0


class HopRouter:
    """The nodes of one network. This one sends to receivers directly, and hands nothing on.

    Args:
        nodes: their ids.
        draws: of the network: what a node draws hangs on its id, and on how often it has drawn.
        forwarding: of all nodes.

    Attributes:
        notice_priority: of what nodes tell each other, in the queue.
    """

    notice_priority = 0

    def __init__(self, nodes: Sequence[str], draws: Draws, forwarding: Forwarding) -> None:
        self._forwarding = forwarding
        self._words = [WordStream(draws, node, "routing") for node in nodes]

    def header_bytes(self, hop: Hop) -> int:
        """What a packet is longer by on this hop."""
        del hop
        return 0

    def send(self, node: int, packet: AirPacket) -> Onward:
        """How the sender of a packet sends it."""
        del node
        return [Hop(packet.to)]

    def hand_on(self, node: int, packet: AirPacket, way: Sequence[int]) -> Onward:
        """How a node that is not its only receiver hands a packet on, which came to it for the first time.

        Args:
            node: who hands it on.
            packet: as its sender gave it.
            way: who transmitted it, from its sender on.
        """
        del node, packet, way
        return ()

    def refuses(self, node: int, packet: AirPacket) -> Loss | None:
        """Why a node does not take a packet that it heard; None: it does."""
        del node, packet
        return None

    def first_notice_ns(self, node: int) -> int | None:
        """When a node first tells its neighbours of itself; None: never."""
        del node
        return None

    def notices(self, node: int, now_ns: int) -> tuple[Sequence[Notice], int]:
        """What a node tells its neighbours now, and at which later instant it is asked again."""
        raise NotImplementedError

    def take(self, node: int, sender: int, content: object, now_ns: int) -> Sequence[Notice]:
        """Take in what a node heard from a neighbour; what it tells others of it."""
        del node, sender, content, now_ns
        return ()

    def _delay_ns(self, node: int) -> int:
        """How long a node takes this time."""
        least_ns, spread_ns = self._forwarding
        return least_ns + (int(self._words[node].next_uniform() * spread_ns) if spread_ns else 0)
