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
import logging
import time
from collections.abc import Callable
from types import TracebackType
from typing import Self

from aps.base import DaemonBase
from aps.config import NS_PER_S, DaemonConfig
from aps.links.autopilot_link import AutopilotLink, parse_autopilot
from aps.links.endpoints import Client

__all__ = ["Daemon", "DaemonConfig"]

_log = logging.getLogger(__name__)


class Daemon(DaemonBase):
    """One UA's MAVLink daemon by wall time; an async context manager.

    Raises:
        ValueError: a setting is out of range.
        OSError: the port is taken (on entering the context).
    """

    def __init__(self, config: DaemonConfig) -> None:
        self.link = AutopilotLink(
            parse_autopilot(config.autopilot),
            self._autopilot_data,
            self._autopilot_up,
            self._autopilot_down,
            config.queue_limit_bytes,
        )
        super().__init__(config, self.link, time.monotonic_ns, self._wake)
        self.on_failure: Callable[[BaseException], None] | None = None
        """Called, if set, when the daemon fails of itself (see ``failure``): a defect of ours or a host name that
        cannot even be looked up, not an autopilot that is away."""
        self._timer: asyncio.TimerHandle | None = None
        self._timer_ns = 0
        self._link_task: asyncio.Task[None] | None = None

    async def __aenter__(self) -> Self:
        await super().__aenter__()
        self._link_task = asyncio.create_task(self.link.run(), name="autopilot link")
        self._link_task.add_done_callback(self._link_ended)
        self._wake()
        return self

    async def __aexit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        await super().__aexit__(kind, error, traceback)
        if self._link_task is not None:
            self._link_task.cancel()
            await asyncio.gather(self._link_task, return_exceptions=True)
        if self._timer is not None:
            self._timer.cancel()

    def _link_ended(self, task: asyncio.Task[None]) -> None:
        error = None if task.cancelled() else task.exception()
        if error is not None:
            self._failed(error)

    def _failed(self, error: BaseException) -> None:
        """Say so in every way: without its link or its timer the daemon is of no use."""
        _log.error("the daemon of system %d failed", self.config.sysid, exc_info=error)
        self.failure = error
        self._heard_event.set()  # nobody shall wait for ever
        self.vehicle.callbacks.call("the callback for failures", self.on_failure, error)
        self.commands.interrupt_all(f"the daemon failed: {error!r}")

    # What happens.

    def _autopilot_data(self, data: bytes) -> None:
        self.core.autopilot_data(data, time.monotonic_ns())
        for client in self.server.clients.values():
            client.outbox.flush()
        self._wake()

    def _client_opened(self, client: Client) -> None:
        self.core.client_opened(client.link, client.outbox)

    def _client_closed(self, client: Client) -> None:
        self.core.client_closed(client.link)
        self._on_time()

    def _client_data(self, client: Client, data: bytes) -> None:
        now_ns = time.monotonic_ns()
        for frame in client.framer.receive(data):
            self.core.client_frame(frame, client.link, now_ns)
        for other in self.server.clients.values():
            other.outbox.flush()
        self._on_time()

    def _autopilot_up(self) -> None:
        super()._autopilot_up()
        self._wake()

    # Time.

    def _on_time(self) -> None:
        self.core.on_time(time.monotonic_ns())
        self._wake()

    def _wake(self) -> None:
        """Send what waits for the autopilot, and have ``_on_timer`` run at the earliest deadline."""
        self.link.outbox.flush()
        task = self._link_task
        if self.failure is not None or task is None or task.cancelling() or task.done():
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
