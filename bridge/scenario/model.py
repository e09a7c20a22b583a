"""What a scenario says: typed, checked once and frozen. `bridge.scenario.file` reads it."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar, Literal, Self

import yaml
from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    JsonValue,
    ValidationInfo,
    field_validator,
)

from bridge.timeouts import STALL_S
from fdm.air.weather import WeatherConfig
from fdm.clock.status import SPEED_RANGE
from fdm.exchange.settings import Coupling, Placement, Workers
from fdm.model.sensor_noise import SensorNoise
from fdm.wire.legacy import legacy_ports

SCHEMA = 1
MAX = "max"
SPEED_MIN, SPEED_MAX = 0.1, SPEED_RANGE[1]

Latitude = Annotated[float, Field(ge=-90, le=90, allow_inf_nan=False)]
Longitude = Annotated[float, Field(ge=-180, le=180, allow_inf_nan=False)]
Finite = Annotated[float, Field(allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Port = Annotated[int, Field(strict=True, ge=0, le=65535)]
Parameters = dict[Annotated[str, Field(pattern=r"^[A-Z][A-Z0-9_]{0,15}$")], Finite]
"""Parameters of an autopilot; MAVLink gives their names 16 characters."""
Slug = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]*$")]


def _speed(value: object) -> object:
    if value == MAX:
        return value
    if isinstance(value, int | float) and not isinstance(value, bool) and SPEED_MIN <= value <= SPEED_MAX:
        return value
    raise ValueError(f"has to be {MAX!r} or a real-time factor from {SPEED_MIN} to {SPEED_MAX:g}")


def _workers(value: object) -> object:
    if value == "auto" or (isinstance(value, int) and not isinstance(value, bool) and value >= 1):
        return value
    raise ValueError("has to be 'auto' or a number of processes, at least 1")


def _hosts(value: object) -> object:
    if value in ("auto", "per-ua") or (isinstance(value, int) and not isinstance(value, bool) and value >= 1):
        return value
    raise ValueError("has to be 'auto', 'per-ua' or a number of processes, at least 1")


def _radio(value: object) -> object:
    if isinstance(value, str | dict):
        return value
    raise ValueError(
        "has to be the name of a radio preset, or a mapping with 'preset' and what differs from it"
    )


class _Part(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class Origin(_Part):
    """Where the fleet's north-east-down frame has its zero."""

    lat_deg: Latitude
    lon_deg: Longitude
    alt_amsl_m: Finite


class HomePlace(_Part):
    """Home of a UA relative to the fleet's origin."""

    north_m: Finite = 0.0
    east_m: Finite = 0.0
    heading_deg: Finite = 0.0


class HoldAgent(_Part):
    """Takes off and holds over home until the others are done."""

    has_task: ClassVar[bool] = False
    type: Literal["hold"]
    altitude_m: Positive


class OutAndBackAgent(_Part):
    """Takes off, flies straight out, turns and flies back."""

    has_task: ClassVar[bool] = True
    type: Literal["out_and_back"]
    altitude_m: Positive
    distance_m: Positive
    bearing_deg: Finite = 0.0
    speed_mps: Positive = 10.0


class StillAgent(_Part):
    """Stays on the ground and transmits: for links without flight, and for tests."""

    has_task: ClassVar[bool] = False
    type: Literal["still"]


class OwnAgent(_Part):
    """An agent of the user's own: a subclass of `bridge.agents.Agent`, in a file or an installed module."""

    model_config = ConfigDict(
        extra="forbid", frozen=True, populate_by_name=True, ser_json_inf_nan="constants"
    )

    type: Literal["own"]
    class_: Annotated[str, Field(alias="class", pattern=r"^.+:[A-Za-z_]\w*$")]
    has_task: bool = True
    options: dict[str, JsonValue] = {}

    @property
    def place(self) -> str:
        """The file (ending in .py) or module that the class is in."""
        return self.class_.rpartition(":")[0]

    @property
    def class_name(self) -> str:
        """The name of the class there."""
        return self.class_.rpartition(":")[2]


