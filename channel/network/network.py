"""Packets of a run in, their receptions with all instants out, as columns: the side of a medium that takes time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from channel.access.media.medium import AccessMedium
from channel.access.packets import AirFate, AirPacket, Handling, Loss, Reply
from channel.access.world import World
from channel.medium.judge.judge import Judge
from channel.medium.medium import Medium
from channel.medium.reception import DELIVERED, ERASED, FATES, NO_PACKETS, Fate, Packets, Receptions
from channel.network.entry import EntryInstants
from channel.network.instants import NEVER_NS, InstantColumns
from channel.network.link_world import LinkWorld

OF_LOSS: Final[dict[Loss, int]] = {
    loss: FATES.index(Fate.TOO_LONG_FOR_A_SLOT if loss is Loss.TOO_LONG else Fate(loss.value))
    for loss in Loss
    if loss is not Loss.NOISE
}
"""What the record calls a loss; noise is what the channel says."""
INTERFERED: Final = FATES.index(Fate.INTERFERED)
NOTHING: Final = (float("nan"),) * 5


@dataclass(frozen=True, slots=True)
class Lived:
    """What came of a stretch of time.

    Attributes:
        receptions: that were decided in it, in the order of their instants.
        instants: of these.
        replies: what senders learn of their unicasts, in order.
        done: sender and number of the packets of which now all is decided.
        first: what first transmissions met in it, alone on the air.
    """

    receptions: Receptions
    instants: InstantColumns
    replies: Sequence[Reply]
    done: Sequence[tuple[int, int]]
    first: Sequence[Receptions]


@dataclass(slots=True)
class _Open:
    """A packet on its way: when its agent sent it, and whose fate is open."""

    packet: AirPacket
    sim_time_ns: int
    receivers: set[int]


class Network:
    """One radio network of a run.

    Args:
        medium: where the nodes are, and their radios.
        open_medium: makes the medium in a world.
        entry: when packets enter their radios.
        judge: takes in what is drawn.
    """

    def __init__(
        self,
        medium: Medium,
        open_medium: Callable[[World], AccessMedium],
        entry: EntryInstants,
        judge: Judge | None = None,
    ) -> None:
        self._world = LinkWorld(medium, judge)
        self._access = open_medium(self._world)
        self._entry = entry
        self._everybody = frozenset(range(len(medium.nodes)))
        self._unreached: list[AirFate] = []
        """Of packets to all, at the nodes that their sender's radio has no link to."""
        self._open: dict[tuple[int, int], _Open] = {}
        """Packets on their way, by sender and number."""
        self._for_nobody: list[tuple[int, int]] = []
        """Packets of a node that is alone."""
        self._now_ns = 0

    @property
    def phases_ns(self) -> Sequence[int]:
        """Of all nodes."""
        return self._entry.phases_ns

    @property
    def world(self) -> LinkWorld:
        """What frames meet."""
        return self._world

    @property
    def access(self) -> AccessMedium:
        """Who transmits when."""
        return self._access

    def queued(self, node: int) -> tuple[int, int]:
        """How many packets of a node wait, and their length in bytes."""
        return self._access.queued(node)

    def send(self, packets: Packets, handling: Sequence[Handling]) -> None:
        """Have packets enter their radios: in canonical order, none before the instant that `live` came to."""
        columns = (column.tolist() for column in packets)
        for (sim_time_ns, tx, seq, length_bytes, to), how in zip(
            zip(*columns, strict=True), handling, strict=True
        ):
            at_ns = max(self._entry.at_ns(tx, seq, sim_time_ns), self._now_ns)
            receiver = None if to < 0 else to
            packet = AirPacket(tx, seq, receiver, length_bytes, at_ns, how.priority, how.lifetime_ns, how.key)
            receivers = set(self._access.receivers_of(packet))
            others = self._everybody - receivers - {tx} if receiver is None else frozenset()
            self._unreached += [
                AirFate(packet, other, at_ns, NEVER_NS, NEVER_NS, 0, Loss.NO_PEER) for other in sorted(others)
            ]
            if receivers or others:
                self._open[tx, seq] = _Open(packet, sim_time_ns, receivers | others)
                self._access.offer(packet)
            else:
                self._for_nobody.append((tx, seq))

    def live(self, until_ns: int) -> Lived:
        """Let the network live until just before an instant; what was decided since the last call."""
        outcomes = self._access.run(until_ns - 1)
        self._now_ns = until_ns
        fates = [outcome for outcome in outcomes if isinstance(outcome, AirFate)]
        fates += [fate for fate in self._unreached if fate.at_ns < until_ns]
        self._unreached = [fate for fate in self._unreached if fate.at_ns >= until_ns]
        return self._lived(fates, [outcome for outcome in outcomes if isinstance(outcome, Reply)])

    def end(self) -> Lived:
        """The run is over: what is not decided never will be."""
        fates = [
            AirFate(each.packet, rx, self._now_ns, NEVER_NS, NEVER_NS, 0, None)
            for each in self._open.values()
            for rx in sorted(each.receivers)
        ]
        lived = self._lived(fates, [])
        lived.receptions.fate[:] = FATES.index(Fate.RUN_ENDED)
        return lived

    def _lived(self, fates: list[AirFate], replies: Sequence[Reply]) -> Lived:
        fates.sort(key=lambda fate: (fate.at_ns, fate.packet.node, fate.packet.number, fate.receiver))
        packets, rows = self._packets_of(fates)
        table = np.array([self._figures(fate) for fate in fates]).reshape(-1, 5)
        codes = [self._code(fate) for fate in fates]
        receptions = Receptions(
            packets,
            rows,
            np.array([fate.receiver for fate in fates], dtype=np.intp),
            table[:, 0],
            table[:, 1],
            table[:, 2],
            table[:, 3],
            table[:, 4],
            np.array(codes, dtype=np.uint8),
        )
        instants = InstantColumns(
            np.array([self._entered_ns(fate.packet) for fate in fates], dtype=np.int64),
            np.array([fate.started_ns for fate in fates], dtype=np.int64),
            np.array([fate.ended_ns for fate in fates], dtype=np.int64),
            np.array([fate.at_ns for fate in fates], dtype=np.int64),
            np.array([fate.attempts for fate in fates], dtype=np.int32),
        )
        done = [*self._for_nobody, *self._close(fates)]
        self._for_nobody.clear()
        return Lived(receptions, instants, replies, done, self._world.first_transmissions())

    def _entered_ns(self, packet: AirPacket) -> int:
        return packet.at_ns if packet.at_ns < self._now_ns else NEVER_NS

    def _close(self, fates: Sequence[AirFate]) -> Sequence[tuple[int, int]]:
        """Take note of what is decided; the packets of which now all is."""
        done = []
        for fate in fates:
            key = fate.packet.node, fate.packet.number
            receivers = self._open[key].receivers
            receivers.remove(fate.receiver)
            if not receivers:
                del self._open[key]
                done.append(key)
        return done

    def _packets_of(self, fates: Sequence[AirFate]) -> tuple[Packets, NDArray[np.intp]]:
        """The packets that fates are of, in canonical order, and the row of each fate's."""
        keys = {(fate.packet.node, fate.packet.number) for fate in fates}
        order = sorted((self._open[key].sim_time_ns, *key) for key in keys)
        if not order:
            return NO_PACKETS, np.zeros(0, dtype=np.intp)
        row_of = {(tx, seq): row for row, (_, tx, seq) in enumerate(order)}
        sent = [self._open[tx, seq].packet for _, tx, seq in order]
        packets = Packets(
            np.array([sim_time_ns for sim_time_ns, _, _ in order]),
            np.array([tx for _, tx, _ in order], dtype=np.intp),
            np.array([seq for _, _, seq in order]),
            np.array([packet.length_bytes for packet in sent]),
            np.array([-1 if packet.to is None else packet.to for packet in sent], dtype=np.intp),
        )
        rows = [row_of[fate.packet.node, fate.packet.number] for fate in fates]
        return packets, np.array(rows, dtype=np.intp)

    def _figures(self, fate: AirFate) -> Sequence[float]:
        """Distance, power, SNR, error rate and chance of delivery on the channel alone."""
        return NOTHING if fate.frame is None else self._world.figures(fate.frame, fate.receiver)

    def _code(self, fate: AirFate) -> int:
        """What the record calls it; a frame that is lost to noise is lost as the channel says, or went unnoticed."""
        loss, frame = fate.loss, fate.frame
        if loss is None:
            return DELIVERED
        if loss is not Loss.NOISE or frame is None:
            return OF_LOSS.get(loss, ERASED)
        if self._world.is_lost_to_sources(frame, fate.receiver):
            return INTERFERED
        alone = self._world.fate(frame, fate.receiver)
        return ERASED if alone == DELIVERED else alone
