"""The exchange: UDP sockets and a loop around the sans-IO parts. Hosts any number of UA in one process.

One thread runs `Exchange.run`; the other methods may be called from any thread, `stop` also from a signal
handler.
"""

from __future__ import annotations

import logging
import select
import socket
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from fdm.airframe import Airframe
from fdm.errors import ModelDivergedError, PortInUseError
from fdm.events import EventKind, UaEvent
from fdm.fleet_clock import ClockSettings, ClockStatus, FleetClock, Member, check_speed
from fdm.geodesy import Home
from fdm.hosted_aircraft import Disturb, FlightModel, HostedAircraft
from fdm.jsbsim_model import JsbsimModel
from fdm.legacy_scheme import make_legacy_encoder, make_legacy_unpacker
from fdm.lockstep import Verdict
from fdm.sensor_frame import decode_sensor_frame, make_encoder
from fdm.servo_packet import unpack_servo_packet
from fdm.truth import Truth
from fdm.wind import Wind

PORT_BASE = 9002
PORT_STRIDE = 10
DATAGRAM_MAX_BYTES = 128
"""Longer datagrams arrive cut to this length, which is the length of no servo packet either."""
DRAIN_MAX = 16
"""Datagrams without effect that are read from one socket before the others get their turn."""

_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class AircraftSpec:
    """One UA to host.

    Attributes:
        ua_id: its number, unique in the fleet.
        airframe: what it is.
        home: where it starts.
        port: UDP port on which its autopilot is served; 0 = any free one.
        wind: the air around it (fdm.wind.WindConfig.build); None = still.
        disturb: adds errors to its sensors (fdm.sensor_noise); None = only those of SITL itself.
        legacy: speak the legacy scheme; None = ArduPilot's JSON scheme.
    """

    ua_id: int
    airframe: Airframe
    home: Home
    port: int
    wind: Wind | None = None
    disturb: Disturb | None = None
    legacy: LegacyPeer | None = None


@dataclass(frozen=True, slots=True)
class LegacyPeer:
    """How a peer of the legacy scheme is served (fdm.legacy_scheme).

    Attributes:
        state_port: port on the sender's host to which the state goes.
        rate_hz: frames per second of sim time; each servo packet asks for one.
    """

    state_port: int
    rate_hz: int


class _Seat:
    """One UA with its socket."""

    __slots__ = ("aircraft", "member", "recvfrom", "reply_port", "sendto", "sock")

    def __init__(self, aircraft: HostedAircraft, sock: socket.socket, reply_port: int | None) -> None:
        self.reply_port = reply_port
        self.aircraft = aircraft
        self.member = aircraft.member
        self.sock = sock
        self.recvfrom = sock.recvfrom
        self.sendto = sock.sendto


