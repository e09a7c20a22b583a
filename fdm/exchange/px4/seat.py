"""One UA of an exchange whose autopilot is PX4: a port that listens, and the connection that PX4 made to it."""

from __future__ import annotations

import logging
import socket
import time
from collections.abc import Callable
from typing import Protocol

from fdm.clock.member import Member
from fdm.errors import AirframeError, PortInUseError
from fdm.exchange.aircraft_spec import AircraftSpec, Px4Peer
from fdm.exchange.hosted_aircraft import ExchangedAircraft, FlightModel
from fdm.exchange.px4.frames import FramesOfPx4
from fdm.exchange.px4.one_core import keep_on_one_core, runs_in_order
from fdm.exchange.px4.peer import process_at_end
from fdm.exchange.px4.quiet import Rest
from fdm.model.air_point import StaticAir
from fdm.model.airframe import Airframe
from fdm.model.geodesy import Home
from fdm.model.px4_sensors import Px4Encoder, Px4Sensors
from fdm.wire.servo_packet import Fields

LOOKS = 8
"""How often it is looked in a row whether PX4 is at rest, before others get their turn."""
WAKES, WAKE_AGE_NS = 10, 2_000_000
"""How often its MAVLink threads are woken anew before a frame, and how long ago at most that may be, in wall time: they
wake by themselves 10 ms later."""
LONGEST_NAP_NS = 20_000_000
"""Wall time after which a thread of PX4 that still naps waits for the next frame. While it boots some nap for 5 ms,
again and again, until another one is ready."""
READER = "sim_rcv"
"""PX4's thread that reads what we send."""
BY_WALL_TIME = "starts_by_wall_time"
"""Counter of the connections of a PX4 that we cannot see the threads of."""
ON_MANY_CORES = "starts_on_many_cores"
"""Counter of the connections of a PX4 that we cannot keep on one core."""
OUT_OF_ORDER = "starts_without_real_time_threads"
"""Counter of the connections of a PX4 that may not have real-time threads."""
WHY_NOT = {
    BY_WALL_TIME: "its PX4 runs on another machine, or as another user: when it is done with a frame cannot be seen",
    ON_MANY_CORES: "its PX4 could not be kept on one core: the order of its threads is the machine's",
    OUT_OF_ORDER: "its PX4 may not have real-time threads (root, CAP_SYS_NICE or `ulimit -r 99`): their order is the "
    "machine's",
}
"""Why a flight may not repeat, by counter."""
_READ_BYTES = 1 << 16

_log = logging.getLogger(__name__)


class FlightModelInAir(FlightModel, Protocol):
    """A flight model with what a barometer needs."""

    def air(self) -> StaticAir:
        """The air where it is."""


BuildModel = Callable[[Airframe, Home], FlightModelInAir]


