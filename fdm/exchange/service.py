"""What an exchange does with its UA: hears their packets, steps and answers them, emits ticks. It never waits."""

from __future__ import annotations

import logging
import socket
import time
from collections.abc import Callable, Sequence

from fdm.clock.events import EventKind, UaEvent
from fdm.clock.fleet_clock import FleetClock
from fdm.clock.member import Member
from fdm.clock.status import ClockStatus
from fdm.errors import ModelDivergedError
from fdm.exchange.called import CalledSeat
from fdm.exchange.command_queue import CommandQueue
from fdm.exchange.px4.callers import Newcomer
from fdm.exchange.px4.seat import Px4Seat
from fdm.exchange.seat import Seat as SocketSeat
from fdm.model.truth import TrueState
from fdm.wire.lockstep import STEPPING, ServoVerdict

DATAGRAM_MAX_BYTES = 128
"""Longer datagrams arrive cut to this length, which is the length of no servo packet either."""
DRAIN_MAX = 16
"""Datagrams without effect that are read from one socket before the others get their turn."""
BATCH = 8
"""UA that are stepped one after the other before they are answered: that keeps JSBSim in the processor's caches."""

Seat = SocketSeat | CalledSeat | Px4Seat
_PX4_TROUBLE = {
    EventKind.SILENT: "its PX4 has answered no frame for 4 s of sim time: it did not start, is of another version, or "
    "has a start script of its own",
    EventKind.REFUSED: "its PX4 is not in lockstep (built without it, or for hardware in the loop): its connection "
    "is served no more",
}
_TWO_AUTOPILOTS = (
    "two autopilots send to its port: the one that came last is flown, the one before is not answered"
)
_log = logging.getLogger(__name__)


