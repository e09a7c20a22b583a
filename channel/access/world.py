"""How strong a node hears another, and what of a frame survives."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import inf
from typing import NamedTuple, Protocol

from channel.access.packets import AirPacket
from channel.access.words import FrameDraws


class Piece(NamedTuple):
    """A part of a frame during which the interference stays the same."""

    duration_ns: int
    interference_mw: float


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
    met: object = field(default=None, repr=False)


class Arrival(NamedTuple):
    """A frame at one of the nodes that it reaches.

    Attributes:
        receiver: the node.
        power_mw: in which it is received; above 0.
        delay_ns: of propagation.
    """

    receiver: int
    power_mw: float
    delay_ns: int


class World(Protocol):
    """What lies between nodes. Whatever it answers depends on its arguments alone."""

    @property
    def nodes(self) -> Sequence[int]:
        """Who is on the air."""

    def reach(self, frame: AirFrame) -> Sequence[Arrival]:
        """Whom a frame reaches that starts now, the nearest first; at all others nothing comes that matters."""

    def survives(
        self, frame: AirFrame, receiver: int, power_mw: float, pieces: Sequence[Piece]
    ) -> tuple[bool, bool]:
        """Whether a frame came through, and whether it would have done so without interference."""


class PlainWorld:
    """Every node hears every other equally well, but those that are deaf to each other; two frames at once spoil both.

    Args:
        nodes: who is on the air.
        deaf: pairs (transmitter, receiver) of which the receiver hears nothing.
        delay_ns: of propagation, for all.
        power_mw: received, for all; or by (transmitter, receiver).
        loss: share of frames that the channel loses by itself, drawn by receiver and transmission.
        sinr_min: a frame is lost when its power over interference falls below this at any time.
        seed: of the draws.
    """

    def __init__(
        self,
        nodes: Sequence[int],
        *,
        deaf: Sequence[tuple[int, int]] = (),
        delay_ns: int = 0,
        power_mw: float | Mapping[tuple[int, int], float] = 1e-5,
        loss: float = 0.0,
        sinr_min: float = inf,
        seed: int = 1,
    ) -> None:
        self.nodes = tuple(nodes)
        self._loss, self._sinr_min, self._draws = loss, sinr_min, FrameDraws(seed)
        self._reach = {
            tx: [
                Arrival(rx, power_mw[tx, rx] if isinstance(power_mw, Mapping) else power_mw, delay_ns)
                for rx in self.nodes
                if rx != tx and (tx, rx) not in deaf
            ]
            for tx in self.nodes
        }

    def reach(self, frame: AirFrame) -> Sequence[Arrival]:
        """As given."""
        return self._reach[frame.node]

    def survives(
        self, frame: AirFrame, receiver: int, power_mw: float, pieces: Sequence[Piece]
    ) -> tuple[bool, bool]:
        """Lost by a draw of its own, or by any interference that is too strong."""
        alone = True
        if self._loss:
            alone = self._draws.uniform(frame.node, receiver, frame.number) >= self._loss
        worst_mw = max(piece.interference_mw for piece in pieces)
        return alone and (worst_mw == 0.0 or power_mw >= self._sinr_min * worst_mw), alone
