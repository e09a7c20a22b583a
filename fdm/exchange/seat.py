"""One UA of an exchange with its UDP socket."""

from __future__ import annotations

import logging
import socket
import struct
import sys

from fdm.clock.member import Member
from fdm.exchange.aircraft_spec import AircraftSpec
from fdm.exchange.hosted_aircraft import BuildModel, ExchangedAircraft
from fdm.exchange.settings import Coupling
from fdm.wire.legacy import make_legacy_encoder, make_legacy_unpacker
from fdm.wire.sensor_frame import SensorFrame, decode_sensor_frame, make_encoder
from fdm.wire.servo_packet import unpack_servo_packet

DROPPED_BY_SYSTEM = "dropped_by_system"
"""Counter of the datagrams that the system dropped because the socket's buffer was full."""
_SO_MEMINFO = 55
_MEMINFO = struct.Struct("9I")
_MEMINFO_DROPS = 8

_log = logging.getLogger(__name__)


class Seat:
    """One UA with its socket.

    Args:
        spec: the UA.
        sock: its socket, of `fdm.exchange.ports.bind`; the seat's from now on.
        member: its place in the fleet clock.
        build_model: makes its flight model.
        coupling: of the exchange; a legacy peer is served serially.

    Raises:
        AirframeError: the model cannot be loaded.
    """

    __slots__ = ("_state_port", "aircraft", "member", "recvfrom", "sendto", "sock")

    def __init__(
        self,
        spec: AircraftSpec,
        sock: socket.socket,
        member: Member,
        build_model: BuildModel,
        coupling: Coupling,
    ) -> None:
        legacy = spec.legacy
        self.sock = sock
        self.recvfrom = sock.recvfrom
        self.sendto = sock.sendto
        self.member = member
        self._state_port = legacy.state_port if legacy else None
        self.aircraft = ExchangedAircraft(
            member,
            lambda: build_model(spec.airframe, spec.home),
            make_legacy_encoder(spec.home) if legacy else make_encoder(spec.airframe.sensors),
            spec.wind,
            spec.disturb,
            make_legacy_unpacker(legacy.rate_hz) if legacy else unpack_servo_packet,
            parallel=coupling == "parallel" and legacy is None,
        )

    def send(self, reply: bytes) -> None:
        """Send `reply` to where the latest packet came from."""
        address = self.aircraft.lockstep.sender
        if self._state_port is not None:
            address = (address[0], self._state_port)
        try:
            self.sendto(reply, socket.MSG_DONTWAIT, address)
        except OSError as error:  # the autopilot will ask again
            self.aircraft.count("send_failed")
            _log.debug("UA %d: reply not sent: %s", self.aircraft.ua_id, error)

    def last_frame(self) -> SensorFrame | None:
        """The last sensor frame that was sent."""
        return decode_sensor_frame(self.aircraft.lockstep.reply)

    @property
    def port(self) -> int:
        """Its UDP port."""
        return int(self.sock.getsockname()[1])

    def close(self) -> None:
        """Close the socket."""
        self.sock.close()

    def counters(self) -> dict[str, int]:
        """What the aircraft counted, and what the system dropped before."""
        counters = self.aircraft.counters()
        dropped = dropped_by_system(self.sock)
        return {**counters, DROPPED_BY_SYSTEM: dropped} if dropped else counters


def dropped_by_system(sock: socket.socket) -> int:
    """Datagrams that came to `sock` while its buffer was full; 0 where the system does not count them (not Linux)."""
    if sys.platform != "linux" or sock.fileno() < 0:
        return 0
    try:
        info = sock.getsockopt(socket.SOL_SOCKET, _SO_MEMINFO, _MEMINFO.size)
    except OSError:  # a kernel before 4.12
        return 0
    return int(_MEMINFO.unpack(info)[_MEMINFO_DROPS]) if len(info) == _MEMINFO.size else 0
