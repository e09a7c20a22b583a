"""The daemon's logic: one vehicle, and the routing between its autopilot and the clients. No I/O, no asyncio, no clock.

Frames and instants go in; what is to be sent is put into the queues in front of the links. Who reads the
links, writes the queues and says what time it is are the shells: ``aps.daemon`` by wall time,
``aps.held`` by sim time.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final, Protocol

from aps.config import NS_PER_S, DaemonConfig
from aps.hub.routing import Router
from aps.timeouts import HEARTBEAT_PERIOD_S, SILENCE_TIMEOUT_S
from aps.vehicle.vehicle import Vehicle
from aps.wire.dialect import AUTOPILOT_COMPID, ONBOARD_COMPUTER_COMPID
from aps.wire.framer import Frame, Framer

__all__ = ["AUTOPILOT_LINK", "Core", "Queue"]

AUTOPILOT_LINK: Final = 0
"""Link id of the autopilot; clients have others."""
HEARTBEAT_PERIOD_NS: Final = round(HEARTBEAT_PERIOD_S * NS_PER_S)


class Queue(Protocol):
    """What waits to be sent on one link."""

    def put(self, frame: bytes) -> None:
        """Queue one frame."""


class Core:
    """One UA's daemon without its links.

    Args:
        config: its settings.
        to_autopilot: what waits to be sent to the autopilot.
        clock: the shell's clock, ns, for what users start and ask between two events.
        wake: called when a command has queued messages or changed deadlines.
        silence_s: for how long, by that clock, the autopilot's may stand still under an accepted command.

    Every event takes ``now_ns``, an instant of the same clock; instants never go back.
    """

    def __init__(
        self,
        config: DaemonConfig,
        to_autopilot: Queue,
        clock: Callable[[], int],
        wake: Callable[[], None],
        silence_s: float = SILENCE_TIMEOUT_S,
    ) -> None:
        self.config = config
        self.vehicle = Vehicle(
            config.sysid, config.stream_rates_hz, to_autopilot.put, clock, wake, silence_s, config.autopilot
        )
        self.router = Router(
            config.sysid,
            ONBOARD_COMPUTER_COMPID,
            AUTOPILOT_COMPID,
            round(config.route_expiry_s * NS_PER_S),
        )
        self.framer = Framer()
        self.link_up = False
        self._queues: dict[int, Queue] = {AUTOPILOT_LINK: to_autopilot}
        self._heartbeat_due_ns = 0
        self.router.add_link(AUTOPILOT_LINK, autopilot=True)

    def statistics(self) -> dict[str, Any]:
        """Counters of the logic, as plain data."""
        return {
            "routes": {outcome.value: count for outcome, count in self.router.counters.items()},
            **self.vehicle.statistics(),
        }

    # The autopilot's link.

    def autopilot_up(self, now_ns: int) -> None:
        """There is a connection."""
        self.link_up = True
        self.framer.reset()
        self._heartbeat_due_ns = now_ns  # introduce ourselves at once
        self.vehicle.link_up()

    def autopilot_down(self) -> None:
        """The connection is gone."""
        self.link_up = False
        self.vehicle.link_down()

    def autopilot_data(self, data: bytes, now_ns: int) -> None:
        """Bytes from the autopilot, in any chunking."""
        changed = False
        for frame in self.framer.receive(data):
            changed |= self.vehicle.receive(frame, now_ns)
            for link in self.router.route(frame, AUTOPILOT_LINK, now_ns).links:
                self._queues[link].put(frame.raw)
        if changed:
            self.vehicle.state_changed(now_ns)

    # The clients' links.

    def client_opened(self, link: int, queue: Queue) -> None:
        """A client is there; ``queue`` is what waits to be sent to it."""
        self.router.add_link(link)
        self._queues[link] = queue

    def client_closed(self, link: int) -> None:
        """A client is gone, and its wishes with it (see ``on_time`` for what follows from that)."""
        self.router.remove_link(link)
        del self._queues[link]
        self.vehicle.client_left(link)

    def client_frame(self, frame: Frame, link: int, now_ns: int) -> None:
        """A frame from a client (call ``on_time`` after the last of several)."""
        for other in self.router.route(frame, link, now_ns).links:
            raw: bytes | None = frame.raw
            if other == AUTOPILOT_LINK:
                raw = self.vehicle.client_frame(frame, link)
            if raw is not None:
                self._queues[other].put(raw)

    # Time.

    def deadline_ns(self) -> int:
        """When ``on_time`` is due even if nothing happens."""
        due_ns = self.vehicle.deadline_ns()
        return self._heartbeat_due_ns if due_ns is None else min(self._heartbeat_due_ns, due_ns)

    def on_time(self, now_ns: int) -> None:
        """Do what is due: heartbeat, expiry of routes, stream requests, commands."""
        if now_ns >= self._heartbeat_due_ns:
            self._heartbeat_due_ns = now_ns + HEARTBEAT_PERIOD_NS
            if self.link_up:
                # To the autopilot alone: a script that takes the first heartbeat for the vehicle's would take ours.
                self.vehicle.heartbeat()
            self.router.expire(now_ns)
        self.vehicle.on_time(now_ns)
