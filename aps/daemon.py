"""The daemon of one UA: joins the autopilot's link, the clients, state, streams and commands.

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
from dataclasses import asdict
from types import TracebackType
from typing import Any, Final, Self

from aps.autopilot_link import AutopilotLink, parse_autopilot
from aps.commander import Commander
from aps.config import DaemonConfig
from aps.dialect import (
    AUTOPILOT_COMPID,
    ONBOARD_COMPUTER_COMPID,
    Encoder,
    mavlink,
    onboard_computer_heartbeat,
    set_message_interval,
)
from aps.endpoints import Client, ClientServer
from aps.framer import Frame, Framer
from aps.outbox import Outbox
from aps.routing import Router
from aps.status_text import STATUSTEXT_ID, StatusText, StatusTextAssembler
from aps.streams import SET_MESSAGE_INTERVAL, StreamArbiter
from aps.subscription import Subscription
from aps.telemetry import AircraftState, Telemetry

__all__ = ["Daemon", "DaemonConfig"]

NS_PER_S: Final = 1_000_000_000
HEARTBEAT_PERIOD_NS: Final = NS_PER_S
SILENT_HEARTBEATS: Final = 4
"""So many autopilot heartbeats without any message that carries its clock: its streams are gone."""

_AUTOPILOT_LINK: Final = 0
_HEARTBEAT: Final = 0
_PARAM_VALUE: Final = 22
_COMMAND_ACK: Final = 77
_ACK_BYTES: Final = 10
_ACCEPTED: Final = int(mavlink.MAV_RESULT_ACCEPTED)

_log = logging.getLogger(__name__)


class Daemon:
    """One UA's MAVLink daemon; an async context manager.

    Raises:
        ValueError: a setting is out of range.
        OSError: the port is taken (on entering the context).
    """

    def __init__(self, config: DaemonConfig) -> None:
        address = parse_autopilot(config.autopilot)
        self.config = config
        self.telemetry = Telemetry(config.sysid)
        self.streams = StreamArbiter(config.stream_rates_hz)
        self.router = Router(
            config.sysid,
            ONBOARD_COMPUTER_COMPID,
            AUTOPILOT_COMPID,
            round(config.route_expiry_s * NS_PER_S),
        )
        self.framer = Framer()
        self.commands = Commander(lambda: self.state, self._send, time.monotonic_ns, self._arm_timer)
        self.link = AutopilotLink(
            address, self._autopilot_data, self._autopilot_up, self._autopilot_down, config.queue_limit_bytes
        )
        self.server = ClientServer(
            self._client_opened,
            self._client_data,
            self._client_closed,
            first_link=_AUTOPILOT_LINK + 1,
            limit_bytes=config.queue_limit_bytes,
            max_clients=config.max_clients,
        )
        self.texts: Callable[[StatusText], None] | None = None
        """Called with each text of the autopilot, if set."""
        self._encoder = Encoder(config.sysid, ONBOARD_COMPUTER_COMPID)
        self._assembler = StatusTextAssembler()
        self._outboxes: dict[int, Outbox] = {_AUTOPILOT_LINK: self.link.outbox}
        self._subscriptions: set[Subscription] = set()
        self._offered_ms = 0
        self._heard = False
        self._foreign: set[int] = set()
        self._silent_heartbeats = 0
        self._clock_ms = 0
        self._heartbeat_due_ns = 0
        self._timer: asyncio.TimerHandle | None = None
        self._timer_ns = 0
        self._link_task: asyncio.Task[None] | None = None
        self._heard_event = asyncio.Event()

    # What a user of the library sees.

    @property
    def state(self) -> AircraftState:
        """The UA's state now."""
        return self.telemetry.state(time.monotonic_ns())

    @property
    def listen_port(self) -> int:
        """TCP port for MAVLink clients."""
        return self.server.port

    def subscribe(
        self, callback: Callable[[AircraftState], None], rate_hz: float | None = None
    ) -> Subscription:
        """Call back with the state as it changes.

        Args:
            callback: runs in the event loop; must not block.
            rate_hz: at most so often, in the autopilot's own time; ``None``: after every batch of telemetry.
        """
        if rate_hz is not None and not rate_hz > 0.0:
            raise ValueError(f"rate_hz must be positive, not {rate_hz}")
        period_ms = 0.0 if rate_hz is None else 1000.0 / rate_hz
        subscription = Subscription(callback, period_ms, self._subscriptions.discard)
        self._subscriptions.add(subscription)
        return subscription

    async def wait_heard(self) -> None:
        """Wait until the autopilot's heartbeat has been heard on this connection."""
        await self._heard_event.wait()

    def statistics(self) -> dict[str, Any]:
        """Counters of everything, as plain data."""
        return {
            "autopilot": {
                "connections": self.link.connections,
                "reboots": self.telemetry.reboots,
                "framer": asdict(self.framer.counters),
                "outbox": asdict(self.link.outbox.counters),
            },
            "routes": {outcome.value: count for outcome, count in self.router.counters.items()},
            "streams": asdict(self.streams.counters),
            "clients": [
                {
                    "peer": client.peer,
                    "framer": asdict(client.framer.counters),
                    "outbox": asdict(client.outbox.counters),
                }
                for client in self.server.clients.values()
            ],
            "turned_away": self.server.turned_away,
        }

    async def __aenter__(self) -> Self:
        await self.server.listen(self.config.listen_host, self.config.listen_port)
        self.router.add_link(_AUTOPILOT_LINK, autopilot=True)
        self._link_task = asyncio.create_task(self.link.run(), name="autopilot link")
        self._arm_timer()
        return self

    async def __aexit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.commands.interrupt_all("the daemon stops")
        self.server.close()
        if self._timer is not None:
            self._timer.cancel()
        if self._link_task is not None:
            self._link_task.cancel()
            await asyncio.gather(self._link_task, return_exceptions=True)
        if self._timer is not None:
            self._timer.cancel()

    # From the autopilot.

    def _autopilot_up(self) -> None:
        self.framer.reset()
        self._heard = False
        self._heartbeat_due_ns = 0  # introduce ourselves at once
        self._arm_timer()
        self.commands.on_link(True)

    def _autopilot_down(self) -> None:
        self._heard = False
        self._heard_event.clear()
        self.streams.disconnected()
        self.commands.on_link(False)

    def _autopilot_data(self, data: bytes) -> None:
        now_ns = time.monotonic_ns()
        own = self.config.sysid
        changed = False
        for frame in self.framer.receive(data):
            if frame.compid == AUTOPILOT_COMPID:
                if frame.sysid == own:
                    changed |= self._from_autopilot(frame, now_ns)
                    if self._subscriptions and self.telemetry.clock_ms != self._offered_ms:
                        self._clock_advanced()
                else:
                    self._from_foreign(frame)
            route = self.router.route(frame, _AUTOPILOT_LINK, now_ns)
            for link in route.links:
                self._outboxes[link].put(frame.raw)
        for client in self.server.clients.values():
            client.outbox.flush()
        if changed:
            self._state_changed()

    def _from_autopilot(self, frame: Frame, now_ns: int) -> bool:
        """Feed state, streams and commands; returns whether the state may have changed."""
        reboots = self.telemetry.reboots
        if self.telemetry.update(frame, now_ns):
            if self.telemetry.reboots != reboots:
                self._autopilot_rebooted()
            if frame.msg_id == _HEARTBEAT:
                self._autopilot_heartbeat()
            return True
        if frame.msg_id == _COMMAND_ACK:
            self._command_ack(frame)
        elif frame.msg_id == STATUSTEXT_ID:
            self._status_text(frame)
        elif frame.msg_id == _PARAM_VALUE:
            self.commands.on_parameter(frame.payload[8:24].split(b"\0", 1)[0].decode("ascii", "replace"))
            return True
        return False

    def _from_foreign(self, frame: Frame) -> None:
        if frame.msg_id == _HEARTBEAT and frame.sysid not in self._foreign:
            self._foreign.add(frame.sysid)
            _log.warning(
                "the autopilot at %s calls itself system %d, expected %d (--sysid)",
                self.link.address,
                frame.sysid,
                self.config.sysid,
            )

    def _autopilot_heartbeat(self) -> None:
        clock_ms = self.telemetry.clock_ms
        self._silent_heartbeats = 0 if clock_ms != self._clock_ms else self._silent_heartbeats + 1
        self._clock_ms = clock_ms
        if not self._heard:
            self._heard = True
            self._heard_event.set()
            _log.info("autopilot of system %d heard: %s", self.config.sysid, self.state.mode)
        elif self._silent_heartbeats < SILENT_HEARTBEATS or not self.streams.idle:
            return
        else:
            _log.info("nothing but heartbeats from the autopilot: asking for its streams anew")
        self._silent_heartbeats = 0
        self._ask_for_streams()

    def _autopilot_rebooted(self) -> None:
        _log.warning("the autopilot's clock went back: it has rebooted")
        self.commands.interrupt_all("the autopilot rebooted")
        self._ask_for_streams()

    def _ask_for_streams(self) -> None:
        self.streams.connected()
        self._pump_streams(time.monotonic_ns())
        self._arm_timer()

    def _command_ack(self, frame: Frame) -> None:
        payload = frame.payload.ljust(_ACK_BYTES, b"\0")
        command, result, progress = int.from_bytes(payload[:2], "little"), payload[2], payload[3]
        if payload[8] not in (0, self.config.sysid) or payload[9] not in (0, ONBOARD_COMPUTER_COMPID):
            return
        if command == SET_MESSAGE_INTERVAL:
            self.streams.acknowledged(result == _ACCEPTED)
            self._pump_streams(time.monotonic_ns())
            self._arm_timer()
        else:
            self.commands.on_ack(command, result, progress)

    def _status_text(self, frame: Frame) -> None:
        text = self._assembler.take(frame)
        if text is not None:
            _log.info("autopilot: %s", text.text)
            self.commands.on_text(text)
            if self.texts is not None:
                self.texts(text)

    def _clock_advanced(self) -> None:
        """Keep subscriptions at their rate also when a fast autopilot's bytes come in large pieces."""
        self._offered_ms = self.telemetry.clock_ms
        due = [s for s in self._subscriptions if s.rated and s.due(self._offered_ms)]
        if due:
            state = self.state
            for subscription in due:
                subscription.offer(state)

    def _state_changed(self) -> None:
        if self._subscriptions:
            state = self.state
            for subscription in list(self._subscriptions):
                subscription.offer(state)
        if self.commands.busy:
            self.commands.poll()

    # From the clients.

    def _client_opened(self, client: Client) -> None:
        self.router.add_link(client.link)
        self._outboxes[client.link] = client.outbox

    def _client_closed(self, client: Client) -> None:
        self.router.remove_link(client.link)
        del self._outboxes[client.link]
        self.streams.client_left(client.link)
        self._pump_streams(time.monotonic_ns())
        self._arm_timer()

    def _client_data(self, client: Client, data: bytes) -> None:
        now_ns = time.monotonic_ns()
        touched: set[Outbox] = set()
        for frame in client.framer.receive(data):
            for link in self.router.route(frame, client.link, now_ns).links:
                outbox = self._outboxes[link]
                raw: bytes | None = frame.raw
                if link == _AUTOPILOT_LINK:
                    raw = self.streams.client_frame(frame, client.link)
                if raw is not None:
                    outbox.put(raw)
                    touched.add(outbox)
        for outbox in touched:
            outbox.flush()
        self._pump_streams(now_ns)
        self._arm_timer()

    # Our own messages.

    def _send(self, messages: list[Any]) -> bool:
        outbox = self.link.outbox
        for message in messages:
            outbox.put(self._encoder.encode(message))
        outbox.flush()
        return self.link.up

    def _pump_streams(self, now_ns: int) -> None:
        request = self.streams.poll(now_ns)
        if request is not None:
            self._send([set_message_interval(self.config.sysid, *request)])

    def _send_heartbeat(self) -> None:
        # To the autopilot alone: a script that takes the first heartbeat it sees for the vehicle's would take ours.
        if self.link.up:
            self._send([onboard_computer_heartbeat()])

    # Time.

    def _arm_timer(self) -> None:
        """Have ``_on_timer`` run at the earliest deadline."""
        if self._link_task is None or self._link_task.cancelling() or self._link_task.done():
            return
        deadlines = (self._heartbeat_due_ns, self.streams.deadline_ns(), self.commands.deadline_ns())
        due_ns = min(deadline for deadline in deadlines if deadline is not None)
        if self._timer is not None:
            if self._timer_ns <= due_ns:
                return
            self._timer.cancel()
        delay_s = max(0.0, (due_ns - time.monotonic_ns()) / NS_PER_S)
        self._timer_ns = due_ns
        self._timer = asyncio.get_running_loop().call_later(delay_s, self._on_timer)

    def _on_timer(self) -> None:
        self._timer = None
        now_ns = time.monotonic_ns()
        if now_ns >= self._heartbeat_due_ns:
            self._heartbeat_due_ns = now_ns + HEARTBEAT_PERIOD_NS
            self._send_heartbeat()
            self.router.expire(now_ns)
        self._pump_streams(now_ns)
        if self.commands.busy:
            self.commands.poll()
        self._arm_timer()
