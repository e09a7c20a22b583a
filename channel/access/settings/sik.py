"""SiK telemetry radios: ``medium: {model: sik}``."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import lru_cache
from itertools import count, islice
from typing import Annotated, Final, Literal

from pydantic import Field, model_validator

from channel.access.media.medium import AccessMedium
from channel.access.media.sik.medium import DEFAULT_NETID, LEAST_RADIOS, UNLIMITED_BYTES, Sik
from channel.access.media.sik.timing import (
    AIR_RATES_KBPS,
    NOMINAL_TICK_NS,
    REAL_TICK_NS,
    SikSettings,
    SikTiming,
    sik_timing,
)
from channel.access.packets import AirFate, AirPacket
from channel.access.queue import QueueLimits
from channel.access.reception.carriers import Carriers
from channel.access.settings.base import Locking, Queue, Surroundings, two_by_two
from channel.access.settings.slots import Ids
from channel.access.timing import NS_PER_S
from channel.access.world import PlainWorld

START_ROUNDS: Final = 10
LIMITED_START_ROUNDS: Final = 40
"""A pair that is tried for what it carries is in its stride then, the second where its duty cycle has a limit."""
ROUNDS: Final = 2 * START_ROUNDS, 100 * START_ROUNDS
TRIED: Final = 100
"""After its start it is tried for so many rounds, at least and at most, until so many packets have come."""
NO_LIMIT_PERCENT: Final = 100


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

    @property
    def listens_first(self) -> bool:
        """With LBT_RSSI."""
        return self.lbt

    @property
    def max_length_bytes(self) -> int:
        """The longest packet."""
        return self.queue.length_bytes or UNLIMITED_BYTES

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
        """Bits of packets of a length per second, if both of a pair always have one, as the medium carries them."""
        return _carried_bps(self._settings(lambda _: 0), length_bytes, senders=2)

    def node_capacity_bps(self, length_bytes: int) -> float:
        """The same of one of a pair whose other has nothing: its own windows, and what is yielded to it."""
        return _carried_bps(self._settings(lambda _: 0), length_bytes, senders=1)


@lru_cache(maxsize=4096)
def _carried_bps(settings: SikSettings, length_bytes: int, senders: int) -> float:
    """What comes over between two radios of which some always have a packet, once they are in their stride."""
    pair = replace(settings, networks=None, netids=None, locked=True)
    round_ns = pair.timing().round * pair.tick_ns
    most = pair.air_kbps * 1000 * round_ns // (8 * length_bytes * NS_PER_S) + 1
    medium = Sik(PlainWorld(range(2)), pair, limits=QueueLimits(0, 0))
    numbers, waiting = count(), [0] * senders

    def came_within(rounds: range) -> int:
        """How many packets; each sender has more than fill a round."""
        came = 0
        for each in rounds:
            for node in range(senders):
                for number in islice(numbers, most - waiting[node]):
                    medium.offer(AirPacket(node, number, None, length_bytes, each * round_ns))
                waiting[node] = most
            for one in medium.run((each + 1) * round_ns):
                if isinstance(one, AirFate):
                    waiting[one.packet.node] -= 1
                    came += one.loss is None
        return came

    begin = START_ROUNDS if pair.duty_cycle_percent == NO_LIMIT_PERCENT else LIMITED_START_ROUNDS
    came_within(range(begin))
    least, longest = ROUNDS
    came = tried = 0
    while not tried or (came < TRIED and tried < longest):
        came += came_within(range(begin + tried, begin + tried + least))
        tried += least
    return 8 * length_bytes * came * NS_PER_S / (tried * round_ns)
