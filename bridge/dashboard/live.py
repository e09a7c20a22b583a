"""A running simulation as the view's source: two sessions as an observer, the second only while somebody looks."""

from __future__ import annotations

import asyncio
import json
import logging
from collections.abc import Callable
from typing import Any

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
from bridge.bus.session import Sample, Session
from bridge.dashboard.fleet_view import FleetView
from bridge.run.access import Access

WAITING_MAX = 4_000
"""Samples that may wait to be taken; the oldest give way."""
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
        loop = asyncio.get_running_loop()
        tokens: Inbox[bool] = Inbox(loop, self._router_came_or_went)
        session.watch_alive(keys.alive("router"), lambda _, is_alive: tokens.push(is_alive))

    async def look(self, *, closely: bool) -> None:
        """Take all that is shown, or only what the history needs."""
        async with self._changing:
            if closely and self._close is None and not self.over.is_set():
                self._close = await asyncio.to_thread(self._access.open)
                self._view.cut_trail()
                self._look_closely(self._close)
            elif not closely and self._close is not None:
                session, self._close = self._close, None
                await asyncio.to_thread(session.close)

    def _look_closely(self, session: Session) -> None:
        keys = self._keys
        self._subscribe(session, keys.tick("truths"), Truths)
        self._subscribe(session, keys.tick("fates"), Fates)
        self._subscribe(session, keys.state("*"), AircraftState)
        session.subscribe(
            f"{keys.prefix}/node/*/log/**", lambda sample: self._inbox.push((self._take_logged, sample))
        )

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
        else:
            self._view.take(message, self._keys.node_of(key) if "/node/" in key else "")

    def _take_logged(self, sample: Sample) -> None:
        node, _, name = str(sample.key_expr)[len(self._keys.prefix) + 6 :].partition("/log/")
        self._view.take_logged(node, name, self._view.sim_time_ns, readable(sample.payload.to_bytes()))

    def _router_came_or_went(self, is_alive: bool) -> None:
        if not is_alive:
            self._end()

    def _end(self) -> None:
        self._view.end()
        self.over.set()


def readable(payload: bytes) -> Any:
    """What an agent logged, as JSON says it, or the start of its bytes."""
    try:
        return json.loads(payload)
    except ValueError:
        return payload[:32].hex()
