"""The nodes of a scenario: whatever has an id on the air, by kind.

Roles are apart from kinds. A *station* is in the medium: it has a position and an antenna; all nodes are. A
*transceiver* is a station that exchanges packets: all but emitters. A *sender* numbers packets: the node's agent, or
for a ``free`` one a program beside the run. A *regulated* node is one that the clock waits for: each with an aircraft,
or with an agent of ours. An *observer* only reads, and is no node.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Annotated, Any, Final, Literal, Self

from pydantic import AfterValidator, BeforeValidator, Field, WithJsonSchema, field_validator, model_validator

from bridge.scenario.agents import AgentConfig, FreeAgent, GroundAgentConfig
from bridge.scenario.modems import GroundModem, UaModem
from bridge.scenario.parts import Finite, Metres, Parameters, Part, RadioSetting, Slug
from bridge.scenario.sensor import RfSensor
from channel.link.emitters.emission import Emission
from fdm.model.sensor_noise import SensorNoise
from sitl_configs.settings import id_as_text, refused

AutopilotName = Literal["standin", "ardupilot", "px4", "external"]
"""Who flies a UA."""
Word = Annotated[Slug, BeforeValidator(id_as_text), WithJsonSchema({"type": ["string", "integer"]})]
"""An id that may be written as a number, too."""
GROUND_HEIGHT_M = 2.0
MAIN = "main"
"""The radio network that all nodes are on (`bridge.bus.keys.MAIN`)."""
SIM_TIME_MAX_S = 1e9


class HomePlace(Part):
    """Home of a UA relative to the fleet's origin."""

    north_m: Metres = 0.0
    east_m: Metres = 0.0
    heading_deg: Finite = 0.0


class Span(Part):
    """From an instant of sim time on, until another one; without that, to the end of the run."""

    from_s: Annotated[float, Field(ge=0.0, le=SIM_TIME_MAX_S)]
    to_s: Annotated[float | None, Field(gt=0.0, le=SIM_TIME_MAX_S)] = None

    @model_validator(mode="after")
    def _ends_later(self) -> Self:
        if self.to_s is not None and self.to_s <= self.from_s:
            raise refused(f"has to be above from_s, {self.from_s:g} (got {self.to_s:g})", "to_s")
        return self

    @property
    def from_ns(self) -> int:
        """When it begins, ns of sim time."""
        return round(self.from_s * 1e9)

    @property
    def to_ns(self) -> int | None:
        """When it is over, ns of sim time; None: not during the run."""
        return None if self.to_s is None else round(self.to_s * 1e9)


class RadioOutage(Span):
    """The radio is off from an instant of sim time on, until another one; without that, to the end of the run."""


def _in_order(outages: tuple[RadioOutage, ...]) -> tuple[RadioOutage, ...]:
    """See that outages follow each other."""
    for index, (before, after) in enumerate(pairwise(outages), start=1):
        if before.to_s is None or after.from_s < before.to_s:
            text = f"has to be at or after to_s of the outage before it (got {after.from_s:g})"
            raise refused(text, index, "from_s")
    return outages


def _with_main(networks: tuple[str, ...] | None) -> tuple[str, ...] | None:
    """See that the network that all nodes are on is among those of a node."""
    if networks is not None and MAIN not in networks:
        raise ValueError(f"all nodes are on {MAIN}: name it, too")
    return networks


NetworkNames = Annotated[tuple[Slug, ...] | None, AfterValidator(_with_main)]
"""The radio networks that a node is on; None: all."""
GroupNames = tuple[Slug, ...]
"""The groups of addressees that a node is in."""
RadioOutages = Annotated[tuple[RadioOutage, ...], AfterValidator(_in_order)]


def _no_word(value: object) -> object:
    if isinstance(value, str):
        raise ValueError("has to be a whole number; a word is the id of a node with kind: ground or emitter")
    return value


