"""One UA of an exchange whose autopilot is PX4: a port that listens, and the connection that PX4 made to it."""

from __future__ import annotations

import logging
import socket
import sys
import time
from collections import Counter
from typing import NamedTuple

from fdm.clock.member import Member
from fdm.errors import AirframeError
from fdm.exchange.aircraft_spec import AircraftSpec, Px4Peer
from fdm.exchange.hosted_aircraft import BuildModel, ExchangedAircraft, FlightModel
from fdm.exchange.px4.callers import Callers, Newcomer
from fdm.exchange.px4.frames import FramesOfPx4
from fdm.exchange.px4.idle_core import CoreShare, IdleCores
from fdm.exchange.px4.one_core import our_cores
from fdm.exchange.px4.peer import Peer
from fdm.exchange.px4.quiet import Rest
from fdm.exchange.px4.watched import BEFORE_REST, watch
from fdm.model.px4_sensors import Px4Encoder, Px4Sensors
from fdm.wire.sensor_frame import SensorFrame, decode_sensor_frame, make_encoder
from fdm.wire.servo_packet import Fields

LOOKS_NS = 300_000
"""Wall time for which it is looked whether PX4 is at rest, before others get their turn."""
ANSWERS_NS = 2_000_000
"""Wall time for which an answer of a PX4 that has booted is waited for, before it is looked whether none will come."""
SETTLES_NS = 500_000_000
"""Wall time for which it is looked before a frame whether PX4 is at rest again: it may have to wait for the disk. Then
the frame is sent all the same."""
WAKES, WAKE_AGE_NS = 10, 4_000_000
"""How often its MAVLink threads are woken anew before a frame, and how long ago at most that may be, in wall time: they
wake by themselves 10 ms later."""
NAPS = 2
"""How often a thread of PX4 that naps has to run to be taken for one that waits for the next frame: while it boots some
nap for 5 ms, again and again, until another is ready."""
NO_NAP = sys.maxsize
"""With the first frame its work queues come to sim time: until then they nap, for up to a second (wkr_hrt; hpwork and
lpwork 50 ms), and would be as late with what is due as their last nap is long."""
READ_BYTES, READS = 4096, 4
"""What is read at most before others get their turn: a frame's answer has a hundred bytes."""

_log = logging.getLogger(__name__)


class Outgoing(NamedTuple):
    """A frame that is sent when PX4 is at rest."""

    messages: bytes
    number: int


