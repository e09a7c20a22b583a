"""Frozen records with the fields of `msg/*.msg`, in their order; what each field means stands there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, ClassVar, TypeVar

if TYPE_CHECKING:
    from numpy.typing import NDArray

PACKAGE = "lostlink_msgs"
NANOSECONDS = 1_000_000_000
T = TypeVar("T")
if TYPE_CHECKING:
    Column = Sequence[T] | NDArray[Any]
    """Numbers in a row: whoever writes them may give an array, whoever reads them gets a tuple."""
else:
    Column = Sequence


class Message:
    """Base of everything that travels in CDR. ``TYPE`` is the ROS 2 type name."""

    TYPE: ClassVar[str]
    __slots__ = ()


@dataclass(frozen=True, slots=True)
class Time(Message):
    """builtin_interfaces/Time: here always sim time."""

    TYPE = "builtin_interfaces/msg/Time"
    sec: int = 0
    nanosec: int = 0

    @classmethod
    def from_ns(cls, sim_time_ns: int) -> Time:
        """Split integer nanoseconds."""
        return cls(*divmod(sim_time_ns, NANOSECONDS))

    @property
    def ns(self) -> int:
        """Integer nanoseconds."""
        return self.sec * NANOSECONDS + self.nanosec


@dataclass(frozen=True, slots=True)
class Header(Message):
    """std_msgs/Header: sim time and, as ``frame_id``, a node id."""

    TYPE = "std_msgs/msg/Header"
    stamp: Time = field(default_factory=Time)
    frame_id: str = ""

    @classmethod
    def at(cls, sim_time_ns: int, frame_id: str) -> Header:
        """Header for an instant of sim time."""
        return cls(Time.from_ns(sim_time_ns), frame_id)


@dataclass(frozen=True, slots=True)
class Vector3(Message):
    """geometry_msgs/Vector3."""

    TYPE = "geometry_msgs/msg/Vector3"
    x: float = 0.0
    y: float = 0.0
    z: float = 0.0

    @property
    def xyz(self) -> tuple[float, float, float]:
        """The components as a tuple."""
        return (self.x, self.y, self.z)


@dataclass(frozen=True, slots=True)
class Quaternion(Message):
    """geometry_msgs/Quaternion."""

    TYPE = "geometry_msgs/msg/Quaternion"
    x: float = 0.0
    y: float = 0.0
    z: float = 0.0
    w: float = 1.0


GROUND_MODE = "GROUND"
"""`AircraftState.mode` of a node that has no autopilot."""


@dataclass(frozen=True, slots=True)
class AircraftState(Message):
    """State of one UA as its autopilot reports it (Moon et al. 2020, Table I)."""

    TYPE = f"{PACKAGE}/msg/AircraftState"
    HEARTBEAT: ClassVar[int] = 0
    STATUS: ClassVar[int] = 1
    ATTITUDE: ClassVar[int] = 2
    POSITION: ClassVar[int] = 3
    LOCAL_POSITION: ClassVar[int] = 4
    VELOCITY: ClassVar[int] = 5
    SPEED: ClassVar[int] = 6
    AIRSPEED: ClassVar[int] = 7
    WIND: ClassVar[int] = 8
    CURRENT: ClassVar[int] = 9
    CLOCK: ClassVar[int] = 10
    header: Header = field(default_factory=Header)
    mav_id: int = 0
    euler_rad: Vector3 = field(default_factory=Vector3)
    longitude_deg: float = 0.0
    latitude_deg: float = 0.0
    altitude_amsl_m: float = 0.0
    altitude_rel_m: float = 0.0
    position_ned_m: Vector3 = field(default_factory=Vector3)
    velocity_ned_mps: Vector3 = field(default_factory=Vector3)
    indicated_airspeed_mps: float = 0.0
    groundspeed_mps: float = 0.0
    airspeed_mps: float = 0.0
    mode: str = ""
    base_mode: str = ""
    heartbeat_age_s: float = 0.0
    flight_time_s: float = 0.0
    voltage_v: float = 0.0
    current_a: float = 0.0
    wind_body_mps: Vector3 = field(default_factory=Vector3)
    throttle_percent: float = 0.0
    armed: bool = False
    ready_to_arm: bool = False
    age_s: Column[float] = ()


@dataclass(frozen=True, slots=True)
class Waypoint(Message):
    """One planned point of a UA."""

    TYPE = f"{PACKAGE}/msg/Waypoint"
    longitude_deg: float = 0.0
    latitude_deg: float = 0.0
    altitude_rel_m: float = 0.0


@dataclass(frozen=True, slots=True)
class DataPackage(Message):
    """What one UA transmits to the others (Moon et al. 2020, Table II)."""

    TYPE = f"{PACKAGE}/msg/DataPackage"
    header: Header = field(default_factory=Header)
    frequency_mhz: int = 0
    state: AircraftState = field(default_factory=AircraftState)
    waypoints: tuple[Waypoint, ...] = ()
    received_power_dbm: tuple[float, ...] = ()


@dataclass(frozen=True, slots=True)
class CommunicationStatus(Message):
    """Which other nodes' latest packets reached this one (Moon et al. 2020, eq. 9)."""

    TYPE = f"{PACKAGE}/msg/CommunicationStatus"
    header: Header = field(default_factory=Header)
    node: tuple[str, ...] = ()
    delivered: tuple[bool, ...] = ()


