"""The daemon of one UA by wall time: what comes is handled as it comes.

    async with Daemon(DaemonConfig(autopilot="tcp:127.0.0.1:5760", sysid=1)) as daemon:
        result = await daemon.commands.takeoff(40.0)

We speak as component MAV_COMP_ID_ONBOARD_COMPUTER (191) of the UA's own system: the daemon is part of the
aircraft, not a ground station. ArduPilot accepts commands from its own system in any configuration
(SYSID_ENFORCE, MAV_GCS_SYSID), and our heartbeat does not feed its ground-station fail-safe, as one from
system 255 would even when the real ground station is gone.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Sequence
from typing import Self

from aps.base import DaemonBase
from aps.config import NS_PER_S, DaemonConfig
from aps.links.address import parse_autopilot
from aps.links.kinds.drivers import make_driver
from aps.links.link import Link, Role
from aps.wire.framer import Frame

__all__ = ["Daemon", "DaemonConfig"]


class Daemon(DaemonBase):
    """One UA's MAVLink daemon by wall time; an async context manager.

    Raises:
        ValueError: a setting is out of range.
        OSError: the port is taken (on entering the context), or the tlog cannot be written.
    """

    def __init__(self, config: DaemonConfig) -> None:
        self._autopilots = [parse_autopilot(text) for text in (config.autopilot, *config.more_autopilots)]
        super().__init__(config, time.monotonic_ns, self._wake, measures_latency=True)
        self._open_tlog(lambda: time.time_ns() // 1000)
        self._timer: asyncio.TimerHandle | None = None
        self._timer_ns = 0
        self._running = False

    async def __aenter__(self) -> Self:
        await super().__aenter__()
        self._running = True
        try:
            for address in self._autopilots:
                await self._start(make_driver(address, self.links, self.config.queue_limit_bytes))
        except BaseException:
            await self.__aexit__()
            raise
        self._wake()
        return self

    async def __aexit__(self, *error: object) -> None:
        self._running = False
        await super().__aexit__(*error)
        if self._timer is not None:
            self._timer.cancel()

    # What happens.

    def _link_opened(self, link: Link) -> None:
        if link.role is Role.AUTOPILOT:
            self.connections += 1
        self.core.link_opened(link, time.monotonic_ns())
        self._wake()

    def _link_closed(self, link: Link) -> None:
        up = self.link_up
        self.core.link_closed(link.id, time.monotonic_ns())
        if up and not self.link_up:
            self._heard_event.clear()
        self._on_time()

    def _link_frames(self, link: Link, frames: Sequence[Frame], _size_bytes: int) -> None:
        if frames:
            self.core.frames(link, frames, time.monotonic_ns())
            self.links.flush()
        if link.role is Role.CLIENT:
            self._on_time()
        else:
            self._wake()

    # Time.

    def _on_time(self) -> None:
        self.core.on_time(time.monotonic_ns())
        self._wake()

    def _wake(self) -> None:
        """Send what waits for the autopilot, and have ``_on_timer`` run at the earliest deadline."""
        primary = self.hub.primary
        if primary is not None:
            primary.outbox.flush()
        if self.failure is not None or not self._running:
            return
        due_ns = self.core.deadline_ns()
        if self._timer is not None:
            if self._timer_ns <= due_ns:
                return
            self._timer.cancel()
        delay_s = max(0.0, (due_ns - time.monotonic_ns()) / NS_PER_S)
        self._timer_ns = due_ns
        self._timer = asyncio.get_running_loop().call_later(delay_s, self._on_timer)

    def _on_timer(self) -> None:
        self._timer = None
        try:
            self._on_time()
        except Exception as error:
            self._failed(error)
