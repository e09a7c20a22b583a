"""The media of `channel.access` as a radio's configuration names them: ``medium: {model: csma, rate_mbps: 6}``."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

from pydantic import Field, field_validator, model_validator

from channel.access.air import Hearing
from channel.access.carriers import Carriers
from channel.access.elrs_modes import ELRS_MODES
from channel.access.media.airtime import AirTime
from channel.access.media.csma import Csma, DcfSettings
from channel.access.media.delay import Delay, DelaySettings, WayDelay
from channel.access.media.elrs import Elrs, ElrsSettings
from channel.access.media.medium import AccessMedium
from channel.access.media.schedule import Schedule, Slot
from channel.access.media.sik import DEFAULT_NETID, LEAST_RADIOS, Sik, SikSettings
from channel.access.media.sik_timing import (
    AIR_RATES_KBPS,
    NOMINAL_TICK_NS,
    REAL_TICK_NS,
    SikTiming,
    sik_timing,
)
from channel.access.media.tdma import Tdma
from channel.access.queue import QueueLimits
from channel.access.slot_settings import Ids, SlotSchedule
from channel.access.timing import NS_PER_S, BitRate, Wifi, wifi_a, wifi_b, wifi_g
from channel.access.world import World
from channel.numbers.units import SPEED_OF_LIGHT_MPS, ratio_from_db
from channel.own import own_models
from channel.phy.spectrum import Rows, captured_db, reaches
from channel.variant import Settings, Variant

if TYPE_CHECKING:
    from channel.config import RadioConfig

ENERGY_OVER_PREAMBLE_DB = 20.0
"""IEEE 802.11-2020, 17.3.10.6: energy alone makes a medium busy 20 dB above the least sensitivity."""

CCA_OFDM_NS, CCA_DSSS_NS = 4_000, 15_000
"""aCCATime of 802.11a and g, and of b (IEEE 802.11-2020, tables 17-21 and 16-4): until a carrier is sensed."""


@dataclass(frozen=True, slots=True)
class Surroundings:
    """What a medium is opened in.

    Attributes:
        world: its nodes, and what lies between them.
        nodes: the place of each id among them.
        seed: of the run.
        bit_rate_bps: of the radio.
        noise_floor_dbm: of the quietest receiver.
        bandwidth_hz: of the radio.
        filter_rows: of its receiver (`channel.phy.spectrum`).
    """

    world: World
    nodes: Mapping[str, int]
    seed: int
    bit_rate_bps: float
    noise_floor_dbm: float
    bandwidth_hz: float
    filter_rows: Rows

    @classmethod
    def of(
        cls, world: World, nodes: Mapping[str, int], seed: int, config: RadioConfig, noise_floor_dbm: float
    ) -> Surroundings:
        """Those of nodes with a radio."""
        filter_rows = config.interference.filter_rows(config.bandwidth_hz)
        bit_rate_bps = config.bit_rate_bps
        return cls(world, nodes, seed, bit_rate_bps, noise_floor_dbm, config.bandwidth_hz, filter_rows)

    def leaks(self, spacing_hz: float, count: int) -> tuple[float, ...]:
        """The shares of power that a receiver takes in from signals 1, 2, ... ``count`` channels away."""
        found = []
        for distance in range(1, count + 1):
            offset_hz = distance * spacing_hz
            if not reaches(offset_hz, self.bandwidth_hz, self.filter_rows):
                break
            found.append(float(ratio_from_db(captured_db(offset_hz, self.bandwidth_hz, self.filter_rows))))
        return tuple(found)

    def place(self, node: str) -> int:
        """The place of an id.

        Raises:
            ValueError: there is no such node.
        """
        if node not in self.nodes:
            raise ValueError(f"medium: node {node} is not there; there are {', '.join(self.nodes)}")
        return self.nodes[node]


class Queue(Settings):
    """Of each node, before its transmitter."""

    packets: int = Field(default=64, ge=0, le=1_000_000, description="so many wait; 0: no limit")
    length_bytes: int = Field(default=0, ge=0, description="of all that wait; 0: no limit")
    by_class: bool = Field(default=False, description="each priority has a queue of this size of its own")
    mavlink: bool = Field(
        default=False,
        description="packets of MAVLink frames have a priority by their messages, unless their sender gave them one: "
        "heartbeats and commands 2, parameters and missions 1, telemetry 0",
    )

    @property
    def limits(self) -> QueueLimits:
        """As media take them."""
        return QueueLimits(self.packets, self.length_bytes, self.by_class)


class Ideal(Variant):
    """A packet takes no time, no node waits, and packets do not disturb each other (Moon et al. 2020)."""

    takes_time: ClassVar[bool] = False
    is_shared: ClassVar[bool] = True
    """Whether `capacity_bps` is for all nodes together; else each sender has so much."""
    model: Literal["ideal"] = "ideal"

    def carriers(self) -> None:
        """Nothing is on the air for any time: other networks neither hear it nor disturb it."""


class Locking(Variant):
    """Radios with a queue each, and receivers that hear one frame at a time."""

    takes_time: ClassVar[bool] = True
    is_shared: ClassVar[bool] = True
    queue: Queue = Field(default_factory=Queue)
    preamble_dbm: float | None = Field(
        default=None,
        ge=-200.0,
        le=100.0,
        description="weakest signal that a receiver locks on to, and senses as a carrier; the noise floor unless given",
    )
    energy_dbm: float | None = Field(
        default=None,
        ge=-200.0,
        le=100.0,
        description="any power from here on is sensed as a carrier; 20 dB above preamble_dbm unless given",
    )
    capture_db: float | None = Field(
        default=None,
        ge=0.0,
        le=100.0,
        description="a later signal stronger by so much takes a receiver over; none does unless given",
    )

    def hearing(self, surroundings: Surroundings) -> Hearing:
        """How receivers hear."""
        preamble_dbm = surroundings.noise_floor_dbm if self.preamble_dbm is None else self.preamble_dbm
        energy_dbm = preamble_dbm + ENERGY_OVER_PREAMBLE_DB if self.energy_dbm is None else self.energy_dbm
        capture = float("inf") if self.capture_db is None else float(ratio_from_db(self.capture_db))
        return Hearing(float(ratio_from_db(preamble_dbm)), float(ratio_from_db(energy_dbm)), capture)

    def carriers(self) -> Carriers:
        """Where it is on the air."""
        return Carriers()


class Shared(Locking):
    """Radios on channels that each keeps."""

    channels: dict[str, int] = Field(
        default_factory=dict,
        description="of nodes, by id; 0 unless given: only those on one channel hear each other",
    )
    channel_spacing_hz: float = Field(
        default=5e6,
        gt=0.0,
        le=1e10,
        description="between two channels: what leaks from one into another is by the radio's spectrum and filter",
    )

    def hearing(self, surroundings: Surroundings) -> Hearing:
        """How receivers hear.

        Raises:
            ValueError: a channel of a node that is not there.
        """
        channels = {surroundings.place(node): channel for node, channel in self.channels.items()}
        used = self.channels_used()
        adjacent = surroundings.leaks(self.channel_spacing_hz, max(used) - min(used))
        return replace(super().hearing(surroundings), channels=channels, adjacent=adjacent)

    def channels_used(self) -> frozenset[int]:
        """Those that nodes are on at some time."""
        return frozenset(self.channels.values()) | {0}

    def carriers(self) -> Carriers:
        """Where it is on the air: channel 0 is the radio's carrier."""
        return Carriers(self.channel_spacing_hz, tuple(sorted(self.channels_used())))


