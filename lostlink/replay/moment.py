"""One tick of a record: the messages that the run published at it, made when they are asked for."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bridge.bus.keys import MAIN
from bridge.bus.messages import (
    AgentStatus,
    AircraftState,
    Clock,
    CommunicationMatrix,
    CommunicationStatus,
    Fates,
    Header,
    Links,
    Measurements,
    Truth,
    Truths,
)
from bridge.bus.reception import UNKNOWN, Instants, attachment
from bridge.bus.session import Stamp
from bridge.radio.picture import Row
from bridge.record.events import RunEvent
from bridge.record.logged import LoggedValue
from bridge.record.tables.deliveries import INSTANTS, fates_message
from channel.medium.reception import DELIVERED
from lostlink.reading.links.known import KnownLinks
from lostlink.reading.rows import DeliveryRows
from lostlink.replay.record import TickedRecord


@dataclass(frozen=True, slots=True)
class Received:
    """A packet that arrived.

    Attributes:
        rx: id of the node that got it.
        tx: id of its sender.
        channel: last part of its key.
        encoding: what its payload is said to be; "" if nothing.
        rssi_dbm: power in which it arrived.
        snr_db: the same over the noise.
        radio: name of the radio that it came by.
        instants: of its way.
    """

    rx: str
    tx: str
    channel: str
    encoding: str
    payload: bytes
    seq: int
    sim_time_ns: int
    rssi_dbm: float
    snr_db: float
    radio: str = MAIN
    instants: Instants = UNKNOWN

    @property
    def attachment(self) -> bytes:
        """What it had beside it on Zenoh."""
        stamp = Stamp(self.seq, self.sim_time_ns).to_bytes()
        return attachment(stamp, self.rssi_dbm, self.snr_db, self.instants, self.radio)


class Moment:
    """A record as it is played at one tick: it is good until the player plays another.

    Args:
        record: what is played.
        links: what is known of links by now.
        tick: number of the tick.
        decided: what it settled.
        changed: whose communication status it changed.

    Attributes:
        decided: as above.
        sim_time_ns: the tick.
        is_last: whether the record ends with it.
        links_are_due: whether the run published link reports at it.
        is_over: whether another is played.
    """

    def __init__(
        self,
        record: TickedRecord,
        links: KnownLinks,
        tick: int,
        decided: DeliveryRows,
        changed: Sequence[Row],
    ) -> None:
        self._record, self._known_links, self._tick = record, links, tick
        self._rows = record.truth.rows_of(tick)
        self._changed = changed
        self.decided = decided
        self.sim_time_ns = int(record.ticks_ns[tick])
        self.is_last = tick == record.ticks_ns.size - 1
        self.links_are_due = bool(record.links_due[tick])
        self.is_over = False

    def _check(self) -> None:
        if self.is_over:
            raise RuntimeError(f"the moment at {self.sim_time_ns} ns is over: the player has played on")

    @property
    def _at(self) -> TickedRecord:
        self._check()
        return self._record

    @property
    def _links(self) -> KnownLinks:
        self._check()
        return self._known_links

    def clock(self, speed: float = 1.0, real_time_factor: float = math.nan, *, paused: bool = False) -> Clock:
        """Fleet time; how fast it goes is how fast the record is played."""
        return Clock(Header.at(self.sim_time_ns, ""), speed, real_time_factor, paused)

    def truth(self) -> dict[str, Truth]:
        """The true state of each node."""
        messages = (self._at.truth.message(row) for row in self._rows)
        return {message.header.frame_id: message for message in messages}

    def truths(self) -> Truths:
        """The true states of all nodes."""
        return Truths(Header.at(self.sim_time_ns, ""), tuple(self.truth().values()))

    @property
    def has_fates(self) -> bool:
        """Whether the tick settled anything at all."""
        return bool(np.count_nonzero(~self.decided.is_gap))

    def fates(self) -> Fates:
        """What the tick settled."""
        rows = self.decided.at(~self.decided.is_gap)
        return fates_message(self.sim_time_ns, self._at.nodes, rows.columns, self._at.networks)

    def links(self) -> Links:
        """All links that carried a packet: the latest figures, and counts from the run's beginning on."""
        return self._links.report(self.sim_time_ns)

    def communication(self) -> CommunicationMatrix:
        """Whose latest packets reached whom."""
        return self._links.picture.matrix(self.sim_time_ns)

    def statuses(self) -> list[CommunicationStatus]:
        """The communication status of each node that got, or missed, a packet at this tick."""
        return [self._links.picture.status(row, self.sim_time_ns) for row in self._changed]

    def received(self, wanted: Sequence[str] | None = None) -> list[Received]:
        """What arrived at this tick, in the order in which the radio settled it.

        Args:
            wanted: ids of receivers; all of them unless given.

        Raises:
            StreamError, OSError: the packets of a node are damaged or cannot be read.
        """
        columns, nodes = self.decided.columns, self._at.nodes
        receivers = range(len(nodes)) if wanted is None else [nodes.index(node) for node in wanted]
        arrived = (columns["fate"] == DELIVERED) & np.isin(columns["rx"], list(receivers))
        rows = [
            columns[name][arrived].tolist()
            for name in ("tx", "rx", "seq", "received_power_dbm", "snr_db", *INSTANTS)
        ]
        found = (self._received(*row) for row in zip(*rows, strict=True))
        return [each for each in found if each is not None]

    def _received(
        self, tx: int, rx: int, seq: int, rssi_dbm: float, snr_db: float, *when_ns: int
    ) -> Received | None:
        sent, nodes = self._at.sent[tx], self._at.nodes
        row = sent.row_of(seq)
        if row is None:  # the record of what was sent ends before that of what became of it: it was killed
            return None
        what = (sent.channels[row], sent.encodings[row], sent.payload(row))
        when_sent_ns, instants = int(sent.sim_time_ns[row]), Instants(*when_ns)
        return Received(
            nodes[rx], nodes[tx], *what, seq, when_sent_ns, rssi_dbm, snr_db, sent.radios[row], instants
        )

    def states(self, wanted: Sequence[str] | None = None) -> dict[str, AircraftState]:
        """The newest state that each node published by now, under its own stamp; without those that have none yet.

        Args:
            wanted: ids of nodes; all of them unless given.

        Raises:
            TableError, OSError: the table of states is damaged or cannot be read.
        """
        at = self._at
        found = {n: at.states.at(n, self.sim_time_ns) for n in (at.nodes if wanted is None else wanted)}
        return {node: state for node, state in found.items() if state is not None}

    def measurements(self) -> Sequence[tuple[str, Measurements]]:
        """What the RF sensor of each node reported at this tick, by node.

        Raises:
            TableError, OSError: the table of measurements is damaged or cannot be read.
        """
        return self._at.measured.at(self.sim_time_ns)

    def events(self) -> list[RunEvent]:
        """What the run's processes reported between the tick before and this one."""
        return [e for e in self._at.events if self._before_ns < e.sim_time_ns <= self.sim_time_ns]

    def logged(self) -> list[tuple[str, int, LoggedValue | AgentStatus]]:
        """What agents logged and said of their work since the tick before: node, sim time in ns, and what.

        Raises:
            ValueError, OSError: what an agent logged is damaged or cannot be read.
        """
        return [
            (node, *item)
            for node, logged in self._at.logged.items()
            for item in logged.between(self._before_ns, self.sim_time_ns)
        ]

    @property
    def _before_ns(self) -> int:
        """The tick before."""
        return int(self._at.ticks_ns[self._tick - 1]) if self._tick else -1