class Service:
    """The UA of an exchange between their sockets and the fleet clock.

    Args:
        clock: the fleet's.
        commands: what other threads want; obeyed between any two steps.
        on_truth, on_tick, on_event: see fdm.exchange.exchange.Exchange.

    Attributes:
        seats: the UA, by the file descriptor of their socket; below 0 those that have none.
    """

    def __init__(
        self,
        clock: FleetClock,
        commands: CommandQueue,
        on_truth: Callable[[TrueState], object] | None,
        on_tick: Callable[[ClockStatus], object],
        on_event: Callable[[UaEvent], object] | None,
    ) -> None:
        self.seats: dict[int, Seat] = {}
        self._clock, self._commands = clock, commands
        self._on_truth, self._on_tick, self._on_event = on_truth, on_tick, on_event
        self._arrivals: list[Seat] = []
        self._blocked: list[Seat] = []
        self._seen_version = -1

    def take(self, seat: Seat, verdict: ServoVerdict | None) -> bool:
        """Take the verdict on what a live UA said that was not waiting.

        Returns:
            Whether it asked for a frame that could be flown and answered at once, and there is nothing else to do.
        """
        clock, aircraft, member = self._clock, seat.aircraft, seat.member
        if verdict is not ServoVerdict.ADVANCE:
            self._act(seat, verdict)
            return False
        clock.ask(member, aircraft.target_ns(), not aircraft.lockstep.unread)
        if not clock.may_step(member):
            self._blocked.append(seat)
            return False
        self._serve((seat,))
        return clock.limits_version == self._seen_version

    def start_without_the_absent(self) -> None:
        """Start if the start timeout has passed, and report who is absent; all that is there was heard before."""
        for member in self._clock.take_absent():
            self._tell(EventKind.ABSENT, member, "the fleet starts without it: its autopilot sent no packet")

    def let_go_the_stalled(self) -> None:
        """Go on without those that do not answer."""
        for member in self._clock.take_stalled():
            self._tell(EventKind.STALLED, member, "its autopilot does not answer")
            self.progress()

    def hear_called(self, seat: CalledSeat) -> None:
        """Take what a called autopilot answered, and fly on until its UA has to wait."""
        member, aircraft, packets = seat.member, seat.aircraft, seat.packets
        while packets:
            is_flying = member.live and not member.waiting
            verdict = aircraft.asked(packets.popleft(), seat, self._clock.wall_ns)
            if is_flying:
                self.take(seat, verdict)
            else:
                self._act(seat, verdict)

    def hear(self, seat: SocketSeat) -> None:
        """Read datagrams of one UA until one asks for a step, or there are none."""
        for _ in range(DRAIN_MAX):
            try:
                datagram, sender = seat.recvfrom(DATAGRAM_MAX_BYTES, socket.MSG_DONTWAIT)
            except BlockingIOError:
                return
            verdict = seat.aircraft.receive(datagram, sender, self._clock.wall_ns)
            self._act(seat, verdict)
            if verdict in STEPPING:
                return

    def welcome_px4(self, seat: Px4Seat, newcomer: Newcomer) -> None:
        """PX4 has connected: it boots."""
        hello = seat.welcome(newcomer)
        self._act(seat, seat.aircraft.asked(hello, seat.connection, self._clock.wall_ns))

    def hear_px4(self, seat: Px4Seat) -> None:
        """Take the frame that PX4 is done with, if it is."""
        fields = seat.take(self._clock.wall_ns)
        if fields is not None:
            self._act(seat, seat.aircraft.asked(fields, seat.connection, self._clock.wall_ns))

    def excuse_px4(self, seat: Px4Seat) -> None:
        """PX4 has not been sent its frame yet, as others fly on its core."""
        self._clock.excuse(seat.member)

    def tell_px4(self, seat: Px4Seat, kind: EventKind) -> None:
        """PX4 says nothing, or cannot be flown."""
        self._tell(kind, seat.member, _PX4_TROUBLE[kind])

    def _act(self, seat: Seat, verdict: ServoVerdict | None) -> None:
        """Do what the verdict on a datagram asks for, short of stepping."""
        if verdict is ServoVerdict.ADVANCE or verdict is ServoVerdict.GAP:
            if seat.member.live or self._return(seat):
                self._ask(seat)
        elif verdict is ServoVerdict.BOOT or verdict is ServoVerdict.RESTART:
            self._boot(seat, verdict)
        elif verdict is ServoVerdict.RESEND:
            seat.send(seat.aircraft.lockstep.reply)
        elif verdict is ServoVerdict.REPLACED:
            if seat.aircraft.counters()[verdict.value] == 1:
                self._tell(EventKind.REPLACED, seat.member, _TWO_AUTOPILOTS)
        elif (
            verdict is ServoVerdict.WAITING
            and not seat.member.ended
            and (seat.member.live or self._return(seat))
        ):
            self._ask(seat)  # again: it may be quiet only now

    def _ask(self, seat: Seat) -> None:
        if not seat.member.waiting:
            self._arrivals.append(seat)
        self._clock.ask(seat.member, seat.aircraft.target_ns(), not seat.aircraft.lockstep.unread)

    def _boot(self, seat: Seat, verdict: ServoVerdict) -> None:
        seat.aircraft.reset()
        seat.aircraft.set_fleet_time(self._clock.join(seat.member))
        self._forget(seat)
        if verdict is ServoVerdict.BOOT:
            self._tell(EventKind.JOINED, seat.member, "its autopilot sent its first packet")
        else:
            self._tell(EventKind.RESTARTED, seat.member, "its autopilot booted anew")
        self._ask(seat)

    def _return(self, seat: Seat) -> bool:
        """Take a stalled UA back; False if it is out for good."""
        if seat.member.ended:
            seat.aircraft.count("ignored_after_end")
            return False
        seat.aircraft.set_fleet_time(self._clock.join(seat.member))
        self._forget(seat)
        self._tell(EventKind.RETURNED, seat.member, "its autopilot answers again")
        return True

    def _forget(self, seat: Seat) -> None:
        for waiting in (self._arrivals, self._blocked):
            if seat in waiting:
                waiting.remove(seat)

    def progress(self) -> None:
        """Step whoever may, emit the ticks that are reached, until nothing moves."""
        clock = self._clock
        while True:
            if self._commands.waiting:
                self._commands.obey()
            if clock.limits_version != self._seen_version:
                if clock.due_tick_ns() is not None:
                    self._emit_due_ticks()
                self._seen_version = clock.limits_version
                if self._blocked:
                    self._arrivals, self._blocked = self._blocked + self._arrivals, []
            candidates = self._arrivals
            if not candidates:
                return
            self._arrivals = []
            granted: list[Seat] = []
            for seat in candidates:
                (granted if clock.may_step(seat.member) else self._blocked).append(seat)
            for begin in range(0, len(granted), BATCH):
                self._serve(granted[begin : begin + BATCH])

    def _serve(self, seats: Sequence[Seat]) -> None:
        """Step all, then answer all."""
        clock = self._clock
        for seat in seats:
            aircraft = seat.aircraft
            try:
                if aircraft.lead_due:
                    seat.send(aircraft.at_boot())
                    aircraft.lockstep.answered_beforehand(clock.wall_ns)
                aircraft.step()
            except ModelDivergedError as error:
                self._end(seat, error)
        for seat in seats:
            aircraft = seat.aircraft
            if not seat.member.waiting:
                continue  # it has just ended
            try:
                reply = aircraft.measure()
            except ModelDivergedError as error:
                self._end(seat, error)
                continue
            seat.send(reply)
            aircraft.lockstep.answered(aircraft.fields[2], reply, clock.wall_ns)
            clock.stepped(seat.member)
            if aircraft.early:
                aircraft.take_early()
                self._ask(seat)

    def _end(self, seat: Seat, error: ModelDivergedError) -> None:
        self._clock.end(seat.member)
        self._forget(seat)
        self._tell(EventKind.DIVERGED, seat.member, str(error))

    def _emit_due_ticks(self) -> None:
        clock = self._clock
        while (tick_ns := clock.due_tick_ns()) is not None:
            if self._on_truth is not None:
                by_member = {seat.member: seat.aircraft for seat in self.seats.values()}
                for member in clock.live_members():
                    self._on_truth(by_member[member].truth())
            status = clock.status(tick_ns, self._restarts())
            clock.tick_emitted()
            self._on_tick(status)
            # However long that took: what is answered next is answered now, not before it.
            clock.update_deaf(time.monotonic_ns())
            self._commands.obey()

    def _restarts(self) -> dict[int, int]:
        name = ServoVerdict.RESTART.value
        return {seat.aircraft.ua_id: seat.aircraft.counters().get(name, 0) for seat in self.seats.values()}

    def _tell(self, kind: EventKind, member: Member, detail: str) -> None:
        seat = next(seat for seat in self.seats.values() if seat.member is member)
        last = seat.last_frame()
        event = UaEvent(kind, member.ua_id, member.sim_time_ns, detail, last)
        _log.info("UA %d %s: %s", event.ua_id, kind.value, detail)
        if self._on_event is not None:
            self._on_event(event)
            self._clock.update_deaf(time.monotonic_ns())