@dataclass(frozen=True, slots=True)
class Truth(Message):
    """True state of one UA, from the flight dynamics."""

    TYPE = f"{PACKAGE}/msg/Truth"
    header: Header = field(default_factory=Header)
    longitude_deg: float = 0.0
    latitude_deg: float = 0.0
    altitude_amsl_m: float = 0.0
    position_ned_m: Vector3 = field(default_factory=Vector3)
    velocity_ned_mps: Vector3 = field(default_factory=Vector3)
    attitude: Quaternion = field(default_factory=Quaternion)
    body_rates_frd_radps: Vector3 = field(default_factory=Vector3)
    specific_force_frd_mps2: Vector3 = field(default_factory=Vector3)
    airspeed_mps: float = 0.0
    wind_ned_mps: Vector3 = field(default_factory=Vector3)


@dataclass(frozen=True, slots=True)
class Clock(Message):
    """Fleet time, one message per tick."""

    TYPE = f"{PACKAGE}/msg/Clock"
    header: Header = field(default_factory=Header)
    speed: float = 1.0
    real_time_factor: float = 0.0
    paused: bool = False
    stalled: tuple[str, ...] = ()
    ended: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Truths(Message):
    """The true states of all nodes at a tick."""

    TYPE = f"{PACKAGE}/msg/Truths"
    header: Header = field(default_factory=Header)
    truth: tuple[Truth, ...] = ()


@dataclass(frozen=True, slots=True)
class Links(Message):
    """All directed links that carried a packet, per radio network: the newest packet of each, and its counts so far."""

    TYPE = f"{PACKAGE}/msg/Links"
    header: Header = field(default_factory=Header)
    node: tuple[str, ...] = ()
    tx: Column[int] = ()
    rx: Column[int] = ()
    distance_m: Column[float] = ()
    received_power_dbm: Column[float] = ()
    snr_db: Column[float] = ()
    per: Column[float] = ()
    sent: Column[int] = ()
    delivered: Column[int] = ()
    radio_off: Column[int] = ()
    network: tuple[str, ...] = ()
    radio: Column[int] = ()


@dataclass(frozen=True, slots=True)
class RadioSwitch(Message):
    """An operator switched a node's radio: it holds from the header's stamp on."""

    TYPE = f"{PACKAGE}/msg/RadioSwitch"
    header: Header = field(default_factory=Header)
    on: bool = True


@dataclass(frozen=True, slots=True)
class Fates(Message):
    """What became of the packets that a tick settled, as columns: a row per packet and intended receiver."""

    TYPE = f"{PACKAGE}/msg/Fates"
    header: Header = field(default_factory=Header)
    node: tuple[str, ...] = ()
    cause: tuple[str, ...] = ()
    tx: Column[int] = ()
    rx: Column[int] = ()
    seq: Column[int] = ()
    sim_time_ns: Column[int] = ()
    length_bytes: Column[int] = ()
    distance_m: Column[float] = ()
    received_power_dbm: Column[float] = ()
    snr_db: Column[float] = ()
    per: Column[float] = ()
    fate: bytes = b""
    packets: Column[int] = ()
    delay_s: Column[float] = ()
    network: tuple[str, ...] = ()
    radio: Column[int] = ()
    entered_ns: Column[int] = ()
    started_ns: Column[int] = ()
    ended_ns: Column[int] = ()
    attempts: Column[int] = ()


@dataclass(frozen=True, slots=True)
class CommunicationMatrix(Message):
    """The CommunicationStatus of all nodes at once, row by row of receivers."""

    TYPE = f"{PACKAGE}/msg/CommunicationMatrix"
    header: Header = field(default_factory=Header)
    node: tuple[str, ...] = ()
    known: Column[bool] = ()
    delivered: Column[bool] = ()


