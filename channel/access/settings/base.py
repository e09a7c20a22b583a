"""What the settings of several media have in common."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, Literal, NamedTuple, Protocol

from pydantic import Field

from channel.access.air import Hearing
from channel.access.queue import QueueLimits
from channel.access.reception.carriers import Carriers
from channel.access.reception.leaks import Leaks
from channel.access.timing import NS_PER_S, BitRate
from channel.access.world import World
from channel.numbers.units import ratio_from_db
from channel.phy.spectrum import Rows, captured_db, reaches
from channel.variant import Variant
from sitl_configs.settings import Settings

ENERGY_OVER_PREAMBLE_DB = 20.0
"""IEEE 802.11-2020, 17.3.10.6: energy alone makes a medium busy 20 dB above the least sensitivity."""


class RadioOnAir(NamedTuple):
    """A node's radio as media see it.

    Attributes:
        bit_rate_bps: at which it transmits.
        bandwidth_hz: of what it transmits.
        filter_rows: of its receiver (`channel.phy.spectrum`).
    """

    bit_rate_bps: float
    bandwidth_hz: float
    filter_rows: Rows


class OnAirConfig(Protocol):
    """A configuration of a radio (`channel.config.RadioConfig`)."""

    @property
    def on_air(self) -> RadioOnAir:
        """As media see it."""


@dataclass(frozen=True, slots=True)
class Surroundings:
    """What a medium is opened in.

    Attributes:
        world: its nodes, and what lies between them.
        nodes: the place of each id among them.
        seed: of the run.
        noise_floor_dbm: of the quietest receiver.
        radios: of each node, by its place.
    """

    world: World
    nodes: Mapping[str, int]
    seed: int
    noise_floor_dbm: float
    radios: Mapping[int, RadioOnAir]

    @classmethod
    def of(
        cls,
        world: World,
        nodes: Mapping[str, int],
        seed: int,
        configs: OnAirConfig | Mapping[str, OnAirConfig],
        noise_floor_dbm: float,
    ) -> Surroundings:
        """Those of nodes with one radio for all, or one each."""
        if isinstance(configs, Mapping):
            known = {id(config): config.on_air for config in configs.values()}
            radios = {place: known[id(configs[node])] for node, place in nodes.items()}
        else:
            radios = dict.fromkeys(nodes.values(), configs.on_air)
        return cls(world, nodes, seed, noise_floor_dbm, radios)

    @property
    def bit_rate_bps(self) -> float:
        """Of all radios.

        Raises:
            ValueError: they have several.
        """
        rates_bps = {node: self.radios[place].bit_rate_bps for node, place in self.nodes.items()}
        (first, rate_bps), *_ = rates_bps.items()
        for node, other_bps in rates_bps.items():
            if other_bps != rate_bps:
                raise ValueError(
                    f"medium: it has one bit rate for all, and node {first} has {rate_bps:g} bit/s, "
                    f"node {node} {other_bps:g} bit/s"
                )
        return rate_bps

    def leaks(self, spacing_hz: float, count: int) -> Leaks:
        """The shares of power that receivers take in from signals 1, 2, ... ``count`` channels away."""
        kinds = list(dict.fromkeys(self.radios.values()))
        return Leaks(
            {node: kinds.index(radio) for node, radio in self.radios.items()},
            tuple(tuple(_leaks(tx, rx, spacing_hz, count) for rx in kinds) for tx in kinds),
        )

    def place(self, node: str) -> int:
        """The place of an id.

        Raises:
            ValueError: there is no such node.
        """
        if node not in self.nodes:
            raise ValueError(f"medium: node {node} is not there; there are {', '.join(self.nodes)}")
        return self.nodes[node]


def _leaks(tx: RadioOnAir, rx: RadioOnAir, spacing_hz: float, count: int) -> tuple[float, ...]:
    """The shares of one's power that another takes in, 1, 2, ... ``count`` channels away."""
    found = []
    for distance in range(1, count + 1):
        offset_hz = distance * spacing_hz
        if not reaches(offset_hz, tx.bandwidth_hz, rx.filter_rows):
            break
        found.append(float(ratio_from_db(captured_db(offset_hz, tx.bandwidth_hz, rx.filter_rows))))
    return tuple(found)


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
    """Whether `capacity_bps` is for all nodes that hear each other together; else each sender has so much."""
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

    @property
    def listens_first(self) -> bool:
        """Whether a node waits with what it has while it senses a carrier."""
        return False

    def locks_from_dbm(self, noise_floor_dbm: float) -> float:
        """The weakest signal that receivers lock on to, dBm, with the noise floor of the quietest of them."""
        return noise_floor_dbm if self.preamble_dbm is None else self.preamble_dbm

    def senses_from_dbm(self, noise_floor_dbm: float) -> float:
        """The weakest power that is sensed as a carrier whatever it is, dBm, likewise."""
        if self.energy_dbm is not None:
            return self.energy_dbm
        return self.locks_from_dbm(noise_floor_dbm) + ENERGY_OVER_PREAMBLE_DB

    def hearing(self, surroundings: Surroundings) -> Hearing:
        """How receivers hear."""
        floor_dbm = surroundings.noise_floor_dbm
        preamble_dbm, energy_dbm = self.locks_from_dbm(floor_dbm), self.senses_from_dbm(floor_dbm)
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
        default=None,
        gt=0.0,
        le=1e12,
        description="on the air, of all nodes; that of each one's radio unless given",
    )
    preamble_s: float = Field(default=0.0, ge=0.0, le=1.0, description="before each frame")
    header_bytes: int = Field(default=0, ge=0, le=1000, description="that each packet gets")
    max_length_bytes: int = Field(default=65_535, ge=1, description="the longest packet")

    def timings(self, surroundings: Surroundings) -> dict[int, BitRate]:
        """Of frames, by who transmits them."""
        return {node: self._timing_at(radio.bit_rate_bps) for node, radio in surroundings.radios.items()}

    def timing(self, surroundings: Surroundings) -> BitRate:
        """Of frames, whoever transmits them.

        Raises:
            ValueError: radios of several bit rates, and none for all.
        """
        return self._timing_at(surroundings.bit_rate_bps if self.bit_rate_bps is None else self.bit_rate_bps)

    def _timing_at(self, radio_bps: float) -> BitRate:
        rate_bps = radio_bps if self.bit_rate_bps is None else self.bit_rate_bps
        return BitRate(rate_bps, round(self.preamble_s * NS_PER_S), self.header_bytes, self.max_length_bytes)

    def capacity_bps(self, length_bytes: int, bit_rate_bps: float) -> float:
        """Bits of packets of a length per second, if one sender sends them back to back."""
        return 8 * length_bytes / self.duration_s(length_bytes, bit_rate_bps)

    def duration_s(self, length_bytes: int, bit_rate_bps: float) -> float:
        """Of a frame, on a radio of that bit rate."""
        rate_bps = bit_rate_bps if self.bit_rate_bps is None else self.bit_rate_bps
        return self.preamble_s + 8 * (length_bytes + self.header_bytes) / rate_bps


def two_by_two(nodes: Sequence[str]) -> tuple[tuple[str, ...], ...]:
    """Nodes in pairs, in their order; the last of an odd number is left out."""
    return tuple(zip(nodes[::2], nodes[1::2], strict=False))