class Exchange:
    """Serves autopilots in lockstep over UDP, as their external physics.

    Args:
        aircraft: the UA to host, at least one.
        host: address to bind to.
        speed: sim time per wall time; inf = as fast as possible.
        window_ns: how far a UA may run ahead of the slowest; None = one frame at the slowest rate.
        stall_timeout_s: wall time after which a UA that does not answer is let go.
        tick_period_ns: sim time between ticks.
        hold_ticks: wait for `release_tick` at every tick.
        start_together: answer nobody before every UA has sent its first packet.
        start_timeout_s: wall time after which those that have come start without the others.
        on_truth: called with the truth of every live UA at every tick, in the loop's thread.
        on_tick: called after that with the clock's status.
        on_event: called when a UA joins, restarts, stalls, returns or diverges.
        build_model: makes a flight model from airframe and home.

    Raises:
        PortInUseError: a port is taken.
        AirframeError: a model cannot be loaded.
        ValueError: no UA, an id twice, or a setting out of its range.
    """

    def __init__(
        self,
        aircraft: Sequence[AircraftSpec],
        *,
        host: str = "127.0.0.1",
        speed: float = 1.0,
        window_ns: int | None = None,
        stall_timeout_s: float = 1.0,
        tick_period_ns: int = 50_000_000,
        hold_ticks: bool = False,
        start_together: bool = True,
        start_timeout_s: float = 60.0,
        on_truth: Callable[[Truth], object] | None = None,
        on_tick: Callable[[ClockStatus], object] | None = None,
        on_event: Callable[[UaEvent], object] | None = None,
        build_model: Callable[[Airframe, Home], FlightModel] = JsbsimModel,
    ) -> None:
        settings = ClockSettings(
            speed=speed,
            window_ns=window_ns,
            tick_period_ns=tick_period_ns,
            hold_ticks=hold_ticks,
            stall_timeout_ns=int(stall_timeout_s * 1e9),
            start_together=start_together,
            start_timeout_ns=int(start_timeout_s * 1e9),
        )
        ids = [spec.ua_id for spec in aircraft]
        if len(set(ids)) != len(ids):
            raise ValueError(f"ua_id twice in {ids}")
        self._clock = FleetClock(ids, settings, time.monotonic_ns())
        self._on_truth, self._on_tick, self._on_event = on_truth, on_tick, on_event
        self._seats: dict[int, _Seat] = {}
        self._arrivals: list[_Seat] = []
        self._blocked: list[_Seat] = []
        self._seen_version = -1
        self._commands: deque[Callable[[], None]] = deque()
        self._stopping = False
        self._wake_receiver, self._wake_sender = socket.socketpair()
        self._wake_receiver.setblocking(False)
        self._wake_sender.setblocking(False)
        self._poller = _Poller()
        self._poller.register(self._wake_receiver.fileno())
        try:
            for spec in aircraft:
                self._add(spec, host, build_model)
        except BaseException:
            self.close()
            raise

    @property
    def ports(self) -> dict[int, int]:
        """UDP port of each UA, by its id."""
        return {seat.aircraft.ua_id: seat.sock.getsockname()[1] for seat in self._seats.values()}

    def counters(self, ua_id: int) -> dict[str, int]:
        """What UA `ua_id` received and did so far, by reason (see fdm.lockstep.Verdict and DROP_REASONS)."""
        for seat in self._seats.values():
            if seat.aircraft.ua_id == ua_id:
                return seat.aircraft.counters()
        raise KeyError(f"no UA {ua_id}")

    # The loop

    def run(self) -> None:
        """Serve until `stop` is called. Errors of the callbacks end it and come out of it."""
        turn = self.turn
        while not self._stopping:
            turn()

    def turn(self) -> None:
        """Once round the loop: wait until something is there to do, and do it. What `run` repeats."""
        clock = self._clock
        # One look at the clock serves the wait too: a turn is short against the poller's millisecond.
        ready = self._poller.wait(clock.wake_at_ns() - clock.wall_ns)
        wall_ns = time.monotonic_ns()
        clock.update(wall_ns)
        seats = self._seats
        for fd in ready:
            seat = seats.get(fd)
            if seat is None:
                self._drain_wakes()
            else:
                self._hear(seat, wall_ns)
        self._progress(wall_ns)
        for member in clock.take_stalled():
            self._tell(EventKind.STALLED, member, "its autopilot does not answer")
            self._progress(wall_ns)

    def stop(self) -> None:
        """Let `run` return soon."""
        self._stopping = True
        self._wake()

    def close(self) -> None:
        """Close all sockets. Not while `run` runs."""
        for seat in self._seats.values():
            seat.sock.close()
        self._poller.close()
        self._wake_receiver.close()
        self._wake_sender.close()

    # Control, from any thread

    def release_tick(self, sim_time_ns: int) -> None:
        """With hold_ticks: UA may go on beyond the ticks up to `sim_time_ns`."""
        self._command(lambda: self._clock.release(sim_time_ns))

    def set_speed(self, speed: float) -> None:
        """Aim at `speed` of sim time per wall time (inf = as fast as possible).

        Raises:
            ValueError: not above 0.
        """
        check_speed(speed)
        self._command(lambda: self._clock.set_speed(speed))

    def pause(self) -> None:
        """Hold sim time."""
        self._command(self._clock.pause)

    def resume(self) -> None:
        """End a pause."""
        self._command(self._clock.resume)

    def step(self, sim_ns: int) -> None:
        """While paused: let sim time go on by `sim_ns` ns.

        Raises:
            ValueError: not above 0.
        """
        if sim_ns <= 0:
            raise ValueError(f"step of {sim_ns} ns: must be above 0")
        self._command(lambda: self._clock.step(sim_ns))

    # Inner workings

    def _add(
        self, spec: AircraftSpec, host: str, build_model: Callable[[Airframe, Home], FlightModel]
    ) -> None:
        sock = _bind(spec, host)
        legacy = spec.legacy
        try:
            aircraft = HostedAircraft(
                self._clock.members[spec.ua_id],
                lambda: build_model(spec.airframe, spec.home),
                make_legacy_encoder(spec.home) if legacy else make_encoder(spec.airframe.sensors),
                spec.wind,
                spec.disturb,
                make_legacy_unpacker(legacy.rate_hz) if legacy else unpack_servo_packet,
            )
        except BaseException:
            sock.close()
            raise
        self._seats[sock.fileno()] = _Seat(aircraft, sock, legacy.state_port if legacy else None)
        self._poller.register(sock.fileno())

    def _command(self, command: Callable[[], None]) -> None:
        self._commands.append(command)
        self._wake()

    def _wake(self) -> None:
        try:
            self._wake_sender.send(b"\0")
        except BlockingIOError:
            return  # it is full of wakes already
        except OSError:
            if not self._stopping:
                raise

    def _drain_wakes(self) -> None:
        try:
            self._wake_receiver.recv(4096)
        except BlockingIOError:
            return

    def _hear(self, seat: _Seat, wall_ns: int) -> None:
        """Read datagrams of one UA until one asks for a step, or there are none."""
        aircraft = seat.aircraft
        for _ in range(DRAIN_MAX):
            try:
                datagram, sender = seat.recvfrom(DATAGRAM_MAX_BYTES)
            except BlockingIOError:
                return
            verdict = aircraft.receive(datagram, sender, wall_ns)
            if verdict is Verdict.ADVANCE or verdict is Verdict.GAP:
                if seat.member.live or self._return(seat):
                    self._ask(seat)
                return
            if verdict is Verdict.BOOT or verdict is Verdict.RESTART:
                self._boot(seat, verdict)
                return
            if verdict is Verdict.RESEND:
                self._send(seat, aircraft.lockstep.reply)

    def _ask(self, seat: _Seat) -> None:
        if not seat.member.waiting:
            self._arrivals.append(seat)
        self._clock.ask(seat.member, seat.aircraft.target_ns())

    def _boot(self, seat: _Seat, verdict: Verdict) -> None:
        seat.aircraft.reset()
        seat.aircraft.set_fleet_time(self._clock.join(seat.member))
        self._forget(seat)
        if verdict is Verdict.BOOT:
            self._tell(EventKind.JOINED, seat.member, "its autopilot sent its first packet")
        else:
            self._tell(EventKind.RESTARTED, seat.member, "its autopilot booted anew")
        self._ask(seat)

    def _return(self, seat: _Seat) -> bool:
        """Take a stalled UA back; False if it is out for good."""
        if seat.member.ended:
            seat.aircraft.count("ignored_after_end")
            return False
        seat.aircraft.set_fleet_time(self._clock.join(seat.member))
        self._forget(seat)
        self._tell(EventKind.RETURNED, seat.member, "its autopilot answers again")
        return True

    def _forget(self, seat: _Seat) -> None:
        for waiting in (self._arrivals, self._blocked):
            if seat in waiting:
                waiting.remove(seat)

    def _progress(self, wall_ns: int) -> None:
        """Step whoever may, emit the ticks that are reached, until nothing moves."""
        clock = self._clock
        while True:
            while self._commands:
                self._commands.popleft()()
            if clock.limits_version != self._seen_version:
                self._emit_due_ticks()
                self._seen_version = clock.limits_version
                if self._blocked:
                    self._arrivals, self._blocked = self._blocked + self._arrivals, []
            candidates = self._arrivals
            if not candidates:
                return
            self._arrivals = []
            for seat in candidates:
                if clock.may_step(seat.member):
                    self._serve(seat, wall_ns)
                else:
                    self._blocked.append(seat)

    def _serve(self, seat: _Seat, wall_ns: int) -> None:
        aircraft = seat.aircraft
        try:
            reply = aircraft.step()
        except ModelDivergedError as error:
            self._clock.end(seat.member)
            self._tell(EventKind.DIVERGED, seat.member, str(error))
            return
        self._send(seat, reply)
        aircraft.lockstep.answered(reply, wall_ns)
        self._clock.stepped(seat.member)

    def _send(self, seat: _Seat, reply: bytes) -> None:
        sender = seat.aircraft.lockstep.sender
        if seat.reply_port is not None:
            sender = (sender[0], seat.reply_port)
        try:
            seat.sendto(reply, sender)
        except OSError as error:  # the autopilot will ask again
            seat.aircraft.count("send_failed")
            _log.debug("UA %d: reply not sent: %s", seat.aircraft.ua_id, error)

    def _emit_due_ticks(self) -> None:
        clock = self._clock
        while (tick_ns := clock.due_tick_ns()) is not None:
            if self._on_truth is not None:
                by_member = {seat.member: seat.aircraft for seat in self._seats.values()}
                for member in clock.live_members():
                    self._on_truth(by_member[member].truth())
            status = clock.status(tick_ns, self._restarts())
            clock.tick_emitted()
            if self._on_tick is not None:
                self._on_tick(status)
            while self._commands:
                self._commands.popleft()()

    def _restarts(self) -> dict[int, int]:
        name = Verdict.RESTART.value
        return {seat.aircraft.ua_id: seat.aircraft.counters().get(name, 0) for seat in self._seats.values()}

    def _tell(self, kind: EventKind, member: Member, detail: str) -> None:
        seat = next(seat for seat in self._seats.values() if seat.member is member)
        last = decode_sensor_frame(seat.aircraft.lockstep.reply)
        event = UaEvent(kind, member.ua_id, member.sim_time_ns, detail, last)
        _log.info("UA %d %s: %s", event.ua_id, kind.value, detail)
        if self._on_event is not None:
            self._on_event(event)


