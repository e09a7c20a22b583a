"""A medium on which packets take time: each node sends what it has as soon as its transmitter is free."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial

from channel.access.agenda import ACTS
from channel.access.air import Hearing
from channel.access.media.plain import PlainMedium
from channel.access.queue import QueueLimits
from channel.access.timing import FrameTiming
from channel.access.world import World


class AirTime(PlainMedium):
    """Nobody listens before it transmits, and nothing is acknowledged: with Poisson traffic, ALOHA (Abramson 1970).

    Args:
        world: nodes, powers, delays.
        timing: of frames: one for all, or by who transmits them.
        limits: of queues.
        hearing: how receivers hear.
    """

    def __init__(
        self,
        world: World,
        timing: FrameTiming | Mapping[int, FrameTiming],
        limits: QueueLimits | None = None,
        hearing: Hearing | None = None,
    ) -> None:
        super().__init__(world, timing, limits, hearing)

    def _wake(self, node: int) -> None:
        if self._receivers[node].transmits:
            return
        packet = self._next(node)
        if packet is not None:
            self._transmit(packet, partial(self._free, node))

    def _free(self, node: int) -> None:
        """The transmitter is free as soon as the receiver has taken notice."""
        self.agenda.at(self.agenda.now_ns, ACTS, node, self._wake, node)
