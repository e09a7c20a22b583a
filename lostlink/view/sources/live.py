"""A running simulation as the view's source: two sessions as an observer, the second only while somebody looks."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable

from bridge.bus.inbox import Inbox
from bridge.bus.keys import Keys
from bridge.bus.messages import (
    AgentStatus,
    AircraftState,
    Clock,
    DecodeError,
    Fates,
    Header,
    Links,
    Message,
    Truths,
    decode,
)
from bridge.bus.session import Sample, Session, Stamp
from bridge.run.access import Access
from lostlink.view.picture.fleet_view import FleetView
from lostlink.view.sources.logged_queue import LoggedQueue, LoggedSample

WAITING_MAX = 4_000
"""Samples that may wait to be taken; the oldest give way."""
LOGGED_PERIOD_S = 0.1
"""How often what agents logged is read, by wall time."""
log = logging.getLogger("view")


class LiveSource:
    """Feeds a view from a run.

    Args:
        access: to the run, as whom.
        view: what is fed, in the loop's thread.
    """

    def __init__(self, access: Access, view: FleetView) -> None:
        self._access, self._view = access, view
        self._keys = Keys(access.run)
        self._inbox: Inbox[tuple[Callable[[Sample], None], Sample]] = Inbox(
            asyncio.get_running_loop(), self._dispatch, limit=WAITING_MAX
        )
        self._logged = LoggedQueue([node.id for node in view.nodes])
        self._base: Session | None = None
        self._close: Session | None = None
        self._changing = asyncio.Lock()
        self.over = asyncio.Event()
        """Set when the run ends."""
        self.malformed = 0

    @property
    def dropped(self) -> int:
        """Samples that came faster than they were taken."""
        return self._inbox.dropped

    async def open(self) -> None:
        """Join the run: its clock, its links, and what agents say.

        Raises:
            SessionError: there is none any more, or it does not let us in.
        """
        session = await asyncio.to_thread(self._access.open)
        self._base = session
        keys = self._keys
        self._subscribe(session, keys.clock, Clock)
        self._subscribe(session, keys.clock_pace, Clock)
        self._subscribe(session, keys.tick("links"), Links)
        self._subscribe(session, keys.agent("*"), AgentStatus)
        self._subscribe(session, keys.clock_end, Header)
        session.subscribe(keys.logged("*", "*"), self._push_logged)
        loop = asyncio.get_running_loop()
        tokens: Inbox[bool] = Inbox(loop, self._router_came_or_went)
        session.watch_alive(keys.alive("router"), lambda _, is_alive: tokens.push(is_alive))

    async def look(self, *, closely: bool) -> None:
        """Take all that is shown, or only what the history needs."""
        async with self._changing:
            if closely and self._close is None and not self.over.is_set():
                self._close = await asyncio.to_thread(self._access.open)
                self._view.look_anew()
                self._look_closely(self._close)
            elif not closely and self._close is not None:
                session, self._close = self._close, None
                await asyncio.to_thread(session.close)

    def _look_closely(self, session: Session) -> None:
        keys = self._keys
        self._subscribe(session, keys.tick("truths"), Truths)
        self._subscribe(session, keys.tick("fates"), Fates)
        self._subscribe(session, keys.state("*"), AircraftState)

    async def close(self) -> None:
        """Leave."""
        await self.look(closely=False)
        if self._base is not None:
            await asyncio.to_thread(self._base.close)

    def _subscribe(self, session: Session, key: str, cls: type[Message]) -> None:
        def take(sample: Sample) -> None:
            self._take(decode(sample.payload.to_bytes(), cls), str(sample.key_expr))

        session.subscribe(key, lambda sample: self._inbox.push((take, sample)))

    def _dispatch(self, item: tuple[Callable[[Sample], None], Sample]) -> None:
        handler, sample = item
        try:
            handler(sample)
        except DecodeError as error:
            self.malformed += 1
            log.warning("%s: %s", sample.key_expr, error)

    def _take(self, message: Message, key: str) -> None:
        if isinstance(message, Header):  # the last tick
            self._end()
            return
        if isinstance(message, Clock) and key == self._keys.clock:
            self._go_back(message.header.stamp.ns)
        self._view.take(message, self._keys.node_of(key) if "/node/" in key else "")

    def _go_back(self, tick_ns: int) -> None:
        """Begin anew if the tick is an earlier one: a replay was moved back."""
        if tick_ns < self._view.sim_time_ns:
            self._view.forget()

    def _push_logged(self, sample: Sample) -> None:
        """Called by Zenoh's threads."""
        key, stamp = str(sample.key_expr), Stamp.from_sample(sample)
        if stamp is not None:
            name = key.rpartition("/")[2]
            payload = sample.payload.to_bytes()
            self._logged.push(LoggedSample(self._keys.node_of(key), name, stamp.sim_time_ns, payload))

    async def read_logged(self) -> None:
        """Take what agents log, now and then, until cancelled."""
        while True:
            await asyncio.sleep(LOGGED_PERIOD_S)
            for item in self._logged.read():
                self._view.logged.take(item.node, item.name, item.sim_time_ns, item.value)

    def _router_came_or_went(self, is_alive: bool) -> None:
        if not is_alive:
            self._end()

    def _end(self) -> None:
        self._view.end()
        self.over.set()