class Aircraft(Part):
    """One UA: a station whose aircraft is regulated; its agent sends, and is regulated unless it is ``free``."""

    kind: Literal["ua"] = "ua"
    id: Annotated[int, Field(strict=True, ge=0, le=249), BeforeValidator(_no_word)]
    autopilot: AutopilotName | None = None
    airframe: str = "f450"
    home: HomePlace = HomePlace()
    sensor_noise: SensorNoise | None = None
    parameters: Parameters = Field(default_factory=dict)
    radio: RadioSetting | None = None
    networks: NetworkNames = None
    groups: GroupNames = ()
    radio_off: RadioOutages = ()
    sensor: RfSensor | None = None
    modems: dict[Slug, UaModem] = Field(default_factory=dict)
    agent: AgentConfig

    @field_validator("modems")
    @classmethod
    def _ports_differ(cls, modems: dict[str, UaModem]) -> dict[str, UaModem]:
        ports = [modem.serial for modem in modems.values()]
        if len(set(ports)) < len(ports):
            raise ValueError("two modems are at one serial port: give each another, 1 or 2")
        return modems

    @property
    def node(self) -> str:
        """Its node id."""
        return str(self.id)

    @property
    def is_regulated(self) -> bool:
        """Whether the clock waits for this node."""
        return True

    @property
    def has_agent(self) -> bool:
        """Whether an agent of ours runs on it."""
        return not isinstance(self.agent, FreeAgent)

    @property
    def sysid(self) -> int:
        """Its MAVLink system id."""
        return self.id + 1


class GroundPlace(Part):
    """Where a ground node's antenna stands, relative to the fleet's origin."""

    north_m: Metres = 0.0
    east_m: Metres = 0.0
    height_m: Metres = GROUND_HEIGHT_M

    @property
    def position_ned_m(self) -> tuple[float, float, float]:
        """In the fleet's frame."""
        return self.north_m, self.east_m, -self.height_m


class TrackPoint(GroundPlace):
    """Where a ground node is at an instant of sim time."""

    sim_time_s: Annotated[float, Field(ge=0.0, le=SIM_TIME_MAX_S, allow_inf_nan=False)]


class GroundNode(Part):
    """A station without an aircraft: it stands at ``place`` (the origin if there is none), or moves along ``track``."""

    kind: Literal["ground"]
    id: Word
    place: GroundPlace | None = None
    track: tuple[TrackPoint, ...] = ()
    radio: RadioSetting | None = None
    networks: NetworkNames = None
    groups: GroupNames = ()
    radio_off: RadioOutages = ()
    sensor: RfSensor | None = None
    modems: dict[Slug, GroundModem] = Field(default_factory=dict)
    agent: GroundAgentConfig

    @model_validator(mode="after")
    def _moves_forward(self) -> GroundNode:
        _check_track(self.place, self.track)
        return self

    @property
    def node(self) -> str:
        """Its node id."""
        return self.id

    @property
    def is_regulated(self) -> bool:
        """Whether the clock waits for this node."""
        return self.has_agent

    @property
    def has_agent(self) -> bool:
        """Whether an agent of ours runs on it."""
        return not isinstance(self.agent, FreeAgent)


class EmitterNode(Emission):
    """A station that radiates and exchanges no packets; it stands or moves as a ground node does, and has no agent."""

    kind: Literal["emitter"]
    id: Word
    place: GroundPlace | None = None
    track: tuple[TrackPoint, ...] = ()
    antenna: dict[str, Any] = Field(default_factory=lambda: {"model": "isotropic"})

    @model_validator(mode="after")
    def _moves_forward(self) -> EmitterNode:
        _check_track(self.place, self.track)
        return self

    @property
    def node(self) -> str:
        """Its node id."""
        return self.id


def _check_track(place: GroundPlace | None, track: tuple[TrackPoint, ...]) -> None:
    if track and place is not None:
        raise ValueError("place and track: give one of them")
    for index, (before, after) in enumerate(pairwise(track), start=1):
        if after.sim_time_s <= before.sim_time_s:
            text = (
                f"has to be above that of the point before, {before.sim_time_s:g} (got {after.sim_time_s:g})"
            )
            raise refused(text, "track", index, "sim_time_s")


def _kind(value: Any) -> Any:
    """A node without a kind is a UA."""
    return {"kind": "ua", **value} if isinstance(value, dict) else value


KEYS: Final = {
    "ua": frozenset(Aircraft.model_fields),
    "ground": frozenset(GroundNode.model_fields),
    "emitter": frozenset(EmitterNode.model_fields),
}
"""What a node can have, by kind."""
Transceiver = Aircraft | GroundNode
"""A node that exchanges packets."""
NodeConfig = Annotated[
    Aircraft | GroundNode | EmitterNode, Field(discriminator="kind"), BeforeValidator(_kind)
]
