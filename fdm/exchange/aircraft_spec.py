"""What an exchange is asked to host: one record per UA."""

from __future__ import annotations

from dataclasses import dataclass

from fdm.exchange.hosted_aircraft import Disturb
from fdm.model.air_point import Wind
from fdm.model.airframe import Airframe
from fdm.model.geodesy import Home
from fdm.model.px4_sensors import EPOCH_UNIX_S, Px4Sensors

PORT_BASE = 9002
PORT_STRIDE = 10
PX4_PORT_BASE = 4560


@dataclass(frozen=True, slots=True)
class LegacyPeer:
    """How a peer of the legacy scheme is served (fdm.wire.legacy).

    Attributes:
        state_port: port on the sender's host to which the state goes.
        rate_hz: frames per second of sim time; each servo packet asks for one.
    """

    state_port: int
    rate_hz: int


@dataclass(frozen=True, slots=True)
class Px4Peer:
    """How a UA that PX4 flies is served (fdm.exchange.px4).

    Attributes:
        sensors: rates and errors of its sensors.
        seed: of their errors.
        epoch_unix_s: time of day at its boot.
        wake_ports: UDP ports of its MAVLink on this machine, which are woken in each frame (fdm.exchange.px4.seat).
    """

    sensors: Px4Sensors
    seed: int
    epoch_unix_s: int = EPOCH_UNIX_S
    wake_ports: tuple[int, ...] = ()


@dataclass(frozen=True, slots=True)
class AircraftSpec:
    """One UA to host.

    Attributes:
        ua_id: its number, unique in the fleet.
        airframe: what it is.
        home: where it starts.
        port: UDP port on which its autopilot is served (PX4: TCP); 0 = any free one.
        wind: the air around it (fdm.air.wind.WindConfig.build); None = still.
        disturb: adds errors to its sensors (fdm.model.sensor_noise); None = only those of SITL itself.
        legacy: speak the legacy scheme; None = ArduPilot's JSON scheme.
        px4: speak PX4's simulator interface.
    """

    ua_id: int
    airframe: Airframe
    home: Home
    port: int
    wind: Wind | None = None
    disturb: Disturb | None = None
    legacy: LegacyPeer | None = None
    px4: Px4Peer | None = None


def default_port(index: int) -> int:
    """UDP port of UA `index` in ArduPilot's JSON scheme."""
    return PORT_BASE + PORT_STRIDE * index


def px4_port(index: int) -> int:
    """TCP port at which PX4's instance `index` looks for its simulator."""
    return PX4_PORT_BASE + index
