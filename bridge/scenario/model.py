"""What a scenario says: typed, checked once and frozen. `bridge.scenario.file` reads it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, Any, Literal, Self

from pydantic import (
    BeforeValidator,
    ConfigDict,
    Field,
    ValidationInfo,
    WithJsonSchema,
    field_validator,
    model_validator,
)

from bridge.scenario.expectations import Expectation
from bridge.scenario.mcap import McapSettings
from bridge.scenario.modems import GroundModem, UaModem
from bridge.scenario.nodes import (
    MAIN,
    Aircraft,
    AutopilotName,
    EmitterNode,
    GroundNode,
    NodeConfig,
    Transceiver,
)
from bridge.scenario.partitions import PartitionSetting
from bridge.scenario.parts import (
    RESERVED_ID,
    Parameters,
    Part,
    RadioSetting,
    Slug,
    WindSetting,
)
from bridge.scenario.sections import AUTO, FlightDynamics, MavlinkSettings, Origin, Ports, Transmit
from fdm.air.weather import WeatherConfig
from fdm.clock.status import SPEED_RANGE
from fdm.exchange.aircraft_spec import px4_port
from fdm.wire.legacy import legacy_ports
from sitl_configs.settings import refused
from sitl_configs.yaml_text import read_yaml, yaml_of

MAX = "max"
OF_ALL = "the address of packets for every node"
START_TIME_UNIX_S = 1_700_000_000
"""GPS time of autopilots at boot, and time of the records at sim time 0: the host's time would not repeat."""
MAVSDK_SLOTS, MAVSDK_STEP = 10, 60
"""So many UA have the ports that PX4 gives MAVSDK; those of the others lie higher by this."""
PX4_OUTPUTS = "PWM_MAIN_FUNC"
"""With a number, PX4's parameters that say what an output is."""
DURATION_MAX_S = 4e6
"""MAVLink counts milliseconds since boot in 32 bits, which are full after 49.7 days."""
SPEED_MIN, SPEED_MAX = 0.1, SPEED_RANGE[1]
A_SPEED: dict[str, Any] = {
    "anyOf": [{"enum": [MAX]}, {"type": "number", "minimum": SPEED_MIN, "maximum": SPEED_MAX}]
}
HOSTS: dict[str, Any] = {"anyOf": [{"enum": ["auto", "per-ua"]}, {"type": "integer", "minimum": 1}]}


def _speed(value: object) -> object:
    if value == MAX:
        return value
    if isinstance(value, int | float) and not isinstance(value, bool) and SPEED_MIN <= value <= SPEED_MAX:
        return value
    raise ValueError(f"has to be {MAX!r} or a real-time factor from {SPEED_MIN} to {SPEED_MAX:g}")


def _hosts(value: object) -> object:
    if value in ("auto", "per-ua") or (isinstance(value, int) and not isinstance(value, bool) and value >= 1):
        return value
    raise ValueError("has to be 'auto', 'per-ua' or a number of processes, at least 1")


