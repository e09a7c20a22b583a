"""The virtual radio: everything that one node transmits goes through here, and what survives goes on.

`VirtualRadio` is the core: it takes packets, true positions and answers to ticks, and returns what to publish.
The process around it is in `bridge.radio.process`.

The router also closes each tick: once every agent has answered it, all packets of that tick are settled, in one
order whoever was first, and on their way; only then is the fleet clock released. So no packet is late because the
host was slow, and a run does not depend on how fast it went.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import StrEnum

from bridge.bus.keys import Keys
from bridge.bus.messages import CommunicationStatus, Header, Link, Message
from bridge.bus.session import Stamp
from bridge.radio.deliveries import DeliveryRow
from channel.medium.ledger import Ledger
from channel.medium.medium import Fate, Medium, Reception

TRANSPORT = "transport"
"""Cause of loss: the packet left its agent and never came to the router. The host lost it, not the radio."""
TOO_LONG = "too_long"
"""Cause of loss: no radio of ours takes a packet of more than MAX_LENGTH_BYTES."""
LINK_PERIOD_NS = 200_000_000
MAX_LENGTH_BYTES = 1 << 20
MAX_GAP = 100_000
"""A sequence number that jumps further than this is taken for garbage, not for lost packets."""
NEVER_NS = 1 << 62
TAKEN_MAX = 100_000
"""Packets of one tick."""
FUTURE_MAX_NS = 10_000_000_000
"""A sim time further ahead of the newest truth than this is garbage."""


class Refused(StrEnum):
    """Why something that came in from Zenoh was not taken."""

    UNKNOWN_NODE = "unknown_node"
    MALFORMED = "malformed"
    REPEATED = "repeated_sequence_number"
    OVERLOAD = "overload"


@dataclass(frozen=True, slots=True)
class TxPacket:
    """What a node gave to the radio; the payload is opaque."""

    tx: str
    channel: str
    seq: int
    sim_time_ns: int
    payload: bytes
    encoding: object = None


@dataclass(frozen=True, slots=True)
class Forward:
    """A packet that arrives: bytes, encoding and stamp go out as they came in."""

    key: str
    packet: TxPacket

    @property
    def attachment(self) -> bytes:
        """The stamp as bytes."""
        return Stamp(self.packet.seq, self.packet.sim_time_ns, self.packet.tx.encode()[:16]).to_bytes()


@dataclass(frozen=True, slots=True)
class Publish:
    """One of our messages to publish."""

    key: str
    message: Message
    must_arrive: bool = False


Action = Forward | Publish


class VirtualRadio:
    """Settles the fate of each packet for each other node. No I/O, no clock.

    Args:
        keys: of the run.
        medium: the channel's medium, with the same nodes.
        nodes: ids of all nodes.
        tasks: ids of the nodes whose agents have a task: when all are done, the run ends with that tick.
        end_ns: the tick at which the run ends at the latest.
        tick_period_ns: sim time between ticks; answers to instants between them are for exchanges of MAVLink alone.
    """

    def __init__(
        self,
        keys: Keys,
        medium: Medium,
        nodes: Sequence[str],
        *,
        tasks: Iterable[str] = (),
        end_ns: int = NEVER_NS,
        tick_period_ns: int = 1,
    ) -> None:
        self._keys = keys
        self._medium = medium
        self._nodes = tuple(nodes)
        self._answered = dict.fromkeys(nodes, -1)
        self._released_ns = -1
        self._latest_ns = 0
        self._end_ns = end_ns
        self._tick_period_ns = tick_period_ns
        self._tasks = set(tasks)
        self._tick_ns = 0
        self._next_seq = dict.fromkeys(nodes, 0)
        self._taken: list[TxPacket] = []
        self._settled_by_truth: list[Action] = []
        self._waiting: dict[tuple[str, int], tuple[TxPacket, int]] = {}
        self._others = {node: tuple(other for other in nodes if other != node) for node in nodes}
        self._latest: dict[tuple[str, str], Reception] = {}
        self._reported_ns = -LINK_PERIOD_NS
        self.ledger = Ledger()
        self._received: dict[str, dict[str, bool]] = {node: {} for node in nodes}
        self._changed: set[str] = set()
        self.refused: Counter[Refused] = Counter()
        self.settled: list[DeliveryRow] = []
        """Rows for the record; whoever writes them clears the list."""
        self.transmitted: list[TxPacket] = []
        """Packets taken, in the order in which they are settled; whoever writes them clears the list."""

    @property
    def waiting_for(self) -> tuple[str, ...]:
        """Regulated nodes that have not answered the latest tick."""
        return tuple(node for node, at in self._answered.items() if at < self._tick_ns)

    def on_truth(
        self,
        node: str,
        sim_time_ns: int,
        position_ned_m: tuple[float, float, float],
        attitude_wxyz: tuple[float, ...],
    ) -> list[Action]:
        """Take a node's true position in the fleet's frame."""
        if node not in self._next_seq:
            self.refused[Refused.UNKNOWN_NODE] += 1
            return []
        if not self._is_plausible(sim_time_ns):
            self.refused[Refused.MALFORMED] += 1
            return []
        self._latest_ns = max(self._latest_ns, sim_time_ns)
        # Packets that waited for this truth go out with the tick, as those of the tick do: not beside its clock.
        self._settled_by_truth += self._settle(
            self._medium.observe(node, sim_time_ns, position_ned_m, attitude_wxyz)
        )
        return []

    def on_packet(self, tx: str, channel: str, payload: bytes, encoding: object, stamp: Stamp | None) -> None:
        """Take a packet with its stamp; `settle` decides its fate.

        Whoever may write a node's ``tx`` is its agent: the router sees to that, and nothing in the packet does.
        """
        refused = self._why_refused(tx, stamp)
        if stamp is None or refused is not None:
            self.refused[refused or Refused.MALFORMED] += 1
            return
        self._book_missing(tx, stamp.seq, stamp.sim_time_ns, TRANSPORT)
        if len(payload) > MAX_LENGTH_BYTES:
            self._book_missing(tx, stamp.seq + 1, stamp.sim_time_ns, TOO_LONG)
            return
        self._next_seq[tx] = stamp.seq + 1
        self._taken.append(TxPacket(tx, channel, stamp.seq, stamp.sim_time_ns, payload, encoding))

    def settle(self) -> list[Action]:
        """Give what was taken to the medium, in an order that does not depend on that of arrival."""
        taken, self._taken = self._taken, []
        actions: list[Action] = []
        taken.sort(key=lambda p: (p.sim_time_ns, p.tx, p.seq))
        self.transmitted += taken
        for packet in taken:
            if self._others[packet.tx]:
                self.ledger.sent(packet.tx, self._others[packet.tx])
                self._waiting[packet.tx, packet.seq] = (packet, len(self._others[packet.tx]))
            length_bytes = len(packet.payload)
            actions += self._settle(
                self._medium.transmit(packet.tx, packet.seq, packet.sim_time_ns, length_bytes)
            )
        return actions

    def _why_refused(self, tx: str, stamp: Stamp | None) -> Refused | None:
        if tx not in self._next_seq:
            return Refused.UNKNOWN_NODE
        if stamp is None:
            return Refused.MALFORMED
        if stamp.seq < self._next_seq[tx]:
            return Refused.REPEATED
        if len(self._taken) >= TAKEN_MAX:
            return Refused.OVERLOAD
        if stamp.seq - self._next_seq[tx] > MAX_GAP or not self._is_plausible(stamp.sim_time_ns):
            return Refused.MALFORMED
        return None

    def _is_plausible(self, sim_time_ns: int) -> bool:
        return 0 <= sim_time_ns <= self._latest_ns + FUTURE_MAX_NS

    def on_answer(self, node: str, sim_time_ns: int) -> list[Action]:
        """Take a node's word that it has done all it will do at a tick, or at an exchange of MAVLink between two."""
        if node not in self._answered or not self._is_plausible(sim_time_ns):
            self.refused[Refused.MALFORMED if node in self._answered else Refused.UNKNOWN_NODE] += 1
            return []
        self._answered[node] = max(self._answered[node], sim_time_ns)
        done_ns = min(self._answered.values())
        if done_ns <= self._released_ns:
            return []
        self._released_ns = done_ns
        if done_ns % self._tick_period_ns:
            return [Publish(self._keys.clock_release, Header.at(done_ns, ""), must_arrive=True)]
        key = self._keys.clock_end if done_ns >= self._end_ns else self._keys.clock_release
        release = Publish(key, Header.at(done_ns, ""), must_arrive=True)
        # What the nodes get at their next tick goes out before the release; observers can wait.
        late, self._settled_by_truth = self._settled_by_truth, []
        return [*late, *self.settle(), *self._statuses(done_ns), release, *self._link_reports(done_ns)]

    def on_tick(self, sim_time_ns: int) -> None:
        """Take a tick of the fleet clock."""
        if not self._is_plausible(sim_time_ns):
            self.refused[Refused.MALFORMED] += 1
            return
        self._tick_ns = self._latest_ns = max(self._latest_ns, sim_time_ns)

    def on_done(self, node: str) -> None:
        """Take an agent's word that its task is done."""
        if node in self._tasks:
            self._tasks.discard(node)
            if not self._tasks:
                self._end_ns = min(self._end_ns, self._released_ns + 1)

    def on_failed(self) -> None:
        """Take an agent's word that it has failed: the run ends with this tick."""
        self._end_ns = min(self._end_ns, self._released_ns + 1)

    def on_sent_total(self, tx: str, sent: int) -> None:
        """Take an agent's own count of what it gave to the radio; what never came here is booked."""
        if tx not in self._next_seq or not 0 <= sent <= self._next_seq[tx] + MAX_GAP:
            self.refused[Refused.MALFORMED if tx in self._next_seq else Refused.UNKNOWN_NODE] += 1
            return
        self._book_missing(tx, sent, self._latest_ns, TRANSPORT)

    def finish(self) -> list[Action]:
        """Settle what still waits, with the newest positions, and balance the books.

        Raises:
            LedgerError: sent is not delivered plus lost: a defect of ours.
        """
        actions = [*self._settled_by_truth, *self.settle(), *self._settle(self._medium.flush())]
        self.ledger.check(in_flight=0)
        return actions + self._link_reports(self._reported_ns + LINK_PERIOD_NS)

    def _book_missing(self, tx: str, seq: int, sim_time_ns: int, cause: str) -> None:
        """Book the sender's packets before ``seq`` that never got to the radio."""
        for missing in range(self._next_seq[tx], seq):
            self.ledger.lose(tx, self._others[tx], cause)
            for rx in self._others[tx]:
                row = DeliveryRow(
                    sim_time_ns, tx, rx, missing, 0, math.nan, math.nan, math.nan, math.nan, cause
                )
                self.settled.append(row)
        self._next_seq[tx] = max(self._next_seq[tx], seq)

    def _settle(self, receptions: Iterable[Reception]) -> list[Action]:
        settled = list(receptions)
        self.ledger.settle(settled)
        actions: list[Action] = []
        for reception in settled:
            packet = self._take(reception.tx, reception.seq)
            self._book(reception)
            if reception.fate is Fate.DELIVERED:
                actions.append(Forward(self._keys.rx(reception.rx, reception.tx, packet.channel), packet))
        return actions

    def _take(self, tx: str, seq: int) -> TxPacket:
        packet, left = self._waiting.pop((tx, seq))
        if left > 1:
            self._waiting[tx, seq] = (packet, left - 1)
        return packet

    def _book(self, r: Reception) -> None:
        self._latest[r.tx, r.rx] = r
        self._received[r.rx][r.tx] = r.fate is Fate.DELIVERED
        self._changed.add(r.rx)
        self.settled.append(
            DeliveryRow(
                r.sim_time_ns,
                r.tx,
                r.rx,
                r.seq,
                r.length_bytes,
                r.distance_m,
                r.received_power_dbm,
                r.snr_db,
                r.per,
                r.fate.value,
            )
        )

    def _statuses(self, sim_time_ns: int) -> list[Action]:
        actions: list[Action] = []
        for node in sorted(self._changed):
            heard = self._received[node]
            status = CommunicationStatus(Header.at(sim_time_ns, node), tuple(heard), tuple(heard.values()))
            actions.append(Publish(self._keys.comm_status(node), status, must_arrive=True))
        self._changed.clear()
        return actions

    def _link_reports(self, sim_time_ns: int) -> list[Action]:
        if sim_time_ns - self._reported_ns < LINK_PERIOD_NS:
            return []
        self._reported_ns = sim_time_ns
        return [Publish(self._keys.link(r.tx, r.rx), self._link_message(r)) for r in self._latest.values()]

    def _link_message(self, r: Reception) -> Link:
        account = self.ledger.links[r.tx, r.rx]
        header = Header.at(r.sim_time_ns, r.rx)
        radio = (r.distance_m, r.received_power_dbm, r.snr_db, r.per)
        return Link(header, r.tx, r.rx, *radio, account.sent, account.delivered)