AgentConfig = Annotated[HoldAgent | OutAndBackAgent | StillAgent | OwnAgent, Field(discriminator="type")]
"""``has_task``: the agent has an end of its own, which the run waits for."""


class FlightDynamics(_Part):
    """How the flight dynamics are served.

    Attributes:
        workers: processes that the UA are spread over; auto = as many as pay.
        coupling: autopilot and physics compute in turns (serial), or at the same time, with servo outputs that take
            effect one frame later (parallel).
        scheme: what the autopilots speak: ArduPilot's json, or the legacy scheme of external ones.
        legacy_rate_hz: frames per second of sim time in the legacy scheme, which does not tell.
        sensor_noise: errors of the sensors beyond those of the autopilot's simulation.
        placement: whether autopilots and physics share a core at full speed; auto = measured at start.
        stall_timeout_s: wall time after which a UA whose autopilot owes a packet is let go.
    """

    workers: Annotated[Workers, BeforeValidator(_workers)] = "auto"
    coupling: Coupling = "serial"
    scheme: Literal["json", "legacy"] = "json"
    legacy_rate_hz: Annotated[int, Field(strict=True, ge=10, le=65535)] = 400
    sensor_noise: SensorNoise = SensorNoise()
    stall_timeout_s: Positive = STALL_S
    placement: Placement = "auto"


class Aircraft(_Part):
    """One UA."""

    id: Annotated[int, Field(strict=True, ge=0, le=249)]
    airframe: str = "f450"
    home: HomePlace = HomePlace()
    sensor_noise: SensorNoise | None = None
    parameters: Parameters = {}
    agent: AgentConfig

    @property
    def node(self) -> str:
        """Its node id."""
        return str(self.id)

    @property
    def sysid(self) -> int:
        """Its MAVLink system id."""
        return self.id + 1


class Transmit(_Part):
    """What every agent gives to the radio."""

    channel: Slug = "team"
    every_ticks: Annotated[int, Field(strict=True, ge=1)] = 1
    frequency_mhz: Annotated[int, Field(strict=True, ge=1, le=65535)] = 2412


class Ports(_Part):
    """First port of each kind; UA I uses ``first + 10 * (I + first_slot)``. 0 for zenoh: any free port."""

    fdm: Port = 9002
    autopilot: Port = 5760
    aps: Port = 6760
    api: Port = 8760
    zenoh: Port = 7447
    first_slot: Annotated[int, Field(strict=True, ge=0, le=4000)] = 0


