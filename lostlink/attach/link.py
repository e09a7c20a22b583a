"""Moves packets between the interface of an attached program and the run, in wall time.

What the program sends goes to the node's host, where it enters the radio at the next tick. What the radio delivers goes
to the program when it has arrived: a tick is settled as a whole, so that what arrives between two ticks is known at the
first, and waits here for the wall time that belongs to its instant.
"""

from __future__ import annotations

import asyncio
import os
from collections import deque
from collections.abc import Callable
from typing import Final

from bridge.bus.inbox import Inbox
from bridge.bus.keys import IP, Keys
from bridge.bus.messages import Clock, decode
from bridge.bus.reception import radio_of, signal_of
from bridge.bus.session import Sample, Session
from lostlink.attach.forwarder import Dropped, Forwarder
from lostlink.attach.run_clock import RunClock

READ_AT_ONCE: Final = 64
"""Packets; then whatever else there is has its turn."""
PACKET_MAX: Final = 65536


class IpLink:
    """Between an interface and the run.

    Args:
        session: as the node.
        keys: of the run.
        node: its id.
        radio: name of its radio.
        forwarder: decides.
        tun: file of the interface, not blocking.
        on_end: called when the run is over.

    Attributes:
        clock: of the run.
    """

    def __init__(
        self,
        session: Session,
        keys: Keys,
        node: str,
        radio: str,
        forwarder: Forwarder,
        tun: int,
        on_end: Callable[[], object],
    ) -> None:
        self._session, self._forwarder, self._tun = session, forwarder, tun
        self._node, self._radio, self._keys, self._on_end = node, radio, keys, on_end
        self._loop = asyncio.get_running_loop()
        self.clock = RunClock()
        self._waiting: deque[tuple[float, bytes]] = deque()
        self._timer: asyncio.TimerHandle | None = None

    def open(self) -> None:
        """Packets move from now on."""
        inbox: Inbox[tuple[Callable[[Sample], object], Sample]] = Inbox(
            self._loop, lambda item: item[0](item[1])
        )
        for key, handler in (
            (self._keys.rx(self._node, "*", IP), self._packet_came),
            (self._keys.clock, self._clock_came),
            (self._keys.clock_pace, self._pace_came),
            (self._keys.clock_end, lambda _: self._on_end()),
        ):
            self._session.subscribe(key, lambda sample, handler=handler: inbox.push((handler, sample)))  # type: ignore[misc]
        self._loop.add_reader(self._tun, self._read)

    def close(self) -> None:
        """What the program has sent by its end goes out; then nothing moves any more."""
        while self._read():
            pass
        self._loop.remove_reader(self._tun)
        if self._timer is not None:
            self._timer.cancel()

    # Out.

    def _read(self) -> bool:
        """Some of what there is; returns whether there may be more."""
        for _ in range(READ_AT_ONCE):
            try:
                raw = os.read(self._tun, PACKET_MAX)
            except BlockingIOError:
                return False
            except OSError:  # the program has gone, and its interface with it
                self._loop.remove_reader(self._tun)
                return False
            to = self._forwarder.outgoing(raw)
            if to is not None:
                self._session.put_bytes(self._keys.enter(self._node, IP, to=to, radio=self._radio), raw)
        return True

    # In.

    def _clock_came(self, sample: Sample) -> None:
        clock = decode(sample.payload.to_bytes(), Clock)
        self._forwarder.tick()
        self.clock.came(clock.header.stamp.ns, self._loop.time(), clock.speed)

    def _pace_came(self, sample: Sample) -> None:
        self.clock.operator_did(is_held=decode(sample.payload.to_bytes(), Clock).paused)

    def _packet_came(self, sample: Sample) -> None:
        raw = sample.payload.to_bytes()
        if radio_of(sample) != self._radio or not self._forwarder.incoming(raw):
            return
        _, _, instants = signal_of(sample)
        self._waiting.append((self.clock.wall_s(instants.arrived_ns), raw))
        if self._timer is None:
            self._write_due()

    def _write_due(self) -> None:
        """Write what has arrived, in its order, and have the timer ring for the next."""
        self._timer = None
        while self._waiting:
            due_s, raw = self._waiting[0]
            if due_s > self._loop.time():
                self._timer = self._loop.call_at(due_s, self._write_due)
                return
            self._waiting.popleft()
            try:
                os.write(self._tun, raw)
            except OSError:  # a full queue, or no interface any more: IP bears both
                self._forwarder.dropped[Dropped.NOT_TAKEN] += 1
