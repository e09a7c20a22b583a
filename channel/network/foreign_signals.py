"""What the frames of other networks in its band do to a network: power at its nodes, piece by piece."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

from channel.access.agenda import SIGNAL_ENDS, SIGNAL_STARTS
from channel.access.media.medium import AccessMedium
from channel.access.packets import AirFrame
from channel.access.world import Piece
from channel.network.crossing import Crossing


@dataclass(frozen=True, slots=True, eq=False)
class ForeignSignal:
    """A frame of another network at one node.

    Attributes:
        power_mw: before the receiver's filter.
        begins_ns, ends_ns: there.
        share_on: what the filter lets through of it, by the channel that the receiver is on.
    """

    power_mw: float
    begins_ns: int
    ends_ns: int
    share_on: Callable[[int], float]

    def taken_mw(self, channel: int) -> float:
        """What a receiver on a channel takes in of it."""
        return self.power_mw * self.share_on(channel)


class Beside:
    """A network among others in its band.

    Args:
        access: its medium.
    """

    def __init__(self, access: AccessMedium) -> None:
        self._access = access
        self._others: list[tuple[Crossing, Beside]] = []
        self._signals: dict[int, deque[ForeignSignal]] = {node: deque() for node in access.world.nodes}
        """Of other networks, at each node, in the order of their starts at the transmitters."""
        self._longest_ns = 0

    def disturbs(self, other: Beside, crossing: Crossing) -> None:
        """From now on frames of this network are noise on another."""
        self._others.append((crossing, other))

    def starts(self, frame: AirFrame) -> None:
        """A frame of this network is on the air from now on: others learn of it."""
        self._longest_ns = max(self._longest_ns, frame.ended_ns - frame.started_ns)
        for crossing, other in self._others:
            other._take(crossing, frame)

    def pieces(self, node: int, channel: int, begins_ns: int, ends_ns: int) -> Sequence[Piece]:
        """The power of other networks that a node on a channel takes in from one instant to another; empty: none."""
        signals = [
            (each, each.taken_mw(channel))
            for each in self._signals[node]
            if each.begins_ns < ends_ns and each.ends_ns > begins_ns
        ]
        if not any(taken_mw for _, taken_mw in signals):
            return ()
        edges = {begins_ns, ends_ns}
        for each, _ in signals:
            edges |= {max(each.begins_ns, begins_ns), min(each.ends_ns, ends_ns)}
        return [
            Piece(
                end_ns - begin_ns,
                sum(mw for each, mw in signals if each.begins_ns <= begin_ns < each.ends_ns),
            )
            for begin_ns, end_ns in pairwise(sorted(edges))
        ]

    def _take(self, crossing: Crossing, frame: AirFrame) -> None:
        self._forget(frame.started_ns)
        length_ns = frame.ended_ns - frame.started_ns
        for receiver, power_mw, delay_ns in crossing.reach(frame):
            begins_ns = frame.started_ns + delay_ns
            share_on = _share_on(crossing, frame, receiver)
            signal = ForeignSignal(power_mw, begins_ns, begins_ns + length_ns, share_on)
            self._signals[receiver].append(signal)
            self._sense(receiver, signal)

    def _sense(self, node: int, signal: ForeignSignal) -> None:
        """A receiver that senses carriers senses this one while it lasts."""
        if self._access.air is not None:
            receiver, agenda = self._access.air.receiver(node), self._access.agenda
            agenda.at(signal.begins_ns, SIGNAL_STARTS, node, receiver.foreign_starts, signal)
            agenda.at(signal.ends_ns, SIGNAL_ENDS, node, receiver.foreign_ends, signal)

    def _forget(self, now_ns: int) -> None:
        """Drop what has passed before the start of any frame of this network that is still on the air."""
        for signals in self._signals.values():
            while signals and signals[0].ends_ns <= now_ns - self._longest_ns:
                signals.popleft()


def _share_on(crossing: Crossing, frame: AirFrame, receiver: int) -> Callable[[int], float]:
    tx, tx_channel = frame.node, frame.channel
    return lambda channel: crossing.share(tx, tx_channel, receiver, channel)