class Serial(Shared):
    """A plain radio: preamble, header and packet at one bit rate."""

    bit_rate_bps: float | None = Field(
        default=None, gt=0.0, le=1e12, description="on the air; the radio's unless given"
    )
    preamble_s: float = Field(default=0.0, ge=0.0, le=1.0, description="before each frame")
    header_bytes: int = Field(default=0, ge=0, le=1000, description="that each packet gets")
    max_length_bytes: int = Field(default=65_535, ge=1, description="the longest packet")

    def timing(self, surroundings: Surroundings) -> BitRate:
        """Of frames."""
        bit_rate_bps = surroundings.bit_rate_bps if self.bit_rate_bps is None else self.bit_rate_bps
        return BitRate(
            bit_rate_bps, round(self.preamble_s * NS_PER_S), self.header_bytes, self.max_length_bytes
        )

    def capacity_bps(self, length_bytes: int, bit_rate_bps: float) -> float:
        """Bits of packets of a length per second, if one sender sends them back to back."""
        return 8 * length_bytes / self.duration_s(length_bytes, bit_rate_bps)

    def duration_s(self, length_bytes: int, bit_rate_bps: float) -> float:
        """Of a frame, on a radio of that bit rate."""
        rate_bps = bit_rate_bps if self.bit_rate_bps is None else self.bit_rate_bps
        return self.preamble_s + 8 * (length_bytes + self.header_bytes) / rate_bps