class Scenario(_Part):
    """A whole run."""

    schema_version: Literal[1] = Field(alias="schema")
    name: Slug
    description: str = ""
    seed: Annotated[int, Field(strict=True, ge=0, lt=2**63)] = 1
    autopilot: Literal["standin", "ardupilot", "external"] = "standin"
    speed: Annotated[float | str, BeforeValidator(_speed)] = 1.0
    duration_s: Positive
    tick_rate_hz: Annotated[int, Field(strict=True, ge=1, le=100)] = 20
    mavlink_rate_hz: Annotated[int | None, Field(strict=True, ge=1, le=1000)] = None
    hosts: Annotated[int | str, BeforeValidator(_hosts)] = "auto"
    api: bool = False
    origin: Origin
    radio: Annotated[str | dict[str, Any], BeforeValidator(_radio)]
    wind: str = "calm"
    weather: WeatherConfig = WeatherConfig()
    transmit: Transmit = Transmit()
    parameters: Parameters = {}
    ports: Ports = Ports()
    fdm: FlightDynamics = FlightDynamics()
    ua: Annotated[tuple[Aircraft, ...], Field(min_length=1)]

    model_config = ConfigDict(extra="forbid", frozen=True, populate_by_name=True)

    @field_validator("tick_rate_hz")
    @classmethod
    def _whole_nanoseconds(cls, rate_hz: int) -> int:
        if 1_000_000_000 % rate_hz:
            raise ValueError(
                "must divide a second into whole nanoseconds (1, 2, 4, 5, 8, 10, 16, 20, 25, ...)"
            )
        return rate_hz

    @field_validator("mavlink_rate_hz")
    @classmethod
    def _multiple_of_the_ticks(cls, rate_hz: int | None, info: ValidationInfo) -> int | None:
        tick_rate_hz = info.data.get("tick_rate_hz")
        if rate_hz is None or tick_rate_hz is None:
            return rate_hz
        if rate_hz % tick_rate_hz or 1_000_000_000 % rate_hz:
            raise ValueError(
                f"must be a multiple of tick_rate_hz ({tick_rate_hz}) that divides a second into whole nanoseconds"
            )
        return rate_hz

    @field_validator("fdm")
    @classmethod
    def _scheme_is_spoken(cls, fdm: FlightDynamics, info: ValidationInfo) -> FlightDynamics:
        if fdm.scheme == "legacy" and info.data.get("autopilot", "external") != "external":
            raise ValueError("scheme legacy is for autopilot: external; the others speak json only")
        if fdm.scheme == "legacy" and fdm.coupling == "parallel":
            raise ValueError("coupling parallel needs scheme json: a legacy peer is served serially")
        return fdm

    @field_validator("ua")
    @classmethod
    def _ids_differ(cls, aircraft: tuple[Aircraft, ...]) -> tuple[Aircraft, ...]:
        ids = [ua.id for ua in aircraft]
        twice = sorted({i for i in ids if ids.count(i) > 1})
        if twice:
            raise ValueError(f"id {twice[0]} is used more than once")
        return aircraft

    @property
    def tick_period_ns(self) -> int:
        """Sim time between two ticks."""
        return 1_000_000_000 // self.tick_rate_hz

    @property
    def exchange_period_ns(self) -> int:
        """Sim time between two exchanges of MAVLink with the autopilots."""
        return 1_000_000_000 // (self.mavlink_rate_hz or self.tick_rate_hz)

    @property
    def nodes(self) -> tuple[str, ...]:
        """All node ids."""
        return tuple(ua.node for ua in self.ua)

    @property
    def nodes_with_a_task(self) -> frozenset[str]:
        """Nodes whose agents have an end of their own, which the run waits for."""
        return frozenset(ua.node for ua in self.ua if ua.agent.has_task)

    @property
    def speed_factor(self) -> float:
        """Target real-time factor; ``inf`` for max."""
        return float("inf") if self.speed == MAX else float(self.speed)

    def aircraft(self, node: str) -> Aircraft:
        """The UA with this node id."""
        return next(ua for ua in self.ua if ua.node == node)

    def fdm_port(self, ua: Aircraft) -> int:
        """UDP port of the flight dynamics exchange of ``ua``."""
        if self.fdm.scheme == "legacy":
            return legacy_ports(self.instance(ua))[1]
        return self._port(self.ports.fdm, ua)

    def autopilot_port(self, ua: Aircraft) -> int:
        """TCP port of the autopilot of ``ua``."""
        return self._port(self.ports.autopilot, ua)

    def api_port(self, ua: Aircraft) -> int:
        """TCP port of the HTTP API of ``ua``, if the scenario asks for one."""
        return self._port(self.ports.api, ua)

    def aps_port(self, ua: Aircraft) -> int:
        """TCP port of the MAVLink server of ``ua``."""
        return self._port(self.ports.aps, ua)

    def instance(self, ua: Aircraft) -> int:
        """ArduPilot's instance number: what its ports are counted by."""
        return ua.id + self.ports.first_slot

    def _port(self, first: int, ua: Aircraft) -> int:
        return first + 10 * self.instance(ua)

    def to_yaml(self) -> str:
        """The scenario as resolved."""
        return yaml.safe_dump(self.model_dump(mode="json", by_alias=True), sort_keys=False)

    @classmethod
    def from_yaml(cls, text: str) -> Self:
        """Read back what `to_yaml` wrote. What it names is not looked for: that is `bridge.scenario.file`'s part.

        Raises:
            ValueError: a key or value is wrong.
        """
        return cls.model_validate(yaml.safe_load(text))
