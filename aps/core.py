"""The daemon's logic: a hub, and at home there one vehicle. No I/O, no asyncio, no clock.

Links, frames and instants go in; what is to be sent is put into the queues in front of the links. Who reads the
links, writes the queues and says what time it is are the shells: ``aps.daemon`` by wall time,
``aps.held`` by sim time.
"""

from __future__ import annotations

import logging
import struct
from collections.abc import Callable, Sequence
from typing import Any, Final

from aps.config import NS_PER_S, DaemonConfig
from aps.hub.answers import ANSWERED, Answers
from aps.hub.hub import Hub
from aps.hub.routing import Router
from aps.links.link import Link, Role
from aps.timeouts import HEARTBEAT_PERIOD_S, SILENCE_TIMEOUT_S
from aps.vehicle.status_text import STATUSTEXT_ID
from aps.vehicle.vehicle import Vehicle
from aps.wire.dialect import AUTOPILOT_COMPID, ONBOARD_COMPUTER_COMPID
from aps.wire.framer import Frame

HEARTBEAT_PERIOD_NS: Final = round(HEARTBEAT_PERIOD_S * NS_PER_S)
APART_NS: Final = 5 * NS_PER_S
"""Clocks of one autopilot, told by two links, do not differ by more, unless a link is slow or a simulation fast ..."""
APART_TIMES: Final = 3
"""... which they do not so often in a row."""
_TIMESYNC: Final = 111
_TIMESYNC_FIELDS: Final = struct.Struct("<qq")
"""tc1, the answerer's time (0: this is a request), and ts1, the asker's."""

_log = logging.getLogger(__name__)