@dataclass(frozen=True, slots=True)
class Measurements(Message):
    """What RF sensors report of one tick, as columns: a row per emitter that a sensor measured."""

    TYPE = f"{PACKAGE}/msg/Measurements"
    header: Header = field(default_factory=Header)
    node: Column[int] = ()
    number: Column[int] = ()
    power_dbm: Column[float] = ()
    frequency_hz: Column[float] = ()
    emitter: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Heard(Message):
    """What the radio has for the nodes of one host at the end of a tick: packets that arrive, and who was heard."""

    TYPE = f"{PACKAGE}/msg/Heard"
    header: Header = field(default_factory=Header)
    tx: Column[int] = ()
    seq: Column[int] = ()
    sim_time_ns: Column[int] = ()
    channel: tuple[str, ...] = ()
    end: Column[int] = ()
    data: bytes = b""
    radio: Column[int] = ()
    packet: Column[int] = ()
    rx: Column[int] = ()
    rssi_dbm: Column[float] = ()
    snr_db: Column[float] = ()
    entered_ns: Column[int] = ()
    started_ns: Column[int] = ()
    ended_ns: Column[int] = ()
    arrived_ns: Column[int] = ()
    reply_to: Column[int] = ()
    reply_seq: Column[int] = ()
    reply_ns: Column[int] = ()
    reply_acknowledged: Column[bool] = ()
    reply_attempts: Column[int] = ()
    reply_radio: Column[int] = ()
    queue_of: Column[int] = ()
    queue_packets: Column[int] = ()
    queue_bytes: Column[int] = ()
    queue_radio: Column[int] = ()
    status_of: Column[int] = ()
    status_end: Column[int] = ()
    status_node: Column[int] = ()
    status_delivered: Column[bool] = ()
    serial_of: Column[int] = ()
    serial_ns: Column[int] = ()
    serial_radio: Column[int] = ()
    serial_end: Column[int] = ()
    serial_data: bytes = b""
    measurements: Measurements = field(default_factory=Measurements)


@dataclass(frozen=True, slots=True)
class RadioStatus(Message):
    """What a node's own radios report after a tick: transmit queues, and what became of its unicasts."""

    TYPE = f"{PACKAGE}/msg/RadioStatus"
    header: Header = field(default_factory=Header)
    queue_radio: tuple[str, ...] = ()
    queue_packets: Column[int] = ()
    queue_bytes: Column[int] = ()
    reply_radio: tuple[str, ...] = ()
    reply_seq: Column[int] = ()
    reply_acknowledged: Column[bool] = ()
    reply_attempts: Column[int] = ()
    reply_ns: Column[int] = ()


@dataclass(frozen=True, slots=True)
class CommandGoal(Message):
    """A request to ``node/<id>/cmd/<verb>``; fields that the verb does not use are left 0 or empty."""

    TYPE = f"{PACKAGE}/msg/CommandGoal"
    mode: str = ""
    longitude_deg: float = 0.0
    latitude_deg: float = 0.0
    altitude_rel_m: float = 0.0
    speed_mps: float = 0.0
    arguments: str = ""


@dataclass(frozen=True, slots=True)
class CommandEvent(Message):
    """A reply to a CommandGoal: accepted, then feedback as it goes, then one result."""

    TYPE = f"{PACKAGE}/msg/CommandEvent"
    ACCEPTED: ClassVar[int] = 0
    FEEDBACK: ClassVar[int] = 1
    RESULT: ClassVar[int] = 2
    phase: int = 0
    success: bool = False
    text: str = ""
    remaining_m: float = float("nan")
    outcome: str = ""
    value: str = ""
    done: int = -1
    total: int = -1


@dataclass(frozen=True, slots=True)
class AgentStatus(Message):
    """What an agent says of itself."""

    TYPE = f"{PACKAGE}/msg/AgentStatus"
    header: Header = field(default_factory=Header)
    activity: str = ""
    done: bool = False
    failed: bool = False
    sent: int = 0
    received: int = 0


@dataclass(frozen=True, slots=True)
class Packet(Message):
    """A packet that a node gave to the radio, in a record; ``payload`` is empty unless payloads were asked for."""

    TYPE = f"{PACKAGE}/msg/Packet"
    header: Header = field(default_factory=Header)
    seq: int = 0
    address: str = ""
    encoding: str = ""
    length_bytes: int = 0
    payload: bytes = b""


@dataclass(frozen=True, slots=True)
class Mavlink(Message):
    """MAVLink of one UA at a tick, in a record: whole frames, one behind the other."""

    TYPE = f"{PACKAGE}/msg/Mavlink"
    header: Header = field(default_factory=Header)
    data: bytes = b""