def default_port(index: int) -> int:
    """UDP port of UA `index` in ArduPilot's JSON scheme."""
    return PORT_BASE + PORT_STRIDE * index


def _bind(spec: AircraftSpec, host: str) -> socket.socket:
    sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        sock.setblocking(False)
        sock.bind((host, spec.port))
    except OSError as error:
        sock.close()
        raise PortInUseError(
            f"UDP port {spec.port} on {host} (flight dynamics of UA {spec.ua_id}) cannot be used: "
            f"{error.strerror}",
            spec.port,
        ) from None
    return sock


class _Poller:
    """The cheapest wait for readable sockets that the system has; one millisecond is its grain."""

    def __init__(self) -> None:
        self._epoll = select.epoll() if hasattr(select, "epoll") else None
        self._poll = None if self._epoll else select.poll()

    def register(self, fd: int) -> None:
        if self._epoll is not None:
            self._epoll.register(fd, select.EPOLLIN)
        elif self._poll is not None:
            self._poll.register(fd, select.POLLIN)

    def wait(self, timeout_ns: int) -> list[int]:
        """File descriptors that can be read, after at most `timeout_ns` (rounded up to a millisecond)."""
        timeout_ms = 0 if timeout_ns <= 0 else -(-timeout_ns // 1_000_000)
        if self._epoll is not None:
            return [fd for fd, _ in self._epoll.poll(timeout_ms / 1000)]
        assert self._poll is not None
        return [fd for fd, _ in self._poll.poll(timeout_ms)]

    def close(self) -> None:
        if self._epoll is not None:
            self._epoll.close()
