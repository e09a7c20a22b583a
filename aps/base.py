"""What the daemon by wall time and the held daemon have in common: all that a user of the library sees."""

from __future__ import annotations

import asyncio
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import asdict
from types import TracebackType
from typing import Any, Protocol, Self

from aps.config import DaemonConfig
from aps.core import AUTOPILOT_LINK, Core
from aps.links.endpoints import Client, ClientServer
from aps.links.outbox import FrameQueue
from aps.timeouts import SILENCE_TIMEOUT_S
from aps.vehicle.status_text import StatusText
from aps.vehicle.subscription import Subscription
from aps.vehicle.telemetry import AircraftState

__all__ = ["DaemonBase", "Link"]


class Link(Protocol):
    """The connection to the autopilot."""

    connections: int
    """How often a connection was made."""

    @property
    def up(self) -> bool:
        """Whether there is a connection now."""

    @property
    def outbox(self) -> FrameQueue:
        """What waits to be sent."""


class DaemonBase(ABC):
    """One UA's MAVLink daemon; an async context manager.

    Args:
        config: its settings.
        link: the connection to the autopilot.
        clock: what time it is, ns, on a clock that never goes back.
        wake: called when a command has queued messages or changed deadlines.
        silence_s: for how long, by that clock, the autopilot's may stand still under an accepted command.

    Raises:
        ValueError: a setting is out of range.
        OSError: the port is taken (on entering the context).
    """

    def __init__(
        self,
        config: DaemonConfig,
        link: Link,
        clock: Callable[[], int],
        wake: Callable[[], None],
        silence_s: float = SILENCE_TIMEOUT_S,
    ) -> None:
        self.config = config
        self.core = Core(config, link.outbox, clock, wake, silence_s)
        self.server = ClientServer(
            self._client_opened,
            self._client_data,
            self._client_closed,
            first_link=AUTOPILOT_LINK + 1,
            limit_bytes=config.queue_limit_bytes,
            max_clients=config.max_clients,
        )
        self.vehicle = self.core.vehicle
        self.commands = self.vehicle.commands
        self.framer, self.router = self.core.framer, self.core.router
        self.streams, self.telemetry = self.vehicle.streams, self.vehicle.telemetry
        self.failure: BaseException | None = None
        """What ended the daemon's own work, if something did."""
        self._link, self._clock = link, clock
        self._heard_event = asyncio.Event()
        self.vehicle.on_heard = self._heard_event.set

    @property
    def state(self) -> AircraftState:
        """The UA's state now."""
        return self.telemetry.state(self._clock())

    @property
    def link_up(self) -> bool:
        """Whether there is a connection to the autopilot."""
        return self._link.up

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
        self, callback: Callable[[AircraftState], None], rate_hz: float | None = None
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
        return {
            "autopilot": {
                "connections": self._link.connections,
                "reboots": self.telemetry.reboots,
                "framer": asdict(self.framer.counters),
                "outbox": asdict(self._link.outbox.counters),
            },
            **self.core.statistics(),
            "clients": [
                {
                    "peer": client.peer,
                    "framer": asdict(client.framer.counters),
                    "outbox": asdict(client.outbox.counters),
                }
                for client in self.server.clients.values()
            ],
            "turned_away": self.server.turned_away,
            "failure": None if self.failure is None else repr(self.failure),
        }

    async def __aenter__(self) -> Self:
        await self.server.listen(self.config.listen_host, self.config.listen_port)
        return self

    async def __aexit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.commands.interrupt_all("the daemon stops")
        self.server.close()

    def _autopilot_up(self) -> None:
        self.core.autopilot_up(self._clock())

    def _autopilot_down(self) -> None:
        self._heard_event.clear()
        self.core.autopilot_down()

    @abstractmethod
    def _client_opened(self, client: Client) -> None:
        """A client is there."""

    @abstractmethod
    def _client_data(self, client: Client, data: bytes) -> None:
        """Bytes from a client."""

    @abstractmethod
    def _client_closed(self, client: Client) -> None:
        """A client is gone."""
