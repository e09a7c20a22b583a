"""What the daemon by wall time and the held daemon have in common: all that a user of the library sees."""

from __future__ import annotations

import asyncio
import logging
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import asdict
from functools import partial
from typing import Any, Self

from aps.config import DaemonConfig
from aps.core import Core
from aps.links.address import LinkAddress, parse_address
from aps.links.kinds.drivers import Driver, make_driver
from aps.links.kinds.tcp import TcpServer
from aps.links.link import Link, Role
from aps.links.table import LinkTable
from aps.logs.tlog import TlogWriter
from aps.status import StatusServer, plain_state
from aps.timeouts import SILENCE_TIMEOUT_S
from aps.vehicle.status_text import StatusText
from aps.vehicle.subscription import Subscription
from aps.vehicle.telemetry import VehicleState
from aps.wire.framer import Frame

_log = logging.getLogger(__name__)


class DaemonBase(ABC):
    """One UA's MAVLink daemon; an async context manager.

    Args:
        config: its settings.
        clock: what time it is, ns, on a clock that never goes back.
        wake: called when a command has queued messages or changed deadlines.
        silence_s: for how long, by that clock, the autopilot's may stand still under an accepted command.
        measures_latency: whether to ask the autopilot for its time again and again.

    Raises:
        ValueError: a setting is out of range, or the file of events is none.
        OSError: the port is taken (on entering the context), the tlog cannot be written, or the file of events
            cannot be read.
    """

    def __init__(
        self,
        config: DaemonConfig,
        clock: Callable[[], int],
        wake: Callable[[], None],
        silence_s: float = SILENCE_TIMEOUT_S,
        *,
        measures_latency: bool = False,
    ) -> None:
        self.config = config
        self.core = Core(config, clock, wake, silence_s, measures_latency=measures_latency)
        self.links = LinkTable(
            self._link_opened,
            self._link_frames,
            self._link_closed,
            clock,
            first_id=1,
            max_clients=config.max_clients,
            frames_per_s=config.client_frames_per_s,
        )
        listen = LinkAddress("tcp-server", config.listen_host, config.listen_port)
        self.server = TcpServer(listen, self.links, config.queue_limit_bytes)
        self._addresses = [parse_address(text) for text in config.links]
        self.vehicle = self.core.vehicle
        self.commands = self.vehicle.commands
        self.hub, self.router = self.core.hub, self.core.router
        self.streams, self.telemetry = self.vehicle.streams, self.vehicle.telemetry
        if config.events_file is not None:
            self.vehicle.events.learn(config.events_file.read_bytes())
        self.failure: BaseException | None = None
        """What ended the daemon's own work, if something did."""
        self.on_failure: Callable[[BaseException], None] | None = None
        """Called, if set, when the daemon fails of itself (see ``failure``): a defect of ours or a host name that
        cannot even be looked up, not an autopilot that is away."""
        self.connections = 0
        """How often a link to the autopilot was made."""
        self.tlog: TlogWriter | None = None
        """The record of all frames, if there is one."""
        self._clock = clock
        self.drivers: list[Driver] = [self.server]
        self.opened: dict[int, Driver] = {}
        """What ``open`` has opened, by number."""
        self._opened_ever = 0
        self._status: StatusServer | None = None
        self._tasks: dict[Driver, asyncio.Task[None]] = {}
        self._shutting: set[asyncio.Future[None]] = set()
        self._heard_event = asyncio.Event()
        self.vehicle.on_heard = self._heard_event.set

    @property
    def state(self) -> VehicleState:
        """The UA's state now."""
        return self.telemetry.state(self._clock())

    @property
    def link_up(self) -> bool:
        """Whether there is a connection to the autopilot."""
        return self.core.link_up

    @property
    def listen_port(self) -> int:
        """TCP port for MAVLink clients."""
        return self.server.port

    @property
    def texts(self) -> Callable[[StatusText], None] | None:
        """Called with each text of the autopilot, if set."""
        return self.vehicle.texts

    @texts.setter
    def texts(self, callback: Callable[[StatusText], None] | None) -> None:
        self.vehicle.texts = callback

    def subscribe(
        self, callback: Callable[[VehicleState], None], rate_hz: float | None = None
    ) -> Subscription:
        """Call back with the state as it changes.

        Args:
            callback: runs in the event loop (in held mode: within ``begin_exchange``); must not block.
            rate_hz: at most so often, in the autopilot's own time; ``None``: after every batch of telemetry.
        """
        return self.vehicle.subscriptions.add(callback, rate_hz)

    async def wait_heard(self) -> None:
        """Wait until the autopilot's heartbeat has been heard on this connection.

        Raises:
            RuntimeError: the daemon has failed: the autopilot will not be heard any more.
        """
        await self._heard_event.wait()
        if self.failure is not None:
            raise RuntimeError(f"the link to the autopilot failed: {self.failure!r}") from self.failure

    def statistics(self) -> dict[str, Any]:
        """Counters of everything, as plain data."""
        now_ns = self._clock()
        return {
            "autopilot": {
                "connections": self.connections,
                "reboots": self.telemetry.reboots,
                **self.core.autopilot_statistics(now_ns),
            },
            "autopilot_links": [
                dict(link.statistics(now_ns))
                for link in self.hub.links.values()
                if link.role is Role.AUTOPILOT
            ],
            **self.core.statistics(),
            **self.links.statistics(),
            **({} if self.tlog is None else {"tlog": asdict(self.tlog.counters)}),
            "failure": None if self.failure is None else repr(self.failure),
        }

    def told(self) -> dict[str, Any]:
        """State and counters as plain data: what ``lostlink aps status`` shows; what is not known is ``None``."""
        return {"sysid": self.config.sysid, "state": plain_state(self.state), "statistics": self.statistics()}

    # Recording.

    def _open_tlog(self, clock_us: Callable[[], int], gather_bytes: int = 0) -> None:
        """Begin to record, if the settings say so; see `TlogWriter`."""
        config = self.config
        if config.tlog_directory is not None:
            name = config.tlog_name or f"mavlink-{config.sysid}"
            self.tlog = TlogWriter(
                config.tlog_directory,
                name,
                clock_us,
                config.tlog_file_bytes,
                config.tlog_files,
                gather_bytes,
            )
            self.hub.taps.append(self._record)

    def _record(self, raw: bytes, _: Link) -> None:
        if self.tlog is not None:
            self.tlog.write(raw)

    # Links at run time.

    async def open(self, address: str, role: Role = Role.CLIENT) -> Driver:
        """Open links at a place, now and for as long as the daemon runs, or until ``shut``; ``opened`` has it.

        What goes wrong there later (a name that cannot be looked up) ends these links, not the daemon.

        Args:
            address: as ``aps.links.address.parse_address`` reads it.
            role: what is there.

        Raises:
            ValueError: the address cannot be read.
            OSError: a port is taken.
        """
        driver = await self._start(
            make_driver(parse_address(address, role), self.links, self.config.queue_limit_bytes)
        )
        self._opened_ever += 1
        self.opened[self._opened_ever] = driver
        return driver

    async def shut(self, driver: Driver) -> None:
        """Close what ``open`` has opened, with its links."""
        self.drivers.remove(driver)
        self.opened = {number: other for number, other in self.opened.items() if other is not driver}
        task = self._tasks.pop(driver, None)
        if task is not None:
            task.cancel()
            await asyncio.gather(task, return_exceptions=True)
        driver.close()

    async def _start(self, driver: Driver) -> Driver:
        await driver.start()
        if driver not in self.drivers:
            self.drivers.append(driver)
        self._tasks[driver] = asyncio.create_task(driver.run(), name=f"link {driver.address}")
        self._tasks[driver].add_done_callback(partial(self._driver_ended, driver))
        return driver

    def _driver_ended(self, driver: Driver, task: asyncio.Task[None]) -> None:
        error = None if task.cancelled() else task.exception()
        if error is None:
            return
        if driver not in self.opened.values():
            self._failed(error)
            return
        _log.warning("no links at %s any more: %s", driver.address, error)
        self._shutting.add(shutting := asyncio.ensure_future(self.shut(driver)))
        shutting.add_done_callback(self._shutting.discard)

    def _failed(self, error: BaseException) -> None:
        """Say so in every way: the daemon is of no use."""
        _log.error("the daemon of system %d failed", self.config.sysid, exc_info=error)
        self.failure = error
        self._heard_event.set()  # nobody shall wait for ever
        self.vehicle.callbacks.call("the callback for failures", self.on_failure, error)
        self.commands.interrupt_all(f"the daemon failed: {error!r}")

    async def __aenter__(self) -> Self:
        try:
            await self._start(self.server)
            for address in self._addresses:
                await self._start(make_driver(address, self.links, self.config.queue_limit_bytes))
        except BaseException:
            await self._stop()
            raise
        self._status = StatusServer(str(self.listen_port), self.told)
        await self._status.start()
        return self

    async def __aexit__(self, *_: object) -> None:
        self.commands.interrupt_all("the daemon stops")
        await self._stop()

    async def _stop(self) -> None:
        if self._status is not None:
            self._status.close()
        tasks = list(self._tasks.values())
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        for driver in self.drivers:
            driver.close()
        self.links.close()
        if self.tlog is not None:
            self.tlog.close()

    @abstractmethod
    def _link_opened(self, link: Link) -> None:
        """A link is there."""

    @abstractmethod
    def _link_frames(self, link: Link, frames: Sequence[Frame], size_bytes: int) -> None:
        """Frames from a link."""

    @abstractmethod
    def _link_closed(self, link: Link) -> None:
        """A link is gone."""
