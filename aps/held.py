"""The daemon of one UA in held mode: its autopilot is heard and spoken to only at given instants of sim time.

    async with HeldDaemon(DaemonConfig(autopilot="tcp:127.0.0.1:5760", sysid=1)) as daemon:
        await daemon.connect()
        for now_ns in ticks:                # while physics withholds its answer, the autopilot is blocked
            daemon.begin_exchange(now_ns)   # what it said before now is read, and acted upon
            ...                             # look at daemon.state, start commands
            daemon.end_exchange()           # what is to be said is written
            await release()                 # physics answers, the autopilot runs on

Between two exchanges nothing is said to the autopilot and no state changes, whatever clients do and however
the event loop is loaded: what is sent to the autopilot depends on what it sent, the instants, the commands
started and the inputs from outside (``on_input``), and on nothing else. With the inputs of a record
(``inject``) the same is sent again.

All time-outs of the logic run in sim time; wall time is left to ``connect`` and to the clients' sockets.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Final

from aps.base import DaemonBase
from aps.config import DaemonConfig
from aps.inputs import Input, InputQueue
from aps.links.address import LinkAddress, parse_autopilot
from aps.links.kinds.called import CalledClient, CalledLink
from aps.links.kinds.held import HeldLink
from aps.links.kinds.held_udp import HeldUdpLink
from aps.links.link import Link
from aps.links.outbox import FrameQueue
from aps.timeouts import HELD_SILENCE_TIMEOUT_S
from aps.vehicle.autopilots.autopilot import TIMESYNC
from aps.vehicle.autopilots.choice import autopilot_of
from aps.wire.framer import Frame

AUTOPILOT_ID: Final = 0
"""Id of the autopilot's link; an input's is 1 or higher."""
_KINDS: Final = ("tcp", "udp-in")
_EXCHANGE: Final = "exchange"
TLOG_GATHER_BYTES: Final = 8 << 10
"""Each write of a log would let other threads have the interpreter."""

_log = logging.getLogger(__name__)


@dataclass(slots=True)
class ExchangeCounters:
    """What the exchanges did."""

    exchanges: int = 0
    read_bytes: int = 0
    """In the latest exchange."""
    read_bytes_most: int = 0
    written_bytes: int = 0
    """In the latest exchange."""
    written_bytes_most: int = 0
    inputs: int = 0
    """Taken from clients or a record."""
    inputs_ignored: int = 0
    """Frames of clients whose input is not taken."""
    inputs_dropped: int = 0
    """Frames of clients that sent more than may wait until the next exchange, and cannot be made to wait (UDP)."""
    clients_paused: int = 0
    """How often a client was not read any further until the next exchange."""
    refused_writes: int = 0
    """Exchanges at which the kernel did not take all that was to be written."""
    overfull_reads: int = 0
    """Exchanges at which more was read than the receive buffer is sure to hold: the autopilot may have waited."""
    link_losses: int = 0
    lost_datagrams: int = 0
    """Of a link by UDP: what the kernel had no room for."""


class HeldDaemon(DaemonBase):
    """One UA's MAVLink daemon, driven by its owner; an async context manager.

    The clients' side works by the event loop: clients are accepted, read and written as usual, but what they send
    takes effect at the next exchange.

    Args:
        config: its settings.
        takes_input: whether what clients send is taken; see ``takes_input``.
        autopilot: one in this process, to be called in place of connecting to the address of ``config``.
        ahead: the autopilot flies on as soon as `swap` was called, while its owner decides: what that comes to is
            written at the next `swap`.
        peer: host and port from which an autopilot by UDP sends, if that is known; else it is who first sends MAVLink.

    Raises:
        ValueError: a setting is out of range.
        OSError: the port is taken (on entering the context), or the tlog cannot be written.
    """

    def __init__(
        self,
        config: DaemonConfig,
        *,
        takes_input: bool = True,
        autopilot: CalledClient | None = None,
        ahead: bool = False,
        peer: tuple[str, int] | None = None,
    ) -> None:
        address = parse_autopilot(config.autopilot)
        if address.kind not in _KINDS or config.more_autopilots:
            raise ValueError(
                f"a held autopilot has one link, tcp:HOST:PORT or udp-in:HOST:PORT, not {config.autopilot!r} and more"
            )
        if address.opening.rules.key is not None:
            raise ValueError(
                "a held autopilot's link cannot be signed: signatures have the time of the machine"
            )
        self.link = _link_to(address, config.queue_limit_bytes, autopilot, peer)
        self._now_ns = 0
        super().__init__(config, lambda: self._now_ns, lambda: None, HELD_SILENCE_TIMEOUT_S)
        self.commands.ftp = False
        self.link.id = AUTOPILOT_ID
        self._open_tlog(lambda: config.tlog_epoch_us + self._now_ns // 1000, TLOG_GATHER_BYTES)
        self.takes_input = takes_input
        self.on_input: Callable[[Input], None] | None = None
        """Called with each input as it takes effect, in order: every frame of a client (even one that only
        another client is sent: routes are learned from it), and its coming and going."""
        self.on_bytes: Callable[[str, bytes], None] | None = None
        """Called with ``"from_autopilot"`` or ``"to_autopilot"`` and all bytes of an exchange, if there are any."""
        self.on_link_down: Callable[[], None] | None = None
        """Called when an exchange finds that the autopilot has closed the connection: ``connect`` again."""
        self.on_wall_time: Callable[[str], None] | None = None
        """Called with the reason when the result may depend on wall time: the flight may not repeat."""
        self.has_machine = True
        """Whether the autopilot has threads, files and a clock of the machine's, by which it answers some requests."""
        self._asked: set[int] = set()
        """Ids of such requests that clients have sent, and were reported: once each."""
        self.counters = ExchangeCounters()
        self._inputs = InputQueue()
        self._paused: list[Link] = []
        self._in_exchange = False
        self._ahead = ahead
        self._decided, self._heard, self._was_up = b"", b"", False

    @property
    def takes_input(self) -> bool:
        """Whether what clients send is taken. One that connects while it is not only listens, for good."""
        return not self.links.listeners

    @takes_input.setter
    def takes_input(self, takes_input: bool) -> None:
        self.links.listeners = not takes_input

    async def __aexit__(self, *error: object) -> None:
        await super().__aexit__(*error)
        self.link.close()

    @property
    def link_up(self) -> bool:
        """Whether there is a connection to the autopilot (as far as the latest exchange could see)."""
        return self.link.up

    async def connect(self) -> None:
        """Try, with back-off (wall time), until there is a connection; returns at once if there is one.

        The daemon takes notice at the next exchange.
        """
        await self.link.connect()

    def inject(self, inputs: Sequence[Input]) -> None:
        """Have recorded inputs taken at the next exchange, as if clients with their links had sent them.

        Raises:
            ValueError: a link is opened twice or used without being open, or a frame is not one whole frame.
        """
        self._inputs.inject(inputs)
        for item in inputs:
            self.links.reserve(item.link)

    def swap(self) -> None:
        """Ahead: write what the exchange before decided, and read what the autopilot said since; it may fly on then.

        Raises:
            RuntimeError: the exchange before has not ended.
        """
        if self._in_exchange:
            raise RuntimeError("the exchange before has not ended")
        decided, self._decided = self._decided, b""
        self._write(decided)
        self._was_up = self.link.up
        self._heard = self.link.read()

    def begin_exchange(self, now_ns: int) -> None:
        """Hear the autopilot and the clients, and decide; nothing is written yet.

        In this order:

        1. sim time becomes ``now_ns``; all that the autopilot has written is read and acted upon;
        2. the inputs from outside are taken, in the order of their arrival;
        3. what is due by ``now_ns`` is done: heartbeat, expiry of routes, stream requests, commands.

        Args:
            now_ns: sim time, ns; never before that of the exchange before.

        Raises:
            ValueError: sim time would go back.
            RuntimeError: the exchange before has not ended.
        """
        if self._in_exchange:
            raise RuntimeError("the exchange before has not ended")
        if now_ns < self._now_ns:
            raise ValueError(f"sim time went back from {self._now_ns} to {now_ns} ns")
        self._in_exchange = True
        self._now_ns = now_ns
        self.counters.exchanges += 1
        self._hear_autopilot()
        self._take_inputs()
        self.core.on_time(now_ns)

    def end_exchange(self) -> None:
        """Write what is to be said: to the autopilot ``MAX_WRITE_BYTES`` at most, the rest waits; then to the clients.

        Raises:
            RuntimeError: no exchange has begun.
        """
        if not self._in_exchange:
            raise RuntimeError("no exchange has begun")
        self._in_exchange = False
        data = self.link.take()
        if self._ahead:
            self._decided = data
        else:
            self._write(data)
        self.links.flush()

    def flush_record(self) -> None:
        """Hand what was recorded to the operating system, as the owner does with a record of its own."""
        if self.tlog is not None:
            self.tlog.flush()

    # The autopilot.

    def _write(self, data: bytes) -> None:
        self.counters.written_bytes = len(data)
        self.counters.written_bytes_most = max(self.counters.written_bytes_most, len(data))
        self._tell_bytes("to_autopilot", data)
        if not self.link.write(data):
            self.counters.refused_writes += 1
            self._wall_time(
                "the autopilot does not read: its connection took only a part of what was to be written"
            )

    def _hear_autopilot(self) -> None:
        if self.link.connections != self.connections:
            if self.core.link_up:
                self.core.link_closed(AUTOPILOT_ID, self._now_ns)
            self.connections = self.link.connections
            self.core.link_opened(self.link, self._now_ns)
        if not self._ahead:
            self._was_up = self.link.up
            self._heard = self.link.read()
        was_up, data = self._was_up, self._heard
        self._was_up, self._heard = self.link.up, b""
        self.counters.read_bytes = len(data)
        self.counters.read_bytes_most = max(self.counters.read_bytes_most, len(data))
        if len(data) > self.link.receive_buffer_bytes // 2:
            self.counters.overfull_reads += 1
            self._wall_time(f"the autopilot wrote {len(data)} bytes at once: it may have had to wait")
        self._count_lost()
        self._tell_bytes("from_autopilot", data)
        frames = self.link.receive(data, self._now_ns)
        self._look_at_answers(frames)
        self.core.frames(self.link, frames, self._now_ns)
        if was_up and not self.link.up:
            self.counters.link_losses += 1
            self._heard_event.clear()
            self.core.link_closed(AUTOPILOT_ID, self._now_ns)
            if self.on_link_down is not None:
                self.on_link_down()

    def _count_lost(self) -> None:
        lost = self.link.lost_datagrams - self.counters.lost_datagrams
        if lost:
            self.counters.lost_datagrams += lost
            self._wall_time(f"{lost} datagrams of the autopilot were lost: the kernel had no room for them")

    def _tell_bytes(self, direction: str, data: bytes) -> None:
        if data and self.on_bytes is not None:
            self.on_bytes(direction, data)

    def _wall_time(self, reason: str) -> None:
        _log.warning("%s", reason)
        if self.on_wall_time is not None:
            self.on_wall_time(reason)

    # What comes from outside.

    def _link_opened(self, link: Link) -> None:
        if link.connectionless and link.id > 0:
            self.links.renumber(link, listener=True)  # until it speaks: a port that is sent to is no input
        self._inputs.opened(link.id)

    def _link_closed(self, link: Link) -> None:
        self._inputs.closed(link.id)
        self.links.leaving = self._inputs.closing

    def _link_frames(self, link: Link, frames: Sequence[Frame], size_bytes: int) -> None:
        if link.id < 0 and link.connectionless and self.takes_input and frames:
            self._inputs.closed(link.id)
            self.links.renumber(link, listener=False)
            self._inputs.opened(link.id)
        if link in self._paused and not link.can_wait:
            self.counters.inputs_dropped += len(frames)
            return
        if link.id < 0:
            self.counters.inputs_ignored += len(frames)
        else:
            self._inputs.frames(link.id, frames)
        if self._inputs.received(link.id, size_bytes) and link not in self._paused:
            self.counters.clients_paused += 1
            self._paused.append(link)
            link.hold(_EXCHANGE)

    def _take_inputs(self) -> None:
        for item, frame in self._inputs.take():
            if item.link > 0:
                self.counters.inputs += 1
                if self.on_input is not None:
                    self.on_input(item)
            self._take(item, frame)
        self.links.leaving = 0
        for link in self._paused:
            link.release(_EXCHANGE)
        self._paused.clear()

    def _take(self, item: Input, frame: Frame | None) -> None:
        if frame is not None:
            link = self.hub.links[item.link]
            if self.has_machine and frame.target_system in (0, self.config.sysid):
                self._look_at_request(frame.msg_id)
            self.core.frames(link, [frame], self._now_ns)
        elif item.kind == "open":
            self.core.link_opened(self.links.links.get(item.link) or _nobody(item.link), self._now_ns)
        else:
            self.core.link_closed(item.link, self._now_ns)

    def _look_at_request(self, msg_id: int) -> None:
        self._may_not_repeat(msg_id, autopilot_of(self.telemetry.autopilot).unrepeatable)

    def _look_at_answers(self, frames: Sequence[Frame]) -> None:
        reasons = autopilot_of(self.telemetry.autopilot).unrepeatable_answers
        if reasons and self.has_machine:
            for frame in frames:
                if frame.msg_id != TIMESYNC or any(frame.payload[:8]):  # tc1 is 0 in a request
                    self._may_not_repeat(frame.msg_id, reasons)

    def _may_not_repeat(self, msg_id: int, reasons: Mapping[int, str]) -> None:
        reason = reasons.get(msg_id)
        if reason is not None and msg_id not in self._asked:
            self._asked.add(msg_id)
            self._wall_time(reason)

    def statistics(self) -> dict[str, Any]:
        """Counters of everything, as plain data."""
        return super().statistics() | {
            "exchange": asdict(self.counters)
            | {
                "receive_buffer_bytes": self.link.receive_buffer_bytes,
                "unsent_bytes": self.link.unsent_bytes,
            },
            "inputs_pending": len(self._inputs),
        }


def _link_to(
    address: LinkAddress, limit_bytes: int, autopilot: CalledClient | None, peer: tuple[str, int] | None
) -> HeldLink:
    if autopilot is not None:
        return CalledLink(autopilot, address, limit_bytes)
    if address.kind == "udp-in":
        return HeldUdpLink(address, limit_bytes, peer)
    return HeldLink(address, limit_bytes)


def _nobody(link_id: int) -> Link:
    """In the place of a client of a record, or of one that has left already."""
    link = Link("", FrameQueue())
    link.id = link_id
    return link
