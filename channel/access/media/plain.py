"""What media of plain radios share: a node transmits whatever it hears, and each packet once."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from channel.access.air import Air, DeafEar, Hearing
from channel.access.media.medium import AccessMedium
from channel.access.packets import AirFrame, AirPacket, Loss
from channel.access.queue import QueueLimits
from channel.access.timing import FrameTiming
from channel.access.world import World


class PlainMedium(AccessMedium):
    """A network of such radios.

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
        limits: QueueLimits | None,
        hearing: Hearing | None,
    ) -> None:
        timings = timing if isinstance(timing, Mapping) else dict.fromkeys(world.nodes, timing)
        longest_bytes = max(each.max_length_bytes for each in timings.values())
        super().__init__(world, limits or QueueLimits(), longest_bytes)
        self._timing_of = timings
        self._air = Air(self.agenda, world, hearing or Hearing(), self._passed, self._book_all)
        self._receivers = self._air.join({node: DeafEar() for node in world.nodes})
        self.air = self._air
        self._numbers = dict.fromkeys(world.nodes, 0)

    def _transmit(
        self,
        packet: AirPacket,
        then: Callable[[], object],
        timing: FrameTiming | None = None,
        bit_rate_bps: float | None = None,
    ) -> None:
        """Put a packet on the air now; ``then`` is called at its end.

        Args:
            packet: what is sent.
            then: what comes next.
            timing: of this frame; its transmitter's unless given.
            bit_rate_bps: at which errors are reckoned; the radio's unless given.
        """
        node, now_ns = packet.node, self.agenda.now_ns
        timing = timing or self._timing_of[node]
        number = self._numbers[node]
        self._numbers[node] += 1
        ended_ns = now_ns + timing.duration_ns(packet.length_bytes)
        length_bytes = packet.length_bytes + timing.header_bytes
        frame = AirFrame(
            node,
            number,
            "data",
            length_bytes,
            now_ns,
            ended_ns,
            packet,
            channel=self._receivers[node].channel,
            bit_rate_bps=bit_rate_bps,
        )
        self._air.transmit(frame, then)

    def _passed(self, frame: AirFrame, receiver: int, loss: Loss | None) -> None:
        packet = frame.packet
        assert packet is not None
        self._book(packet, receiver, frame, 1, loss)