class Px4Seat:
    """One UA with its port.

    Args:
        spec: the UA; its ``px4`` is set.
        sock: its port, of `listen`; the seat's from now on.
        member: its place in the fleet clock.
        build_model: makes its flight model.
        tick_period_ns: sim time between ticks, at which others speak to PX4.

    Attributes:
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
    ) -> None:
        if spec.airframe.px4 is None:
            raise AirframeError(f"airframe {spec.airframe.name}: it has no section px4: PX4 cannot fly it")
        peer = spec.px4 or Px4Peer(Px4Sensors(), seed=1)
        self.sock, self.member = sock, member
        self.connection: socket.socket | None = None
        self._rate_hz, self._motors = peer.sensors.imu_rate_hz, spec.airframe.px4.motors
        self._frames = FramesOfPx4(self._rate_hz, self._motors)
        self._rest: Rest | None = None
        self._wake_ports, self._has_woken = peer.wake_ports, False
        self._woken_ns = self._sent_ns = 0
        self._has_booted = False
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

        self.aircraft = ExchangedAircraft(member, build, self._encode, spec.wind, spec.disturb)

    @property
    def port(self) -> int:
        """Its TCP port."""
        return int(self.sock.getsockname()[1])

    def accept(self) -> Fields:
        """PX4 connects (anew): take its connection; returns the packet that asks for the first frame."""
        connection, address = self.sock.accept()
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        connection.setblocking(False)
        self.drop()
        self.connection, self._has_booted = connection, False
        pid = process_at_end(connection)
        self._frames = FramesOfPx4(self._rate_hz, self._motors, sees_rest=pid is not None)
        self._rest = None if pid is None else Rest(pid, READER)
        if pid is None:
            self.aircraft.count(BY_WALL_TIME)
        elif not keep_on_one_core(pid, self.aircraft.ua_id):
            self.aircraft.count(ON_MANY_CORES)
        elif not runs_in_order(pid):
            self.aircraft.count(OUT_OF_ORDER)
        _log.info("UA %d: PX4 has connected from %s (process %s)", self.aircraft.ua_id, address, pid)
        return self._frames.hello()

    def drop(self) -> None:
        """Close the connection, if there is one."""
        if self._rest is not None:
            self._rest.close()
            self._rest = None
        if self.connection is not None:
            self.connection.close()
            self.connection = None

    def send(self, reply: bytes) -> None:
        """Send the messages of a frame."""
        if self.connection is None:
            return
        if self._rest is not None:
            self._settle(self._rest)
            self._rest.sent()
        self._has_woken = False
        try:
            self.connection.send(reply)
        except OSError as error:
            self.aircraft.count("send_failed")
            _log.debug("UA %d: frame not sent: %s", self.aircraft.ua_id, error)
        self._sent_ns = time.monotonic_ns()
        self._frames.sent(self.aircraft.fields[2] + 1, self._sent_ns)

    def receive(self) -> bool:
        """Read what PX4 has sent; False: it has closed the connection, which `drop` is for."""
        while self.connection is not None:
            try:
                data = self.connection.recv(_READ_BYTES)
            except BlockingIOError:
                return True
            except OSError:
                data = b""
            if not data:
                return False
            self._frames.receive(data)
        return False

    def take(self, wall_ns: int) -> Fields | None:
        """The frame that is done now, as a packet that asks for the next one."""
        frames, rest = self._frames, self._rest
        if not self.wants_look():
            return None
        if rest is None:
            return frames.done() if frames.is_done(wall_ns) else None
        for _ in range(LOOKS):
            if rest.is_at_rest(0 if self._has_booted else LONGEST_NAP_NS):
                if self._wake_ports and not self._has_woken:
                    self._wake()
                    continue
                self.receive()  # it may have answered since the last look
                self._has_booted = self._has_booted or self._boot_is_over(rest)
                return frames.done()
        return None

    def _boot_is_over(self, rest: Rest) -> bool:
        """Whether it answers, its start script has ended, and so has the thread that ran the script's last command."""
        return self._frames.answered and not rest.naps and not rest.has_children()

    def _settle(self, rest: Rest) -> None:
        """Before a frame: have what it was told at a tick taken, and its MAVLink threads woken not long ago.

        Else they might wake by themselves in the midst of the frame.
        """
        tries = WAKES if self._wake_ports and self._woken_ns else 0
        was_held = self._begins_at_tick()
        while tries and (was_held or time.monotonic_ns() - self._woken_ns > WAKE_AGE_NS):
            tries -= 1
            was_held = False
            self._wake()
            for _ in range(LOOKS * LOOKS):
                if rest.is_at_rest():
                    break

    def _begins_at_tick(self) -> bool:
        """Whether it was held at a tick since the frame before, and may have been spoken to."""
        tick = self.member.sim_time_ns // self._tick_period_ns
        was_tick, self._tick = self._tick, tick
        return tick != was_tick

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
        return self.connection is not None and self._frames.awaits

    def close(self) -> None:
        """Close port and connection."""
        self.drop()
        self._waker.close()
        self.sock.close()

    def counters(self) -> dict[str, int]:
        """What the aircraft and its frames counted."""
        return {**self.aircraft.counters(), **self._frames.counters}


def listen(spec: AircraftSpec, host: str) -> socket.socket:
    """A TCP port at which PX4 finds its simulator.

    Raises:
        PortInUseError: the port cannot be had.
    """
    sock = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    try:
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        sock.bind((host, spec.port))
        sock.listen(1)
    except OSError as error:
        sock.close()
        raise PortInUseError(
            f"TCP port {spec.port} on {host} (flight dynamics of UA {spec.ua_id}) cannot be used: "
            f"{error.strerror}",
            spec.port,
        ) from None
    return sock