class Scenario(Part):
    """A whole run.

    Attributes:
        schema_version: of the file's format.
        name: part of the run directory's name, so that it is bounded.
        description: for people.
        seed: of all random draws: channel, wind, sensor noise, agents, random places.
        autopilot: who flies: the stand-in that ships, real ArduPilot or PX4, or one that you start; UA may differ.
        speed: real-time factor, or max.
        duration_s: longest sim time; the run ends earlier when all tasks are done. MAVLink counts milliseconds since
            boot in 32 bits, which are full after 49.7 days: hence the bound.
        take_off_at_s: sim time before which agents do not take off, so that what else has a time meets the same part of
            the flight whoever flies.
        tick_rate_hz: ticks per second of sim time: radio and agents.
        lookahead_ticks: 1: autopilots fly on to the next tick while agents and radio work on this one; what is
            commanded takes effect a tick later.
        mavlink_rate_hz: how often MAVLink is exchanged with autopilots; as the ticks unless given.
        processes: whether all parts are called in one process or joined by Zenoh in many; no result depends on it.
        zenoh: whether a run of one process has Zenoh beside it; auto = at a speed other than max, and for `free` nodes.
        hosts: of many processes, those for daemons and agents.
        api: whether each UA's HTTP API is served.
        figure: whether the probability of delivery is drawn at the end.
        origin: zero of the fleet's north-east-down frame.
        radio: of the network `main`: a preset, a file, or a mapping with `preset` and what differs.
        networks: further radio networks, each with the radio of its nodes, by the name that their radios have.
        partitions: groups of nodes that do not hear each other for a while, on any network.
        wind: a wind that ships, a file, or a mapping.
        weather: temperature and pressure.
        transmit: what agents give to the radio.
        parameters: of real autopilots, for all UA.
        ports: first port of each kind.
        mavlink: what the MAVLink daemons do unasked.
        fdm: how flight dynamics are served.
        nodes: what is on the air.
        expectations: what the run has to show; it ends with status 3 if it does not.
    """

    schema_version: Literal[1] = Field(alias="schema")
    name: Slug
    description: str = ""
    seed: Annotated[int, Field(strict=True, ge=0, lt=2**63)] = 1
    autopilot: AutopilotName = "standin"
    speed: Annotated[float | str, BeforeValidator(_speed), WithJsonSchema(A_SPEED)] = 1.0
    duration_s: Annotated[float, Field(gt=0.0, le=DURATION_MAX_S, allow_inf_nan=False)]
    take_off_at_s: Annotated[float, Field(ge=0.0, allow_inf_nan=False)] = 0.0
    tick_rate_hz: Annotated[int, Field(strict=True, ge=1, le=100)] = 20
    lookahead_ticks: Literal[0, 1] = 0
    mavlink_rate_hz: Annotated[int | None, Field(strict=True, ge=1, le=1000)] = None
    processes: Literal["auto", "one", "many"] = "auto"
    zenoh: Literal["auto"] | bool = "auto"
    hosts: Annotated[int | str, BeforeValidator(_hosts), WithJsonSchema(HOSTS)] = "auto"
    api: bool = False
    figure: bool = True
    origin: Origin
    radio: RadioSetting
    networks: dict[Slug, RadioSetting] = Field(default_factory=dict)
    partitions: tuple[PartitionSetting, ...] = ()
    wind: WindSetting = "calm"
    weather: WeatherConfig = WeatherConfig()
    transmit: Transmit = Transmit()
    parameters: Parameters = Field(default_factory=dict)
    ports: Ports = Ports()
    mavlink: MavlinkSettings = MavlinkSettings()
    fdm: FlightDynamics = FlightDynamics()
    mcap: McapSettings = McapSettings()
    nodes: Annotated[tuple[NodeConfig, ...], Field(min_length=1)]
    expectations: tuple[Expectation, ...] = ()

    model_config = ConfigDict(extra="forbid", frozen=True, populate_by_name=True)

    @field_validator("take_off_at_s")
    @classmethod
    def _during_the_run(cls, at_s: float, info: ValidationInfo) -> float:
        duration_s = info.data.get("duration_s")
        if duration_s is not None and at_s >= duration_s:
            raise ValueError(f"has to be below duration_s, {duration_s:g}")
        return at_s

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
            raise refused("legacy is for autopilot: external; the others speak json only", "scheme")
        if fdm.scheme == "legacy" and fdm.coupling == "parallel":
            raise refused("parallel needs scheme json: a legacy peer is served serially", "coupling")
        return fdm

    @field_validator("nodes")
    @classmethod
    def _ids_differ(cls, nodes: tuple[NodeConfig, ...]) -> tuple[NodeConfig, ...]:
        ids = [node.node for node in nodes]
        twice = sorted({i for i in ids if ids.count(i) > 1})
        if twice:
            raise ValueError(f"id {twice[0]} is used more than once")
        if RESERVED_ID in ids:
            raise refused(f"{RESERVED_ID} is {OF_ALL}: choose another", ids.index(RESERVED_ID), "id")
        for index, node in enumerate(nodes):
            for k, group in enumerate(() if isinstance(node, EmitterNode) else node.groups):
                if group in (*ids, RESERVED_ID):
                    what = OF_ALL if group == RESERVED_ID else "the id of a node"
                    raise refused(f"{group} is {what}: a group needs a name of its own", index, "groups", k)
        if not any(isinstance(node, Aircraft) for node in nodes):
            raise ValueError("there has to be a UA: the flight dynamics keep the time")
        return nodes

    @field_validator("networks")
    @classmethod
    def _names_are_free(cls, networks: dict[str, RadioSetting]) -> dict[str, RadioSetting]:
        if MAIN in networks:
            raise refused(f"{MAIN} is the network of the key radio: choose another name", MAIN)
        if RESERVED_ID in networks:
            raise refused(f"{RESERVED_ID} is {OF_ALL}: choose another name", RESERVED_ID)
        return networks

    @model_validator(mode="after")
    def _networks_are_there(self) -> Self:
        for index, node in enumerate(self.nodes):
            for k, name in enumerate(() if isinstance(node, EmitterNode) else node.networks or ()):
                if name not in self.network_names:
                    known = ", ".join(self.network_names)
                    raise refused(f"no network {name}; there are: {known}", "nodes", index, "networks", k)
        for name in self.networks:
            if len(self.nodes_on(name)) < min(2, len(self.transceivers)):
                raise refused("fewer than two nodes are on it: nobody would hear anybody", "networks", name)
        return self

    @model_validator(mode="after")
    def _partitions_are_of_nodes(self) -> Self:
        for index, partition in enumerate(self.partitions):
            partition.check(self._members, index)
        return self

    @model_validator(mode="after")
    def _modems_have_radios(self) -> Self:
        for index, node in enumerate(self.nodes):
            if isinstance(node, EmitterNode):
                continue
            for name in node.modems:
                if name not in self.network_names or node not in self.nodes_on(name):
                    radios = ", ".join(each for each in self.network_names if node in self.nodes_on(each))
                    raise refused(
                        f"node {node.node} has no radio {name}; it has: {radios}",
                        "nodes",
                        index,
                        "modems",
                        name,
                    )
                to = node.modems[name].to
                known = [RESERVED_ID, *(each for each in self.modems_on(name) if each != node.node)]
                if to is not None and to not in known:
                    text = f"no other node {to} has a modem on {name}; there are: {', '.join(known)}"
                    raise refused(text, "nodes", index, "modems", name, "to")
            if node.modems and not node.is_regulated:
                text = "needs an agent of ours at its node: agent: {type: still} does"
                raise refused(text, "nodes", index, "modems")
            if self.fdm.scheme == "legacy" and node.modems and isinstance(node, Aircraft):
                text = "a peer of fdm.scheme legacy has no second serial port here"
                raise refused(text, "nodes", index, "modems")
        return self

    @model_validator(mode="after")
    def _autopilots_fit(self) -> Self:
        for index, ua in enumerate(self.nodes):
            if not isinstance(ua, Aircraft):
                continue
            kind = self.autopilot_of(ua)
            if self.fdm.scheme == "legacy" and kind != "external":
                text = "legacy is for autopilot: external; the others speak json only"
                raise refused(text, "fdm", "scheme")
            outputs = [name for name in self.parameters | ua.parameters if name.startswith(PX4_OUTPUTS)]
            if kind == "px4" and outputs:
                own = ("nodes", index) if outputs[0] in ua.parameters else ()
                raise refused(
                    f"UA {ua.node} is flown by PX4: this is the airframe's, in its section px4, as the flight dynamics "
                    "read there which outputs are motors",
                    *own,
                    "parameters",
                    outputs[0],
                )
            if kind == "px4" and ua.modems:
                text = f"UA {ua.node} is flown by PX4, which has no second serial port here"
                raise refused(text, "nodes", index, "modems")
        return self

    @model_validator(mode="after")
    def _one_process_is_one(self) -> Self:
        if self.processes == "one" and self.asks_for_processes:
            raise refused(f"one, and {self.asks_for_processes}: choose one of them", "processes")
        return self

    @property
    def tick_period_ns(self) -> int:
        """Sim time between two ticks."""
        return 1_000_000_000 // self.tick_rate_hz

    @property
    def asks_for_processes(self) -> str:
        """The first setting that wants processes of its own; "" if there is none."""
        if any(node.agent.isolated for node in self.transceivers):
            return "an agent with isolated: true"
        if self.hosts != AUTO:
            return f"hosts: {self.hosts}"
        return "" if self.fdm.workers in (AUTO, 1) else f"fdm.workers: {self.fdm.workers}"

    @property
    def has_bus(self) -> bool:
        """Whether a run of one process has Zenoh beside it; one of many processes always has."""
        free = any(not node.has_agent for node in self.transceivers)
        return free or self.speed != MAX if self.zenoh == AUTO else bool(self.zenoh)

    @property
    def exchange_period_ns(self) -> int:
        """Sim time between two exchanges of MAVLink with the autopilots."""
        return 1_000_000_000 // (self.mavlink_rate_hz or self.tick_rate_hz)

    @property
    def ua(self) -> tuple[Aircraft, ...]:
        """The nodes that are UA."""
        return tuple(node for node in self.nodes if isinstance(node, Aircraft))

    @property
    def ground(self) -> tuple[GroundNode, ...]:
        """The nodes that are on the ground."""
        return tuple(node for node in self.nodes if isinstance(node, GroundNode))

    @property
    def emitters(self) -> tuple[EmitterNode, ...]:
        """The nodes that radiate and exchange no packets."""
        return tuple(node for node in self.nodes if isinstance(node, EmitterNode))

    @property
    def transceivers(self) -> tuple[Transceiver, ...]:
        """The nodes that exchange packets."""
        return tuple(node for node in self.nodes if not isinstance(node, EmitterNode))

    @property
    def transceiver_ids(self) -> tuple[str, ...]:
        """Ids of the nodes that exchange packets: columns of packets name a node by its place here."""
        return tuple(node.node for node in self.transceivers)

    @property
    def network_names(self) -> tuple[str, ...]:
        """Names of the radio networks: `main`, then the others."""
        return (MAIN, *self.networks)

    def nodes_on(self, network: str) -> tuple[Transceiver, ...]:
        """The nodes that are on a radio network."""
        return tuple(node for node in self.transceivers if node.networks is None or network in node.networks)

    def modems_on(self, network: str) -> dict[str, UaModem | GroundModem]:
        """The modems at radios of a network, by id of their nodes."""
        return {node.node: node.modems[network] for node in self.transceivers if network in node.modems}

    @property
    def groups(self) -> tuple[str, ...]:
        """Names of the groups that nodes are in, sorted."""
        return tuple(sorted({group for node in self.transceivers for group in node.groups}))

    def groups_on(self, network: str) -> dict[str, tuple[str, ...]]:
        """Ids of the members of each group that are on a radio network."""
        nodes = self.nodes_on(network)
        return {group: tuple(node.node for node in nodes if group in node.groups) for group in self.groups}

    @property
    def _members(self) -> dict[str, tuple[str, ...]]:
        """Ids of nodes, by what partitions name them by: each by its own id, and by groups that it is in."""
        return {node: (node,) for node in self.transceiver_ids} | self.groups_on(MAIN)

    def nodes_apart(self, partition: PartitionSetting) -> tuple[tuple[str, ...], ...]:
        """Ids of the nodes of each group of a partition."""
        return partition.nodes(self._members)

    def reach_of(self, node_id: str) -> dict[str, tuple[str, ...]]:
        """The radios of a node by name, and for each the ids of all nodes on its network, and the groups there."""
        reach = {name: tuple(node.node for node in self.nodes_on(name)) for name in self.network_names}
        groups = {name: [group for group, ids in self.groups_on(name).items() if ids] for name in reach}
        return {name: (*ids, *groups[name]) for name, ids in reach.items() if node_id in ids}

    @property
    def stations(self) -> tuple[str, ...]:
        """Ids of the nodes that are in the medium: those that exchange packets, then emitters."""
        return (*self.transceiver_ids, *(node.node for node in self.emitters))

    @property
    def regulated(self) -> tuple[str, ...]:
        """Ids of the nodes that the clock waits for."""
        return tuple(node.node for node in self.transceivers if node.is_regulated)

    @property
    def nodes_with_a_task(self) -> frozenset[str]:
        """Nodes whose agents have an end of their own, which the run waits for."""
        return frozenset(node.node for node in self.transceivers if node.agent.has_task)

    def title(self, node_id: str) -> str:
        """What a node is called where people read: ``UA 1``, ``node gcs``."""
        return f"{'UA' if isinstance(self.node(node_id), Aircraft) else 'node'} {node_id}"

    @property
    def speed_factor(self) -> float:
        """Target real-time factor; ``inf`` for max."""
        return float("inf") if self.speed == MAX else float(self.speed)

    def node(self, node_id: str) -> NodeConfig:
        """The node with this id."""
        return next(node for node in self.nodes if node.node == node_id)

    def autopilot_of(self, ua: Aircraft) -> AutopilotName:
        """Who flies ``ua``."""
        return ua.autopilot or self.autopilot

    @property
    def autopilots(self) -> frozenset[AutopilotName]:
        """Who flies: all kinds of the fleet."""
        return frozenset(self.autopilot_of(ua) for ua in self.ua)

    @property
    def autopilots_in_words(self) -> str:
        """Who flies, for people: ``ardupilot, px4``."""
        return ", ".join(sorted(self.autopilots))

    def fdm_port(self, ua: Aircraft) -> int:
        """UDP port of the flight dynamics exchange of ``ua``; of PX4, TCP."""
        if self.autopilot_of(ua) == "px4":
            return px4_port(self.instance(ua))
        if self.fdm.scheme == "legacy":
            return legacy_ports(self.instance(ua))[1]
        return self._port(self.ports.fdm, ua)

    def autopilot_port(self, ua: Aircraft) -> int:
        """TCP port of the autopilot of ``ua``; of PX4, UDP, and what it says comes to the next one."""
        return self._port(self.ports.autopilot, ua)

    def serial_port(self, ua: Aircraft, serial: int) -> int:
        """TCP port of a further serial port of the autopilot of ``ua``, as ArduPilot's SITL counts them."""
        return self.autopilot_port(ua) + 1 + serial

    def api_port(self, ua: Aircraft) -> int:
        """TCP port of the HTTP API of ``ua``, if the scenario asks for one."""
        return self._port(self.ports.api, ua)

    def aps_port(self, ua: Aircraft) -> int:
        """TCP port of the MAVLink server of ``ua``."""
        return self._port(self.ports.aps, ua)

    def udp_outputs(self, ua: Aircraft) -> tuple[str, ...]:
        """Where the MAVLink of ``ua`` is sent: HOST:PORT."""
        if self.mavlink.udp_out != AUTO:
            return tuple(self.mavlink.udp_out)
        if self.speed_factor != 1.0:
            return ()
        slot, ports = self.instance(ua), [self.ports.gcs]
        if self.ports.mavsdk:
            ports.append(self.ports.mavsdk + slot + (MAVSDK_STEP if slot >= MAVSDK_SLOTS else 0))
        return tuple(f"127.0.0.1:{port}" for port in ports if 0 < port <= 65535)

    def instance(self, ua: Aircraft) -> int:
        """What the ports of ``ua`` are counted by."""
        return ua.id + self.ports.first_slot

    def _port(self, first: int, ua: Aircraft) -> int:
        return first + 10 * self.instance(ua)

    def to_yaml(self) -> str:
        """The scenario as resolved."""
        return yaml_of(self.model_dump(mode="json", by_alias=True))

    @classmethod
    def from_yaml(cls, text: str, placed: Callable[[Any], Any] = lambda content: content) -> Self:
        """Read back what `to_yaml` wrote. What it names is not looked for: that is `bridge.scenario.file`'s part.

        Args:
            text: YAML.
            placed: gives the same content with the files that it names where they are now.

        Raises:
            ValueError: a key or value is wrong.
        """
        return cls.model_validate(placed(read_yaml(text, is_ours=True)))