class Px4Seat:
    """One UA with its port.

    Args:
        spec: the UA; its ``px4`` is set.
        sock: its port, of `fdm.exchange.ports.bind`; the seat's from now on.
        member: its place in the fleet clock.
        build_model: makes its flight model.
        tick_period_ns: sim time between ticks, at which others speak to PX4.
        cores: where the PX4s of the exchange fly.

    Attributes:
        callers: who connects to its port.
        connection: that of PX4; None while there is none.

    Raises:
        AirframeError: the model cannot be loaded, or the airframe says nothing for PX4.
    """

    def __init__(
        self,
        spec: AircraftSpec,
        sock: socket.socket,
        member: Member,
        build_model: BuildModel,
        tick_period_ns: int,
        cores: IdleCores,
    ) -> None:
        if spec.airframe.px4 is None:
            raise AirframeError(f"airframe {spec.airframe.name}: it has no section px4: PX4 cannot fly it")
        peer = spec.px4 or Px4Peer(Px4Sensors(), seed=1)
        self.member = member
        self.connection: socket.socket | None = None
        self._retired: socket.socket | None = None
        self._rate_hz, self._motors = peer.sensors.imu_rate_hz, spec.airframe.px4.motors
        self._frames = FramesOfPx4(self._rate_hz, self._motors)
        self._past: Counter[str] = Counter()
        self._peer = Peer()
        self._rest: Rest | None = None
        self._idle_cores = cores
        self._core: CoreShare | None = None
        self._was_held = False
        self._wake_ports, self._has_woken = peer.wake_ports, False
        self._woken_ns = self._sent_ns = self._waits_since_ns = self._wakes_left = 0
        self._as_text = make_encoder(spec.airframe.sensors)
        self._has_begun, self._has_booted, self._is_silent, self._unsent = False, False, False, b""
        self._outgoing: Outgoing | None = None
        self._cores = our_cores()
        self._tick_period_ns, self._tick = tick_period_ns, -1
        self._waker = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._encode = Px4Encoder(
            peer.sensors,
            spec.home,
            seed=peer.seed,
            ua_id=spec.ua_id,
            has_airspeed=spec.airframe.vehicle == "plane",
            epoch_unix_s=peer.epoch_unix_s,
        )

        def build() -> FlightModel:
            self._encode.model = model = build_model(spec.airframe, spec.home)
            self._encode.reset()
            return model

        self._last: tuple[float, ...] = ()

        def encode(values: tuple[float, ...]) -> bytes:
            messages = self._encode(values)
            self._last = values
            return messages

        self.aircraft = ExchangedAircraft(member, build, encode, spec.wind, spec.disturb)
        self.callers = Callers(sock, self.aircraft)

    @property
    def port(self) -> int:
        """Its TCP port."""
        return int(self.callers.sock.getsockname()[1])

    def accept(self) -> Newcomer | None:
        """Who has connected, if that is who is to be served from now on; `welcome` is to follow. Never raises."""
        return self.callers.next(self._keeps_from)

    def _keeps_from(self, newcomer: Peer) -> bool:
        """Whether who is connected stays, and the newcomer has to go.

        A PX4 of this machine stays until it closes. Another one may have gone without a word: it stays while it is not
        let go. One that has not answered yet may be anything, and gives way to a PX4.
        """
        if not self.receive():
            return False
        if self._peer.is_px4:
            return True
        return self.member.live and (self._frames.has_answered or not newcomer.is_px4)

    def welcome(self, newcomer: Newcomer) -> Fields:
        """Serve who has connected; returns the packet that asks for the first frame. It boots."""
        self.drop()
        self.connection, self._peer = newcomer
        self._has_begun, self._has_booted, self._unsent = False, False, b""
        self._rest, why_not = watch(self._peer, self.aircraft.ua_id, self._cores)
        self._past += self._frames.totals()
        self._frames = FramesOfPx4(self._rate_hz, self._motors, sees_rest=self._rest is not None)
        if why_not:
            self.aircraft.count(why_not)
        _log.info("UA %d: PX4 has connected (process %s)", self.aircraft.ua_id, self._peer.pid)
        return self._frames.hello()

    def drop(self) -> None:
        """Close the connection, if there is one."""
        if self._rest is not None:
            self._rest.close()
        self._leave_core()
        self._rest = self._outgoing = None
        self._was_held = False
        for connection in (self.connection, self._retired):
            if connection is not None:
                connection.close()
        self.connection = self._retired = None

    def _leave_core(self) -> None:
        if self._core is not None:
            self._core.leave()
            self._core = None

    def retire(self) -> None:
        """Serve who is connected no more, and leave the connection open until another comes.

        A PX4 that finds it closed spins, as a real-time thread: nobody else's on that core would get to run.
        """
        connection, self.connection = self.connection, None
        self.drop()
        self._retired = connection

    def send(self, reply: bytes) -> None:
        """Send the messages of a frame, as soon as PX4 is at rest."""
        self._was_held, self._tick = self._is_at_tick(), self._tick_now()
        self._outgoing = Outgoing(reply, self.aircraft.fields[2] + 1)
        self._waits_since_ns, self._wakes_left = time.monotonic_ns(), WAKES
        self.go_on()

    def go_on(self) -> bool:
        """Send the frame that waits for PX4 to be at rest, if it is. False: it waits for others on its core."""
        outgoing = self._outgoing
        if outgoing is None or self.connection is None:
            return True
        if not self._may_fly():
            return False
        if not self._is_settled():
            return True
        self._outgoing, self._has_woken = None, False
        if self._rest is not None:
            self._rest.sent()
        self._write(self.connection, outgoing.messages)
        self._sent_ns = time.monotonic_ns()
        self._frames.sent(outgoing.number, self._sent_ns)
        return True

    def _may_fly(self) -> bool:
        """Whether it has its turn on its core; one that nobody waits for takes none."""
        core = self._core
        if core is None or not core.is_ready or not self.member.live or core.may_fly():
            return True
        self._waits_since_ns = time.monotonic_ns()
        return False

    def end_turn(self) -> None:
        """Let others on its core fly if it has nothing to do, or nobody waits for it."""
        if self._core is not None and not (self.wants_look() and self.member.live):
            self._core.end_turn()

    def _write(self, connection: socket.socket, reply: bytes) -> None:
        """Send a frame whole, or not at all; what the system does not take yet goes with the next one."""
        try:
            if self._unsent:
                self._unsent = self._unsent[connection.send(self._unsent) :]
            if self._unsent:
                self.aircraft.count("send_failed")
                return
            self._unsent = reply[connection.send(reply) :]
        except OSError as error:
            self.aircraft.count("send_failed")
            _log.debug("UA %d: frame not sent: %s", self.aircraft.ua_id, error)

    def receive(self, reads: int = READS) -> bool:
        """Read what PX4 has sent, or the beginning of it; False: it has closed the connection, which `drop` is for."""
        if self.connection is None:
            return False
        for _ in range(reads):
            try:
                data = self.connection.recv(READ_BYTES)
            except BlockingIOError:
                return True
            except OSError:
                return False
            if not data:
                return False
            self._frames.receive(data)
        return True

    def take(self, wall_ns: int) -> Fields | None:
        """The frame that is done now, as a packet that asks for the next one."""
        frames, rest = self._frames, self._rest
        if self.connection is None or not frames.awaits:
            return None
        if rest is None:
            return self._done() if frames.is_done(wall_ns) else None
        if self._core is not None and self._core.is_ready:
            if frames.answered:
                return self._take_answered(self._core)
            if wall_ns - self._sent_ns < ANSWERS_NS:
                return None
        naps = 0 if self._has_booted else NAPS if self._has_begun else NO_NAP
        within_ns = LOOKS_NS if self.member.live else 0
        if not _comes_to_rest(rest, within_ns, naps):
            return None
        if self._wake_ports and not self._has_woken:
            self._wake()
            if not _comes_to_rest(rest, within_ns, naps):
                return None
        self.receive()  # it may have answered since the last look
        if not self.is_lockstep:
            return None
        self._has_begun = True
        if not self._has_booted and self._boot_is_over(rest):
            self._has_booted = True
            self._core = self._idle_cores.share(rest.pid, self._wake_ports)
        return self._done()

    def _take_answered(self, core: CoreShare) -> Fields | None:
        """The frame that is answered: the model needs no more. At a tick, which others wait for, once PX4 rests."""
        if not self._has_woken:
            self._ask(core)
        if self._is_at_tick() and not core.is_at_rest():
            return None
        return self._done()

    def _ask(self, core: CoreShare) -> None:
        self._has_woken, self._woken_ns = True, time.monotonic_ns()
        core.ask()

    @property
    def is_lockstep(self) -> bool:
        """Whether PX4 can be flown in lockstep, as far as it has said."""
        return self._frames.is_lockstep

    def take_silence(self) -> bool:
        """Whether PX4 has fallen silent; once."""
        is_silent, self._is_silent = self._is_silent, False
        return is_silent

    def _done(self) -> Fields:
        fields = self._frames.done()
        self._is_silent = self._frames.falls_silent
        return fields

    def _boot_is_over(self, rest: Rest) -> bool:
        """Whether it answers, its start script has ended, and so has the thread that ran the script's last command."""
        return self._frames.answered and not rest.naps and not rest.has_children()

    def _is_settled(self) -> bool:
        """Before a frame: whether what it was told at a tick is taken, and its MAVLink threads were woken not long ago.

        Else they might wake by themselves in the midst of the frame.
        """
        rest, core = self._rest, self._core
        if rest is None:
            return True
        if core is None or not core.is_ready:
            if core is not None:
                self._look_instead(core, rest)
            self._settle(rest)
            return True
        while core.is_at_rest():
            if not self._wakes_left or not self._is_to_wake():
                return True
            self._wakes_left -= 1
            self._ask(core)
        if time.monotonic_ns() - self._waits_since_ns < SETTLES_NS:
            return False
        self.aircraft.count(BEFORE_REST)
        self._leave_core()  # what it will still say is of this frame
        return True

    def _look_instead(self, core: CoreShare, rest: Rest) -> None:
        """Its core cannot be asked yet, or no more: the frame before may have been taken before PX4 was at rest."""
        if not _comes_to_rest(rest, SETTLES_NS):
            self.aircraft.count(BEFORE_REST)
        if core.is_over:
            self._leave_core()

    def _settle(self, rest: Rest) -> None:
        while self._wakes_left and self._is_to_wake():
            self._wakes_left -= 1
            self._wake()
            if not _comes_to_rest(rest, SETTLES_NS):
                self.aircraft.count(BEFORE_REST)
                break

    def _is_to_wake(self) -> bool:
        """Whether it was told something that it may not have taken yet, or was woken too long ago."""
        was_held, self._was_held = self._was_held, False
        is_old = time.monotonic_ns() - self._woken_ns > WAKE_AGE_NS
        return bool(self._wake_ports and self._woken_ns) and (was_held or is_old)

    def _is_at_tick(self) -> bool:
        """Whether it has come to a tick since the frame before, and may be spoken to."""
        return self._tick_now() != self._tick

    def _tick_now(self) -> int:
        return self.member.sim_time_ns // self._tick_period_ns

    def _wake(self) -> None:
        """Have PX4's MAVLink threads look at the time: else they do every 10 ms of wall time, whichever frame that is.

        They read an empty datagram, and then do what is due, such as the next part of a list of parameters. It is sent
        when PX4 is at rest: then nobody else is about to run.
        """
        self._has_woken, self._woken_ns = True, time.monotonic_ns()
        for port in self._wake_ports:
            try:
                self._waker.sendto(b"", ("127.0.0.1", port))
            except OSError as error:
                _log.debug("UA %d: not woken at port %d: %s", self.aircraft.ua_id, port, error)

    def wants_look(self) -> bool:
        """Whether `take` is to be called soon though PX4 has sent nothing."""
        return self.connection is not None and (self._frames.awaits or self._outgoing is not None)

    def last_frame(self) -> SensorFrame | None:
        """What the last frame that was sent is made of, before the errors that this adapter adds."""
        return decode_sensor_frame(self._as_text(self._last)) if self._last else None

    def close(self) -> None:
        """Close port and connections."""
        self.drop()
        self._waker.close()
        self.callers.close()

    def counters(self) -> dict[str, int]:
        """What the aircraft and its frames counted."""
        return {**self.aircraft.counters(), **(self._past + self._frames.totals())}


def _comes_to_rest(rest: Rest, within_ns: int, naps: int = 0) -> bool:
    """Look whether a program is at rest, again and again for some wall time."""
    until_ns = time.monotonic_ns() + within_ns
    while not rest.is_at_rest(naps):
        if time.monotonic_ns() >= until_ns:
            return False
    return True
