"""The TCP connection to the autopilot: one client, reconnecting with back-off.

ArduPilot's serial-over-TCP port serves a single client, so this connection is the daemon's for good and
everybody else talks to the daemon.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable
from typing import NamedTuple

from aps.links.outbox import Outbox
from aps.timeouts import CONNECT_TIMEOUT_S, FIRST_RETRY_S, LONGEST_RETRY_S

__all__ = ["AutopilotAddress", "AutopilotLink", "parse_autopilot", "parse_host_port"]

_log = logging.getLogger(__name__)


class AutopilotAddress(NamedTuple):
    """Where the autopilot listens."""

    host: str
    port: int

    def __str__(self) -> str:
        return f"tcp:{self.host}:{self.port}"


def parse_host_port(text: str, *, lowest_port: int = 1) -> tuple[str, int]:
    """``HOST:PORT`` (``[::1]:PORT`` for IPv6).

    Raises:
        ValueError: with the text and what is allowed.
    """
    host, colon, port = text.rpartition(":")
    if not colon or not host or not port.isdecimal() or not lowest_port <= int(port) <= 65535:
        raise ValueError(f"{text!r} is not HOST:PORT with a port in {lowest_port}..65535")
    return host.removeprefix("[").removesuffix("]"), int(port)


def parse_autopilot(text: str) -> AutopilotAddress:
    """``tcp:HOST:PORT``.

    Raises:
        ValueError: with the text and what is allowed.
    """
    scheme, _, rest = text.partition(":")
    if scheme != "tcp":
        raise ValueError(f"autopilot {text!r} is not tcp:HOST:PORT")
    return AutopilotAddress(*parse_host_port(rest))


class AutopilotLink(asyncio.Protocol):
    """Keeps one TCP connection up. Callbacks run in the event loop.

    Args:
        address: where to connect.
        on_data: bytes as they come.
        on_up: a connection is there.
        on_down: it is gone.
        limit_bytes: bound of the queue towards the autopilot.
    """

    def __init__(
        self,
        address: AutopilotAddress,
        on_data: Callable[[bytes], None],
        on_up: Callable[[], None],
        on_down: Callable[[], None],
        limit_bytes: int,
    ) -> None:
        self.address = address
        self.outbox = Outbox(limit_bytes)
        self.connections = 0
        """How often a connection was made."""
        self._on_data, self._on_up, self._on_down = on_data, on_up, on_down
        self._transport: asyncio.Transport | None = None
        self._lost = asyncio.Event()
        self._heard = False
        self._why: Exception | None = None

    @property
    def up(self) -> bool:
        """Whether there is a connection now."""
        return self._transport is not None

    async def run(self) -> None:
        """Connect and reconnect until cancelled; the connection is closed on the way out."""
        retry_s = FIRST_RETRY_S
        told = False
        try:
            while True:
                if await self._connect(tell=not told):
                    told = False
                    await self._lost.wait()
                    why = f" ({self._why})" if self._why is not None else ""
                    _log.warning("connection to the autopilot at %s lost%s", self.address, why)
                    retry_s = FIRST_RETRY_S if self._heard else retry_s
                else:
                    told = True
                await asyncio.sleep(retry_s)
                retry_s = min(retry_s * 2.0, LONGEST_RETRY_S)
        finally:
            self.close()

    async def _connect(self, *, tell: bool) -> bool:
        self._lost.clear()
        self._heard = False
        loop = asyncio.get_running_loop()
        try:
            async with asyncio.timeout(CONNECT_TIMEOUT_S):
                await loop.create_connection(lambda: self, self.address.host, self.address.port)
        except OSError as error:
            if tell:
                _log.warning("no autopilot at %s yet (%s): trying again", self.address, error)
            return False
        self.connections += 1
        _log.info("connected to the autopilot at %s", self.address)
        return True

    def close(self) -> None:
        """Drop the connection, if there is one."""
        if self._transport is not None:
            self._transport.abort()

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """asyncio: the connection is there."""
        assert isinstance(transport, asyncio.Transport)
        self._transport = transport
        self.outbox.open(transport)
        self._on_up()

    def data_received(self, data: bytes) -> None:
        """asyncio: bytes came."""
        self._heard = True
        self._on_data(data)

    def pause_writing(self) -> None:
        """asyncio: the write buffer is full."""
        self.outbox.pause()

    def resume_writing(self) -> None:
        """asyncio: the write buffer has room again."""
        self.outbox.resume()

    def connection_lost(self, exc: Exception | None) -> None:
        """asyncio: the connection is gone."""
        self._transport, self._why = None, exc
        self.outbox.close()
        self._lost.set()
        self._on_down()