class AirTimeMedium(Serial):
    """Each node transmits as soon as its transmitter is free, without listening or acknowledgements."""

    model: Literal["airtime"] = "airtime"

    def open(self, surroundings: Surroundings) -> AccessMedium:
        """Make the medium."""
        hearing = self.hearing(surroundings)
        return AirTime(surroundings.world, self.timing(surroundings), self.queue.limits, hearing)


class TdmaMedium(Serial):
    """Each node transmits in its slots."""

    model: Literal["tdma"] = "tdma"
    slot_s: float | None = Field(
        default=None, gt=0.0, le=10.0, description="how long each lasts, its guard time included"
    )
    guard_s: float = Field(default=0.0, ge=0.0, le=1.0, description="at the end of each")
    slots: tuple[str, ...] = Field(default=(), description="whose each is; one each, as listed, unless given")
    schedule: SlotSchedule | None = Field(
        default=None,
        description="of slots that differ, in the place of the three; or schedule_file, a YAML file",
    )

    @model_validator(mode="after")
    def _has_slots(self) -> TdmaMedium:
        if (self.slot_s is None) == (self.schedule is None):
            raise ValueError("has to have either slot_s or schedule")
        if self.schedule is not None:
            beside = [key for key in ("guard_s", "slots", "channels") if getattr(self, key)]
            if beside:
                raise ValueError(f"{', '.join(beside)}: the slots of a schedule have their own")
        elif self.slot_s is not None and self.guard_s >= self.slot_s:
            raise ValueError(f"slots of {self.slot_s:g} s with a guard of {self.guard_s:g} s have no room")
        return self

    def _by_id(self, nodes: Iterable[str]) -> Schedule[str]:
        """The schedule; generated, if it is not spelt out."""
        if self.schedule is not None:
            return self.schedule.by_id
        slot_ns = round((self.slot_s or 0.0) * NS_PER_S)
        return Schedule.equal(self.slots or tuple(nodes), slot_ns, round(self.guard_s * NS_PER_S))

    def channels_used(self) -> frozenset[int]:
        """Those of its slots, too."""
        of_slots = self._by_id(()).channels if self.schedule is not None else frozenset()
        return super().channels_used() | of_slots

    def open(self, surroundings: Surroundings) -> AccessMedium:
        """Make the medium.

        Raises:
            ValueError: a slot of a node that is not there, or slots too short for any packet.
        """
        timing, hearing = self.timing(surroundings), self.hearing(surroundings)
        try:
            schedule = self._by_id(surroundings.nodes).placed(surroundings.place)
            return Tdma(surroundings.world, timing, schedule, self.queue.limits, hearing)
        except ValueError as error:
            if self.schedule is None or not self.schedule.read_from:
                raise
            raise ValueError(f"{self.schedule.read_from}: {error}") from error

    def capacity_bps(self, length_bytes: int, bit_rate_bps: float) -> float:
        """Bits of packets of a length per second, if every slot is filled with what fits in it; 0 if none does."""
        schedule = self._by_id(("",))
        return self._carried_bps(length_bytes, bit_rate_bps, schedule.slots, schedule.round_ns)

    @property
    def is_by_node(self) -> bool:
        """Whether `node_capacity_bps` says what each node has for itself."""
        return self.schedule is not None

    def node_capacity_bps(
        self, node: str, length_bytes: int, bit_rate_bps: float, priority: int | None
    ) -> float:
        """Bits of packets of a length per second in the slots of one node.

        Args:
            node: its id.
            length_bytes: of each packet.
            bit_rate_bps: of the radio.
            priority: of the packets; None: of any.
        """
        schedule = self._by_id((node,))
        own = [
            replace(slot, nodes=(node,))
            for slot in schedule.slots
            if node in slot.nodes and (priority is None or slot.takes(priority))
        ]
        return self._carried_bps(length_bytes, bit_rate_bps, own, schedule.round_ns)

    def _carried_bps(
        self, length_bytes: int, bit_rate_bps: float, slots: Iterable[Slot[str]], round_ns: int
    ) -> float:
        packets = 0
        for slot in slots:
            at_rate = self.model_copy(update={"bit_rate_bps": slot.bit_rate_bps or self.bit_rate_bps})
            frame_ns = max(1, round(at_rate.duration_s(length_bytes, bit_rate_bps) * NS_PER_S))
            packets += len(slot.nodes) * (slot.room_ns // frame_ns)
        return 8 * length_bytes * packets * NS_PER_S / round_ns


class CsmaMedium(Shared):
    """IEEE 802.11 DCF without an access point."""

    model: Literal["csma"] = "csma"
    standard: Literal["11b", "11a", "11g"] = "11g"
    rate_mbps: float = Field(default=6.0, gt=0.0, description="of unicasts")
    basic_rate_mbps: float | None = Field(
        default=None, gt=0.0, description="of broadcasts and control frames; the lowest unless given"
    )
    clock: float = Field(default=1.0, description="of the symbols: 0.5 and 0.25 are channels of 10 and 5 MHz")
    short_preamble: bool = Field(default=False, description="of 11b")
    attempts_max: int = Field(default=7, ge=1, le=255, description="of a unicast, then it is given up")
    rts_from_bytes: int | None = Field(default=None, ge=0, description="unicasts from here on are announced")
    reach_m: float = Field(
        default=3000.0,
        ge=0.0,
        le=1e6,
        description="acknowledgements are waited for from so far (coverage class)",
    )
    preamble_dbm: float | None = Field(default=-82.0, ge=-200.0, le=100.0, description="carrier sense")

    @model_validator(mode="after")
    def _has_a_timing(self) -> CsmaMedium:
        self.timing()
        return self

    def timing(self) -> Wifi:
        """Of frames, slots and windows."""
        lowest = 1.0 if self.standard == "11b" else 6.0
        basic_mbps = lowest if self.basic_rate_mbps is None else self.basic_rate_mbps
        if self.standard == "11b":
            timing = wifi_b(self.rate_mbps, basic_mbps, short_preamble=self.short_preamble)
        elif self.standard == "11a":
            return wifi_a(self.rate_mbps, basic_mbps, clock=self.clock)
        else:
            timing = wifi_g(self.rate_mbps, basic_mbps)
        if self.clock != 1.0:
            raise ValueError(f"clock {self.clock:g} is for 11a only")
        return timing

    def hearing(self, surroundings: Surroundings) -> Hearing:
        """How stations hear."""
        cca_ns = CCA_DSSS_NS if self.standard == "11b" else CCA_OFDM_NS
        return replace(super().hearing(surroundings), cca_ns=cca_ns)

    def open(self, surroundings: Surroundings) -> AccessMedium:
        """Make the medium."""
        reach_ns = round(2.0 * self.reach_m / SPEED_OF_LIGHT_MPS * NS_PER_S)
        settings = DcfSettings(self.attempts_max, self.rts_from_bytes, reach_ns=reach_ns)
        return Csma(
            surroundings.world,
            self.timing(),
            seed=surroundings.seed,
            settings=settings,
            limits=self.queue.limits,
            hearing=self.hearing(surroundings),
        )

    def capacity_bps(self, length_bytes: int, bit_rate_bps: float) -> float:  # noqa: ARG002
        """Bits of broadcasts of a length per second, if one station sends them back to back."""
        timing = self.timing()
        cycle_ns = timing.difs_ns + timing.cw_min / 2 * timing.slot_ns + timing.broadcast_ns(length_bytes)
        return 8 * length_bytes * NS_PER_S / cycle_ns


class DelayMedium(Variant):
    """LTE, satellites: delays, a rate, an outage that comes and goes; nodes do not disturb each other."""

    takes_time: ClassVar[bool] = True
    is_shared: ClassVar[bool] = False
    model: Literal["delay"] = "delay"
    queue: Queue = Field(default_factory=Queue)
    least_s: float = Field(ge=0.0, le=60.0, description="no packet is faster")
    median_s: float = Field(ge=0.0, le=60.0, description="half are at most so late")
    most_s: float = Field(ge=0.0, le=60.0, description="95 % are at most so late; as median_s: all are")
    rate_bps: float = Field(gt=0.0, le=1e12, description="at which a node's packets enter the network")
    header_bytes: int = Field(default=0, ge=0, le=1000, description="that each packet gets")
    good_s: float = Field(default=60.0, gt=0.0, description="mean time of service of a node")
    bad_s: float = Field(default=0.0, ge=0.0, description="mean time of outage; 0: none")
    keeps_order: bool = Field(default=True, description="no packet of a sender overtakes another")
    max_length_bytes: int = Field(default=65_535, ge=1, description="the longest packet")

    @model_validator(mode="after")
    def _is_a_delay(self) -> DelayMedium:
        self._delay()
        return self

    def _delay(self) -> WayDelay:
        return WayDelay(*(round(each * NS_PER_S) for each in (self.least_s, self.median_s, self.most_s)))

    def open(self, surroundings: Surroundings) -> AccessMedium:
        """Make the medium."""
        settings = DelaySettings(
            self._delay(),
            self.rate_bps,
            header_bytes=self.header_bytes,
            good_s=self.good_s,
            bad_s=self.bad_s,
            keeps_order=self.keeps_order,
        )
        return Delay(
            surroundings.world,
            settings,
            seed=surroundings.seed,
            limits=self.queue.limits,
            max_length_bytes=self.max_length_bytes,
        )

    def carriers(self) -> None:
        """Only the way from end to end is known: other networks neither hear it nor disturb it."""

    def capacity_bps(self, length_bytes: int, bit_rate_bps: float) -> float:  # noqa: ARG002
        """Bits of packets of a length per second, of each sender."""
        return self.rate_bps * length_bytes / (length_bytes + self.header_bytes)


def two_by_two(nodes: Sequence[str]) -> tuple[tuple[str, ...], ...]:
    """Nodes in pairs, in their order; the last of an odd number is left out."""
    return tuple(zip(nodes[::2], nodes[1::2], strict=False))


class ElrsMedium(Variant):
    """ExpressLRS with MAVLink: a transmitter module and a receiver take turns."""

    takes_time: ClassVar[bool] = True
    is_shared: ClassVar[bool] = False
    model: Literal["elrs"] = "elrs"
    mode: str = Field(default="lora-500", description=f"one of {', '.join(ELRS_MODES)}")
    pairs: tuple[tuple[str, str], ...] = Field(
        default=(), description="ids, the transmitter module's first; two by two as listed unless given"
    )
    has_rc: bool = Field(default=True, description="a remote control has every second slot up")
    buffer_bytes: int = Field(default=1024, ge=1, le=1 << 20, description="that wait at each end")

    @field_validator("mode")
    @classmethod
    def _is_known(cls, mode: str) -> str:
        if mode not in ELRS_MODES:
            raise ValueError(f"{mode}: there are {', '.join(ELRS_MODES)}")
        return mode

    def links(self, nodes: Sequence[str]) -> dict[str, tuple[str, ...]]:
        """Who hears whom: pairs by number, the transmitter module's first.

        Args:
            nodes: all ids, in their order.
        """
        return {
            f"pair {number}": pair for number, pair in enumerate(self.pairs or two_by_two(nodes), start=1)
        }

    def open(self, surroundings: Surroundings) -> AccessMedium:
        """Make the medium.

        Raises:
            ValueError: a pair of a node that is not there.
        """
        pairs = tuple((surroundings.place(one), surroundings.place(other)) for one, other in self.pairs)
        settings = ElrsSettings(ELRS_MODES[self.mode], pairs, self.has_rc, self.buffer_bytes)
        return Elrs(surroundings.world, settings, seed=surroundings.seed)

    def carriers(self) -> Carriers:
        """Where it is on the air."""
        return ELRS_MODES[self.mode].carriers

    def capacity_bps(self, length_bytes: int, bit_rate_bps: float) -> float:  # noqa: ARG002
        """User bits a second of a stream down, in full chunks."""
        return 8 * ELRS_MODES[self.mode].user_bytes_per_s


class SikMedium(Locking):
    """SiK telemetry radios: two of a NETID share the time in windows, and hop; settings by their parameters' names."""

    model: Literal["sik"] = "sik"
    queue: Queue = Field(
        default_factory=lambda: Queue(packets=0, length_bytes=1850), description="bytes from the host"
    )
    pairs: tuple[tuple[str, str], ...] = Field(
        default=(), description="ids; two by two as listed unless given"
    )
    netids: tuple[int, ...] = Field(
        default=(), description="NETID of each pair; 25, 26 and so on unless given"
    )
    units: dict[Annotated[int, Field(ge=0, le=65_535)], Ids] = Field(
        default_factory=dict,
        description="in place of pairs and netids: by NETID the ids of its nodes, two or more; more than two disturb "
        "each other",
    )
    air_kbps: int = Field(default=64, description=f"AIR_SPEED: one of {', '.join(map(str, AIR_RATES_KBPS))}")
    ecc: bool = Field(default=False, description="ECC: Golay(23,12); error.coding has to say so, too")
    framing: bool = Field(
        default=True, description="MAVLINK: packets stay whole where a frame holds them; else a stream"
    )
    max_window_ms: int = Field(default=131, ge=1, le=131, description="MAX_WINDOW")
    duty_cycle_percent: int = Field(default=100, ge=0, le=100, description="DUTY_CYCLE; 100: no limit")
    lbt: bool = Field(default=False, description="LBT_RSSI: listens before it talks, for energy_dbm")
    channels: int = Field(
        default=50, ge=1, le=50, description="NUM_CHANNELS: 50 at 915 MHz, 10 at 433 and 868"
    )
    channel_spacing_hz: float = Field(
        default=250e3,
        gt=0.0,
        le=1e9,
        description="between two of them: (MAX_FREQ - MIN_FREQ) / (NUM_CHANNELS + 2), for other networks in the band",
    )
    uint8_fault: bool = Field(
        default=True, description="the bytes that fit are taken modulo 256, as the firmware does"
    )
    tick: Literal["real", "nominal"] = Field(
        default="real", description="15.673 us, as the hardware has it, or 16 us, as the firmware reckons"
    )
    takes_estimate: bool = Field(
        default=False,
        description="a receiver takes the window of a trailer as it is, so that its own opens early",
    )
    locked: bool = Field(default=True, description="pairs have found each other before the run starts")

    @model_validator(mode="after")
    def _are_settings(self) -> SikMedium:
        self._timing()
        if self.netids and self.pairs and len(self.netids) != len(self.pairs):
            raise ValueError(f"{len(self.netids)} NETIDs for {len(self.pairs)} pairs")
        if self.units and (self.pairs or self.netids):
            raise ValueError("units has the NETID of each node: leave pairs and netids out")
        netid_of: dict[str, int] = {}
        for netid, ids in self.units.items():
            if len(ids) < LEAST_RADIOS:
                raise ValueError(f"units: NETID {netid} has {len(ids)} of {LEAST_RADIOS} or more nodes")
            for node in ids:
                if node in netid_of:
                    both = sorted({netid_of[node], netid})
                    raise ValueError(f"units: node {node} is twice on NETID {' and '.join(map(str, both))}")
                netid_of[node] = netid
        return self

    def links(self, nodes: Sequence[str]) -> dict[str, tuple[str, ...]]:
        """Who hears whom: by NETID, its nodes.

        Args:
            nodes: all ids, in their order.
        """
        networks = self.pairs or two_by_two(nodes)
        netids = self.netids or range(DEFAULT_NETID, DEFAULT_NETID + len(networks))
        found = self.units or dict(zip(netids, networks, strict=False))
        return {f"NETID {netid}": tuple(ids) for netid, ids in found.items()}

    def _timing(self) -> SikTiming:
        return sik_timing(self.air_kbps, ecc=self.ecc, max_window_ms=self.max_window_ms, lbt=self.lbt)

    def _settings(self, place: Callable[[str], int]) -> SikSettings:
        return SikSettings(
            air_kbps=self.air_kbps,
            ecc=self.ecc,
            framing=self.framing,
            max_window_ms=self.max_window_ms,
            duty_cycle_percent=self.duty_cycle_percent,
            lbt=self.lbt,
            channels=self.channels,
            uint8_fault=self.uint8_fault,
            tick_ns=REAL_TICK_NS if self.tick == "real" else NOMINAL_TICK_NS,
            takes_estimate=self.takes_estimate,
            locked=self.locked,
            networks=tuple(tuple(map(place, ids)) for ids in self.units.values() or self.pairs) or None,
            netids=tuple(self.units) or self.netids or None,
        )

    def open(self, surroundings: Surroundings) -> AccessMedium:
        """Make the medium.

        Raises:
            ValueError: a node that is not there, or is in two pairs.
        """
        return Sik(
            surroundings.world,
            self._settings(surroundings.place),
            seed=surroundings.seed,
            limits=self.queue.limits,
            hearing=self.hearing(surroundings),
        )

    def carriers(self) -> Carriers:
        """Where it is on the air."""
        return Carriers.centred(self.channels, self.channel_spacing_hz)

    def capacity_bps(self, length_bytes: int, bit_rate_bps: float) -> float:  # noqa: ARG002
        """Bits of packets of a length per second, if one of a pair sends them back to back and the other nothing.

        Of a stream of bytes: the own window, and what is left of the peer's after its empty packet; without
        `uint8_fault`, which costs 8 % from 128 kb/s on.
        """
        timing = self._timing()
        sent_bytes = 0
        for left_ns in (
            timing.window * NOMINAL_TICK_NS,
            timing.window * NOMINAL_TICK_NS - timing.frame_ns(0) - timing.latency * NOMINAL_TICK_NS,
        ):
            while (
                room := timing.room_bytes(timing.fits_bytes(left_ns // NOMINAL_TICK_NS, uint8_fault=False))
            ) > 0:
                sent_bytes += room
                left_ns -= timing.frame_ns(room) + timing.latency * NOMINAL_TICK_NS
        return 8 * sent_bytes * NS_PER_S / (timing.round * NOMINAL_TICK_NS)


MediumSettings = Annotated[
    Ideal | AirTimeMedium | TdmaMedium | CsmaMedium | DelayMedium | ElrsMedium | SikMedium,
    Field(discriminator="model"),
    *own_models("medium", "takes_time", "open", "capacity_bps"),
]


def name_of(settings: Variant) -> str:
    """What a medium, or another choice by name, is called: of one's own by its class."""
    return str(getattr(settings, "model", type(settings).__name__))


def carriers_of(settings: MediumSettings) -> Carriers | None:
    """Where a medium is on the air, one's own too: on the radio's carrier unless it says so; None: nowhere."""
    found: Carriers | None = getattr(settings, "carriers", Carriers)()
    return found
