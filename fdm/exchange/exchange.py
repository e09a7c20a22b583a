"""The exchange: UDP sockets and a loop around the sans-IO parts. Hosts any number of UA in one process.

One thread runs `Exchange.run`; the other methods may be called from any thread, `stop` also from a signal
handler.
"""

from __future__ import annotations

import socket
import time
from collections.abc import Callable, Sequence
from math import inf

from fdm.clock.events import UaEvent
from fdm.clock.fleet_clock import FleetClock, Peers
from fdm.clock.status import ClockSettings, ClockStatus, check_speed, nanoseconds
from fdm.exchange.aircraft_spec import AircraftSpec, LegacyPeer, default_port
from fdm.exchange.called import CalledAutopilot, CalledSeat
from fdm.exchange.command_queue import CommandQueue
from fdm.exchange.eager_reader import reader_of
from fdm.exchange.hosted_aircraft import BuildModel
from fdm.exchange.placement.placement import Placer
from fdm.exchange.poller import Poller
from fdm.exchange.ports import bind
from fdm.exchange.px4.seat import Px4Seat
from fdm.exchange.px4.welcome import Px4Seats
from fdm.exchange.seat import Seat
from fdm.exchange.service import DATAGRAM_MAX_BYTES, Service
from fdm.exchange.settings import Coupling, Placement, check_coupling, check_placement
from fdm.model.jsbsim_model import JsbsimModel
from fdm.model.truth import TrueState

__all__ = ["AircraftSpec", "Exchange", "LegacyPeer", "default_port"]

WAIT = 0
"""Flag of a read that waits, up to the socket's time-out."""