class Core:
    """One UA's daemon without its links.

    Args:
        config: its settings.
        clock: the shell's clock, ns, for what users start and ask between two events.
        wake: called when a command has queued messages or changed deadlines.
        silence_s: for how long, by that clock, the autopilot's may stand still under an accepted command.
        measures_latency: whether to ask the autopilot for TIMESYNC with each heartbeat. Not in held mode, where an
            answer comes with the next exchange by definition.

    Every event takes ``now_ns``, an instant of the same clock; instants never go back.
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
        self._measures_latency = measures_latency
        self.router = Router(
            config.sysid,
            ONBOARD_COMPUTER_COMPID,
            AUTOPILOT_COMPID,
            round(config.route_expiry_s * NS_PER_S),
        )
        self.hub = Hub(self.router, self)
        self.vehicle = Vehicle(
            config.sysid,
            config.stream_rates_hz,
            self.hub.send_to_autopilot,
            clock,
            wake,
            silence_s,
            config.autopilot,
            middle_stick=config.middle_stick,
        )
        self.answers = Answers(config.sysid, ONBOARD_COMPUTER_COMPID)
        self.answered = ANSWERED
        self._heartbeat_due_ns = 0
        self._changed = False
        self.vehicle.telemetry.link_down()  # until there is one
        self._clock_ms = 0
        self._reboots = 0
        self._latest_primary: Link | None = None
        self._apart = 0
        """How often in a row links have led to autopilots whose clocks are apart."""

    def statistics(self) -> dict[str, Any]:
        """Counters of the logic, as plain data."""
        return {**self.hub.statistics(), "answers": self.answers.counters, **self.vehicle.statistics()}

    def autopilot_statistics(self, now_ns: int) -> dict[str, Any]:
        """Counters of the link to the autopilot that is used, or was the last one, as plain data."""
        link = self._latest_primary
        if link is None:
            return {}
        return {**link.statistics(now_ns), "up": self.link_up and link.traffic.up(now_ns)}

    @property
    def link_up(self) -> bool:
        """Whether there is a link to the autopilot."""
        return self.router.primary is not None

    # Links.

    def link_opened(self, link: Link, now_ns: int) -> None:
        """A link is there."""
        primary = self.router.primary
        self.hub.add(link)
        if link.role is Role.AUTOPILOT:
            link.framer.reset()
            link.traffic.reopened()
            link.traffic.sender = self.config.sysid << 8 | AUTOPILOT_COMPID
            self._heartbeat_due_ns = now_ns  # introduce ourselves at once
        self._follow_primary(primary, now_ns)

    def link_closed(self, link_id: int, now_ns: int) -> None:
        """A link is gone, and its wishes with it (see ``on_time`` for what follows from that)."""
        primary = self.router.primary
        role = self.hub.links[link_id].role
        self.hub.remove(link_id)
        if role is Role.CLIENT:
            self.vehicle.client_left(link_id)
        self._follow_primary(primary, now_ns)

    def _follow_primary(self, before: int | None, now_ns: int) -> None:
        """The link to the autopilot may be another one now."""
        primary = self.router.primary
        if primary == before:
            return
        if before is not None:
            self.vehicle.link_down(another=primary is not None)
        if primary is not None:
            self._latest_primary = self.hub.primary
            self._heartbeat_due_ns = now_ns
            self.vehicle.link_up()

    def frames(self, link: Link, frames: Sequence[Frame], now_ns: int) -> None:
        """Frames from a link, in order (call ``on_time`` after the last ones of clients)."""
        self.hub.receive(frames, link, now_ns)
        if self._changed:
            self._changed = False
            self._follow_clock()
            self.vehicle.state_changed(now_ns)

    def _follow_clock(self) -> None:
        """Settle which frames are lost: those missing when the autopilot's clock goes on.

        After a reboot its numbers begin anew: then nothing is that was missing since its clock was last heard.
        """
        telemetry = self.vehicle.telemetry
        if telemetry.clock_ms == self._clock_ms and telemetry.reboots == self._reboots:
            return
        traffics = [link.traffic for link in self.hub.links.values() if link.role is Role.AUTOPILOT]
        for traffic in traffics:
            if telemetry.reboots == self._reboots:
                traffic.settle()
            else:
                traffic.restarted()
        self._clock_ms, self._reboots = telemetry.clock_ms, telemetry.reboots

    # What the hub has for us (aps.hub.hub.Local).

    def from_autopilot(self, frame: Frame, link: Link, now_ns: int) -> bool:
        """A frame came from an autopilot's link; returns whether it concerns others, too."""
        if frame.msg_id == _TIMESYNC and self._answers_our_timesync(frame, link, now_ns):
            return False
        if link is not self._latest_primary:
            return True
        if self.vehicle.receive(frame, now_ns):
            self._changed = True
        return frame.msg_id != STATUSTEXT_ID or not self.vehicle.answers_us(frame)

    def addressed(self, frame: Frame, link: Link, alone: bool) -> None:
        """A frame came that is for us, or for everybody."""
        if alone:
            answer = self.answers.reply(frame, link.id)
            if answer is not None:
                self.hub.send(answer, link)

    def to_autopilot(self, frame: Frame, link: Link) -> bytes | None:
        """A client's frame is about to go to the autopilot: the bytes to send in its place, or ``None``."""
        raw = self.vehicle.client_frame(frame, link.id)
        if raw is None and (denial := self.answers.denial(frame)) is not None:
            self.hub.send(denial, link)
        return raw

    # Time.

    def deadline_ns(self) -> int:
        """When ``on_time`` is due even if nothing happens."""
        due_ns = self.vehicle.deadline_ns()
        return self._heartbeat_due_ns if due_ns is None else min(self._heartbeat_due_ns, due_ns)

    def on_time(self, now_ns: int) -> None:
        """Do what is due: heartbeat, expiry of routes, stream requests, commands."""
        if now_ns >= self._heartbeat_due_ns:
            self._heartbeat_due_ns = now_ns + HEARTBEAT_PERIOD_NS
            self._choose_primary(now_ns)
            self._look_for_a_second()
            self._send_heartbeat(now_ns)
            self.router.expire(now_ns)
        self.vehicle.on_time(now_ns)

    def _send_heartbeat(self, now_ns: int) -> None:
        # To the autopilot alone: a script that takes the first heartbeat for the vehicle's would take ours.
        links = [link for link in self.hub.links.values() if link.role is Role.AUTOPILOT]
        heartbeat = self.vehicle.heartbeat() if links else b""
        for link in links:
            self.hub.send(heartbeat, link)
            if self._measures_latency and link.latency is not None:
                self.hub.send(self.vehicle.timesync(link.latency.ask(now_ns)), link)

    def _answers_our_timesync(self, frame: Frame, link: Link, now_ns: int) -> bool:
        """Take an answer to a request of ours: it names no target, and others would take it for one to theirs."""
        tc1, ts1 = _TIMESYNC_FIELDS.unpack(frame.payload.ljust(_TIMESYNC_FIELDS.size, b"\0")[:16])
        if tc1 == 0 or link.latency is None or not link.latency.answer(ts1, now_ns):
            return False
        if (frame.sysid, frame.compid) == (self.config.sysid, AUTOPILOT_COMPID):
            link.latency.told_ns = ts1, tc1
        return True

    def _look_for_a_second(self) -> None:
        """Two autopilots may have one system id: asked for their time at one instant, they tell different ones."""
        told = {
            link.name: link.latency.told_ns
            for link in self.hub.links.values()
            if link.latency is not None and link.latency.told_ns is not None
        }
        newest_ns = max((asked_ns for asked_ns, _ in told.values()), default=0)
        clocks_ns = {name: clock_ns for name, (asked_ns, clock_ns) in told.items() if asked_ns == newest_ns}
        is_apart = len(clocks_ns) > 1 and max(clocks_ns.values()) - min(clocks_ns.values()) > APART_NS
        self._apart = self._apart + 1 if is_apart else 0
        if self._apart == APART_TIMES:
            _log.warning(
                "more than one autopilot calls itself system %d, at %s: one of them alone is heard and commanded",
                self.config.sysid,
                " and ".join(clocks_ns),
            )

    def _choose_primary(self, now_ns: int) -> None:
        """Change over to another of the autopilot's links when there are no heartbeats on the primary one."""
        before = self.hub.primary
        if before is None or before.traffic.up(now_ns):
            return
        for link in self.hub.links.values():
            if link.role is Role.AUTOPILOT and link.traffic.up(now_ns):
                _log.warning("no heartbeat from the autopilot on %s: using %s", before.name, link.name)
                self.router.use(link.id)
                self._follow_primary(before.id, now_ns)
                return
