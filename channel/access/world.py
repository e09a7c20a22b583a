"""How strong a node hears another, and what of a frame survives."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from math import inf
from typing import NamedTuple, Protocol, overload, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from channel.access.packets import AirFrame
from channel.access.words import FrameDraws
from channel.checks import FloatArray

Rows = NDArray[np.intp]


class Piece(NamedTuple):
    """A part of a frame during which the interference stays the same."""

    duration_ns: int
    interference_mw: float


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


Alone = Callable[[AirFrame, Rows], NDArray[np.bool_]]


class FrameArrivals(Sequence[Arrival]):
    """A frame at all nodes that it reaches, the nearest first: one by one, and as columns.

    Args:
        receiver: the nodes.
        power_mw: in which it is received; above 0.
        delay_ns: of propagation.
        alone: whether a frame comes through at rows of these, if it is the only one on the air there.
    """

    __slots__ = ("_rows", "alone", "delay_ns", "power_mw", "receiver")

    def __init__(
        self, receiver: Rows, power_mw: FloatArray, delay_ns: NDArray[np.int64], alone: Alone
    ) -> None:
        self.receiver, self.power_mw, self.delay_ns, self.alone = receiver, power_mw, delay_ns, alone
        self._rows: list[Arrival] | None = None

    @classmethod
    def of(cls, arrivals: Sequence[Arrival], alone: Alone) -> FrameArrivals:
        """From one by one."""
        receiver, power_mw, delay_ns = zip(*arrivals, strict=True) if arrivals else ((), (), ())
        return cls(
            np.array(receiver, dtype=np.intp),
            np.array(power_mw, dtype=np.float64),
            np.array(delay_ns, dtype=np.int64),
            alone,
        )

    @property
    def rows(self) -> list[Arrival]:
        """One by one."""
        if self._rows is None:
            columns = self.receiver.tolist(), self.power_mw.tolist(), self.delay_ns.tolist()
            self._rows = [Arrival(*each) for each in zip(*columns, strict=True)]
        return self._rows

    def __len__(self) -> int:
        return len(self.receiver)

    @overload
    def __getitem__(self, row: int) -> Arrival: ...

    @overload
    def __getitem__(self, row: slice) -> Sequence[Arrival]: ...

    def __getitem__(self, row: int | slice) -> Arrival | Sequence[Arrival]:
        if self._rows is None and isinstance(row, int):
            return Arrival(int(self.receiver[row]), float(self.power_mw[row]), int(self.delay_ns[row]))
        return self.rows[row]

    def __iter__(self) -> Iterator[Arrival]:
        return iter(self.rows)


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

    def comes_alone(self, frame: AirFrame, receiver: int, power_mw: float) -> bool:
        """Whether a frame that a receiver did not follow to its end would have come through, alone on the air."""


@runtime_checkable
class Foreseeing(Protocol):
    """A world that finds out about many frames together faster than one by one."""

    def delays_ns(self, frames: Sequence[AirFrame]) -> Sequence[Mapping[int, int]]:
        """How long each frame will be on its way to those who are likely to hear it."""

    def expect(self, frames: Sequence[AirFrame]) -> object:
        """Frames that are likely to start before `forget`, in the order of their instants."""

    def forget(self) -> object:
        """What was expected is of no use any more."""


@runtime_checkable
class Identified(Protocol):
    """A world whose nodes have ids: what is drawn for a node hangs on its id, not on its number."""

    @property
    def ids(self) -> Sequence[str]:
        """Of `World.nodes`, in their order."""


def name_of(world: World, node: int) -> str:
    """The id of a node, its number where it has none."""
    return world.ids[list(world.nodes).index(node)] if isinstance(world, Identified) else str(node)


@runtime_checkable
class Metering(Protocol):
    """A world that takes note of what radios measure while no frame comes."""

    def samples_noise(self, node: int, at_ns: int, energy_mw: float) -> object:
        """A radio that might transmit measures what it takes in; ``energy_mw``: of signals, noise not among them."""

    def heard_nobody(self, node: int) -> object:
        """A radio has had no frame of its peers since it last looked."""


class Sources(Protocol):
    """Interferers and emitters at the nodes of a world. What they answer depends on their arguments alone."""

    def span_ns(self, at_ns: int) -> tuple[int, int]:
        """From when to when none begins or ends, and none is looked at anew, about an instant."""

    def powers_mw(self, nodes: Sequence[int], at_ns: int) -> Sequence[float]:
        """Of all of them together, at some nodes: as they are at this very instant, which may lie within a span."""


@runtime_checkable
class Disturbed(Protocol):
    """A world in which more than frames may be on the air."""

    @property
    def sources(self) -> Sources | None:
        """What else there is; None: nothing."""


@runtime_checkable
class Switched(Protocol):
    """A world whose radios can be switched off."""

    def is_off(self, node: int, at_ns: int) -> bool:
        """Whether a node's radio is off at an instant."""


@runtime_checkable
class Parted(Protocol):
    """A world in which groups of nodes may not hear each other for a while."""

    def are_apart(self, node: int, other: int, at_ns: int) -> bool:
        """Whether nothing comes from one node to another at an instant."""


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
            tx: FrameArrivals.of(
                [
                    Arrival(rx, power_mw[tx, rx] if isinstance(power_mw, Mapping) else power_mw, delay_ns)
                    for rx in self.nodes
                    if rx != tx and (tx, rx) not in deaf
                ],
                self._alone,
            )
            for tx in self.nodes
        }

    def reach(self, frame: AirFrame) -> Sequence[Arrival]:
        """As given."""
        return self._reach[frame.node]

    def survives(
        self, frame: AirFrame, receiver: int, power_mw: float, pieces: Sequence[Piece]
    ) -> tuple[bool, bool]:
        """Lost by a draw of its own, or by any interference that is too strong."""
        alone = self.comes_alone(frame, receiver, power_mw)
        worst_mw = max(piece.interference_mw for piece in pieces)
        return alone and (worst_mw == 0.0 or power_mw >= self._sinr_min * worst_mw), alone

    def comes_alone(self, frame: AirFrame, receiver: int, power_mw: float) -> bool:
        """By the same draw."""
        del power_mw
        return self._draws_well(frame, receiver)

    def _draws_well(self, frame: AirFrame, receiver: int) -> bool:
        return not self._loss or self._draws.uniform(frame.node, receiver, frame.number) >= self._loss

    def _alone(self, frame: AirFrame, rows: Rows) -> NDArray[np.bool_]:
        receivers = self._reach[frame.node].receiver[rows].tolist()
        return np.array([self._draws_well(frame, receiver) for receiver in receivers], dtype=bool)