class Exchange:
    """Serves autopilots in lockstep over UDP, as their external physics.

    Args:
        aircraft: the UA to host, at least one.
        host: address to bind to.
        coupling: serial = the physics flies a frame while the autopilot waits for it. parallel = it sends the state at
            boot beforehand and is from then on one frame ahead, so that both compute at the same time: servo outputs
            take effect one frame later. (In co-simulation these are couplings of Gauss-Seidel and Jacobi type; Gomes
            et al., "Co-simulation: a survey", ACM Computing Surveys 51(3), 2018.) Legacy peers are served serially.
        placement: at full speed, shared = keep the loop's thread and the autopilots of this machine on one core, where
            waking each other costs least; spread = leave that to the system; auto = for a lone UA in serial coupling
            try both alternately in the first seconds, and keep the faster one. Only Linux can, with cores to choose
            from.
        speed: sim time per wall time; inf = as fast as possible.
        window_ns: how far a UA may run ahead of the slowest; None = one frame at the slowest rate, with PX4s a tick.
        stall_timeout_s: wall time after which a UA that does not answer is let go.
        tick_period_ns: sim time between ticks.
        hold_ticks: wait for `release_tick` at every tick.
        start_together: fly nobody before every UA has sent its first packet.
        start_timeout_s: wall time from the beginning of `run` after which those that have come start without the
            others.
        on_truth: called with the truth of every live UA at every tick, in the loop's thread.
        on_tick: called after that with the clock's status.
        on_event: called when a UA joins, restarts, stalls, returns or diverges.
        build_model: makes a flight model from airframe and home.
        sockets: the UA's sockets, if they are bound already, in the order of `aircraft`; the exchange's from now on.
        peers: the rest of the fleet, in other processes (see fdm.workers.fleet_exchange).
        called: the UA's autopilots, in the order of `aircraft`, if they are called and not reached over UDP. Then each
            UA flies from tick to tick in one go.

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
        coupling: Coupling = "serial",
        placement: Placement = "auto",
        speed: float = 1.0,
        window_ns: int | None = None,
        stall_timeout_s: float = 1.0,
        tick_period_ns: int = 50_000_000,
        hold_ticks: bool = False,
        start_together: bool = True,
        start_timeout_s: float = 60.0,
        on_truth: Callable[[TrueState], object] | None = None,
        on_tick: Callable[[ClockStatus], object] | None = None,
        on_event: Callable[[UaEvent], object] | None = None,
        build_model: BuildModel = JsbsimModel,
        sockets: Sequence[socket.socket] | None = None,
        peers: Peers | None = None,
        called: Sequence[CalledAutopilot] = (),
    ) -> None:
        settings = ClockSettings(
            speed=speed,
            window_ns=tick_period_ns
            if called or (window_ns is None and any(spec.px4 for spec in aircraft))
            else window_ns,
            tick_period_ns=tick_period_ns,
            hold_ticks=hold_ticks,
            stall_timeout_ns=nanoseconds("stall_timeout_s", stall_timeout_s),
            start_together=start_together,
            start_timeout_ns=nanoseconds("start_timeout_s", start_timeout_s),
        )
        check_coupling(coupling)
        check_placement(placement)
        self._coupling, self._peers, self._tick_period_ns = coupling, peers, tick_period_ns
        self._clock = FleetClock(_ids_of(aircraft), settings, time.monotonic_ns(), peers)
        self._commands = CommandQueue()
        self._on_tick = on_tick
        self._placer = Placer(placement, alone=peers is None)
        self._service = Service(self._clock, self._commands, on_truth, self._at_tick, on_event)
        self._seats = self._service.seats
        self._called: list[CalledSeat] = []
        self._lone: Seat | None = None
        self._stopping = False
        self._poller = Poller()
        self._listeners: dict[int, Callable[[], object]] = {}
        self._px4 = Px4Seats(self._service, self.listen, self._forget)
        self.listen(self._commands.fileno(), self._commands.drain)
        try:
            for index, spec in enumerate(aircraft):
                if called:
                    self._add_called(spec, called[index], build_model)
                else:
                    self._add(spec, sockets[index] if sockets else bind(spec, host), build_model)
        except BaseException:
            self.close()
            raise
        self._choose_lone(speed)

    def _choose_lone(self, speed: float) -> None:
        seats = list(self._seats.values())
        if len(seats) == 1 and isinstance(seats[0], Seat):
            self._lone = seats[0]
            self._choose_reader(self._lone, speed)

    @property
    def ports(self) -> dict[int, int]:
        """UDP port of each UA, by its id."""
        return {seat.aircraft.ua_id: seat.port for seat in self._seats.values()}

    def counters(self, ua_id: int) -> dict[str, int]:
        """What UA `ua_id` received and did so far, by reason (fdm.wire.lockstep.ServoVerdict, fdm.exchange.seat)."""
        for seat in self._seats.values():
            if seat.aircraft.ua_id == ua_id:
                return seat.counters()
        raise KeyError(f"no UA {ua_id}")

    # The loop

    def run(self) -> None:
        """Serve until `stop` is called. Errors of the callbacks end it and come out of it."""
        turn = self.turn
        self.begin()
        try:
            while not self._stopping:
                turn()
        finally:
            self._placer.give_back()

    def turn(self) -> None:
        """Once round the loop: wait until something is there to do, and do it. What `run` repeats."""
        lone = self._lone
        if self._called:
            self._call()
        elif lone is None or lone.member.waiting or not lone.member.live:
            self._wait()
        elif self._wait_and_fly(lone):
            return
        self._service.progress()
        self._px4.go_on()
        self._service.let_go_the_stalled()

    def fly_called(self) -> None:
        """Fly the called UA as far as they may, and do what was commanded; never wait. In place of `run`."""
        self._commands.drain()
        self._service.progress()
        while any(seat.packets for seat in self._called):
            self._call(waits=False)
            self._service.progress()

    def begin(self) -> None:
        """Time-outs and pace count from here; `run` does it itself."""
        self._clock.begin(time.monotonic_ns())

    def _call(self, *, waits: bool = True) -> None:
        """Fly the called UA as far as they may; wait where none may."""
        if waits and not any(seat.packets for seat in self._called):
            self._wait()
        self._clock.update(time.monotonic_ns())
        for seat in self._called:
            self._service.hear_called(seat)

    def _at_tick(self, status: ClockStatus) -> None:
        if not self._called:
            seats = [seat for seat in self._seats.values() if isinstance(seat, Seat)]
            others = sum(seat.member.live for seat in self._seats.values()) - sum(
                s.member.live for s in seats
            )
            speed, wall_ns = self._clock.pace.speed, time.monotonic_ns()
            self._placer.at_tick(seats, speed, status.sim_time_ns, wall_ns, others)
        if self._on_tick is not None:
            self._on_tick(status)

    def _choose_reader(self, lone: Seat, speed: float) -> None:
        self._receive = reader_of(
            lone.recvfrom, due_any_moment=lone.aircraft.parallel and speed == inf and self._peers is None
        )

    def _wait_and_fly(self, seat: Seat) -> bool:
        """Wait for one datagram in the socket of a lone UA, which spares the poller.

        Returns:
            Whether it asked for a frame that could be flown and answered at once, and there is nothing else to do.
        """
        clock = self._clock
        try:
            datagram, sender = self._receive(DATAGRAM_MAX_BYTES, WAIT)
        except BlockingIOError:
            self._wait()
            return False
        clock.update(time.monotonic_ns())
        if self._commands.waiting:
            self._commands.obey()
        verdict = seat.aircraft.receive(datagram, sender, self._clock.wall_ns)
        return self._service.take(seat, verdict)

    def _wait(self) -> None:
        """Wait for packets, wakes or the clock, and hear what has come."""
        clock = self._clock
        # One look at the clock serves the wait too: a turn is short against the poller's millisecond.
        wait_ns = self._px4.wake_at_ns(clock.wall_ns, clock.wake_at_ns()) - clock.wall_ns
        ready = self._poller.wait(wait_ns, eager=self._px4.are_due and clock.pace.speed == inf)
        clock.update(time.monotonic_ns())
        seats = self._seats
        for fd, _ in ready:
            seat = seats.get(fd)
            if isinstance(seat, Seat):
                self._service.hear(seat)
            else:
                callback = self._listeners.get(fd)
                if callback is not None:  # else one before it in `ready` has forgotten it
                    callback()
        self._px4.look()
        self._service.start_without_the_absent()

    def stop(self) -> None:
        """Let `run` return soon."""
        self._stopping = True
        self._commands.wake()

    def close(self) -> None:
        """Close all sockets. Not while `run` runs. What other threads command from now on has no effect."""
        self._stopping = True
        self._placer.give_back()
        self._px4.close()
        for seat in self._seats.values():
            seat.close()
        self._poller.close()
        self._commands.close()

    def listen(self, fd: int, callback: Callable[[], object]) -> None:
        """Have the loop call `callback` when the file descriptor `fd` can be read. Not while `run` runs."""
        self._listeners[fd] = callback
        self._poller.register(fd)

    # Control, from any thread

    def release_tick(self, sim_time_ns: int) -> None:
        """With hold_ticks: UA may go on beyond the ticks up to `sim_time_ns`."""
        self._commands.put(lambda: self._clock.release(sim_time_ns))

    def pass_ticks(self, sim_time_ns: int) -> None:
        """With peers: all processes have reached the ticks up to `sim_time_ns`, and they were emitted."""
        self._commands.put(lambda: self._clock.pass_ticks(sim_time_ns))

    def set_speed(self, speed: float) -> None:
        """Aim at `speed` of sim time per wall time (inf = as fast as possible).

        Raises:
            ValueError: out of its range (fdm.clock.status.SPEED_RANGE).
        """
        check_speed(speed)

        def command() -> None:
            self._clock.set_speed(speed)
            if self._lone is not None:
                self._choose_reader(self._lone, speed)

        self._commands.put(command)

    def pause(self) -> None:
        """Hold sim time."""
        self._commands.put(self._clock.pause)

    def resume(self) -> None:
        """End a pause."""
        self._commands.put(self._clock.resume)

    def step(self, sim_ns: int) -> None:
        """While paused: let sim time go on by `sim_ns` ns.

        Raises:
            ValueError: not above 0.
        """
        if sim_ns <= 0:
            raise ValueError(f"step of {sim_ns} ns: must be above 0")
        self._commands.put(lambda: self._clock.step(sim_ns))

    # Inner workings

    def _forget(self, fd: int) -> None:
        """Wait for `fd` no longer."""
        del self._listeners[fd]
        self._poller.unregister(fd)

    def _add(self, spec: AircraftSpec, sock: socket.socket, build_model: BuildModel) -> None:
        if spec.px4 is not None:
            self._add_px4(spec, sock, build_model)
            return
        try:
            seat = Seat(spec, sock, self._clock.members[spec.ua_id], build_model, self._coupling)
        except BaseException:
            sock.close()
            raise
        self._seats[sock.fileno()] = seat
        self._poller.register(sock.fileno())

    def _add_px4(self, spec: AircraftSpec, sock: socket.socket, build_model: BuildModel) -> None:
        try:
            seat = Px4Seat(
                spec,
                sock,
                self._clock.members[spec.ua_id],
                build_model,
                self._tick_period_ns,
                self._px4.cores,
            )
        except BaseException:
            sock.close()
            raise
        self._seats[sock.fileno()] = seat
        self._px4.add(seat)

    def _add_called(self, spec: AircraftSpec, autopilot: CalledAutopilot, build_model: BuildModel) -> None:
        member = self._clock.members[spec.ua_id]
        seat = CalledSeat(
            spec, autopilot, member, lambda: build_model(spec.airframe, spec.home), self._coupling
        )
        self._called.append(seat)
        self._seats[-len(self._called)] = seat


def _ids_of(aircraft: Sequence[AircraftSpec]) -> list[int]:
    """The UA's ids.

    Raises:
        ValueError: an id twice.
    """
    ids = [spec.ua_id for spec in aircraft]
    if len(set(ids)) != len(ids):
        raise ValueError(f"ua_id twice in {ids}")
    return ids
