"""Sections of a scenario: where the fleet is, how it is flown, what it transmits, its ports and its MAVLink."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BeforeValidator, Field

from bridge.scenario.parts import Finite, Latitude, Longitude, Part, Port, Positive, Slug
from bridge.timeouts import STALL_S
from fdm.exchange.settings import Coupling, Placement, Workers
from fdm.model.px4_sensors import Px4Sensors
from fdm.model.sensor_noise import SensorNoise

AUTO = "auto"
UpToOneSecond = Annotated[float, Field(ge=0.0, le=1.0, allow_inf_nan=False)]


def _workers(value: object) -> object:
    if value == "auto" or (isinstance(value, int) and not isinstance(value, bool) and value >= 1):
        return value
    raise ValueError("has to be 'auto' or a number of processes, at least 1")


def _udp_out(value: object) -> object:
    """See that each can be opened: a mistake is better found before the start."""
    if not isinstance(value, list | tuple):
        if value == AUTO:
            return value
        raise ValueError("has to be 'auto', or a list of HOST:PORT")
    from aps.links.address import parse_address  # pymavlink takes its time, and few scenarios name any

    for text in value:
        parse_address(f"udp-out:{text}")
    return tuple(value)


class Origin(Part):
    """Where the fleet's north-east-down frame has its zero."""

    lat_deg: Latitude
    lon_deg: Longitude
    alt_amsl_m: Finite


class FlightDynamics(Part):
    """How the flight dynamics are served.

    Attributes:
        workers: processes that the UA are spread over; auto = as many as pay.
        coupling: autopilot and physics compute in turns (serial), or at the same time, with servo outputs that take
            effect one frame later (parallel).
        scheme: what the autopilots speak: ArduPilot's json, or the legacy scheme of external ones.
        legacy_rate_hz: frames per second of sim time in the legacy scheme, which does not say.
        standin_rate_hz: frames per second of sim time that the stand-in asks for.
        sensor_noise: errors of the sensors beyond those of the autopilot's simulation.
        placement: whether autopilots and physics share a core at full speed; auto = measured at start.
        px4: rates and errors of the sensors of UA that PX4 flies.
        stall_timeout_s: wall time after which a UA whose autopilot owes a packet is let go.
    """

    workers: Annotated[Workers, BeforeValidator(_workers)] = "auto"
    coupling: Coupling = "serial"
    scheme: Literal["json", "legacy"] = "json"
    legacy_rate_hz: Annotated[int, Field(strict=True, ge=10, le=65535)] = 400
    standin_rate_hz: Annotated[int, Field(strict=True, ge=100, le=2000)] = 400
    sensor_noise: SensorNoise = SensorNoise()
    stall_timeout_s: Positive = STALL_S
    placement: Placement = "auto"
    px4: Px4Sensors = Px4Sensors()


class Transmit(Part):
    """What every agent gives to the radio, and when its packets enter it on a medium that takes time.

    Attributes:
        channel: of the data packages.
        every_ticks: how often they are sent.
        frequency_mhz: that they name.
        phase_s: between a tick and the instant at which a node acts; drawn: from 0 to a tick, for each node.
        processing_s: between an agent's word and its radio, at least.
        processing_spread_s: up to so much is added to it, drawn for each packet.
    """

    channel: Slug = "team"
    every_ticks: Annotated[int, Field(strict=True, ge=1)] = 1
    frequency_mhz: Annotated[int, Field(strict=True, ge=1, le=65535)] = 2412
    phase_s: Literal["drawn"] | UpToOneSecond = "drawn"
    processing_s: UpToOneSecond = 0.001
    processing_spread_s: UpToOneSecond = 0.001


class Ports(Part):
    """First port of each kind; UA I uses ``first + 10 * (I + first_slot)``. 0 for zenoh: any free port.

    ``gcs`` and ``mavsdk`` are sent to: all UA share the first; slot S = I + first_slot has ``mavsdk + S`` (from slot 10
    on ``mavsdk + 60 + S``, beyond the ground station's).
    """

    fdm: Port = 9002
    autopilot: Port = 5760
    aps: Port = 6760
    api: Port = 8760
    gcs: Port = 14550
    mavsdk: Port = 14540
    zenoh: Port = 7447
    first_slot: Annotated[int, Field(strict=True, ge=0, le=4000)] = 0


class MavlinkSettings(Part):
    """What the MAVLink daemons do unasked.

    Attributes:
        udp_out: where each sends a UA's MAVLink: HOST:PORT with rules (docs/reference/aps.md); auto = to ``ports.gcs``
            and ``ports.mavsdk`` on this machine in real time (``speed: 1``), nowhere otherwise.
        tlog: whether each records it as a .tlog file in the run's directory.
    """

    udp_out: Annotated[Literal["auto"] | tuple[str, ...], BeforeValidator(_udp_out)] = "auto"
    tlog: bool = True
