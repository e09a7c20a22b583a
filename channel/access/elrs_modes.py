"""Modes of ExpressLRS: how long a slot and a packet last, and when a link counts as lost."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from types import MappingProxyType
from typing import Final

from channel.access.reception.carriers import Carriers

SYNC_MS: Final = 5000
"""How often a transmitter that hears its receiver sends a sync packet."""
STATS_BYTES: Final = 4
"""Of link statistics, in the place of data."""
STATS_EVERY_MS: Final = 512
"""How often, at most, a receiver is to send link statistics; this sets the length of bursts."""
LONG_PACKET_BYTES: Final = 13
CHUNK_BYTES, CHUNK_HEAD_BYTES = 62, 2
"""User bytes of a chunk at most, and what goes before them."""
MANY_CHUNKS: Final = 1000
"""Over which the mean number of frames of a chunk is taken."""
LEAST_LOST_MS: Final = 512
LOST_PACKETS: Final = 5
"""So many missed downward packets, or `LEAST_LOST_MS` if that is longer, and a transmitter takes its link for lost."""


@dataclass(frozen=True, slots=True)
class ElrsMode:
    """One mode, by the tables of the firmware (commit 7702d0f, `common.cpp` and `FHSS.cpp`).

    Attributes:
        interval_us: of slots.
        sensitivity_dbm: that the firmware expects; nothing here acts on it, what a packet needs is the world's.
        air_us: of a packet.
        packet_bytes: on the air, 8 or 13.
        hop_slots: slots on one frequency.
        channels: frequencies; one of them is for sync.
        lost_ms: a receiver that hears nothing for longer loses its link.
        sync_lost_ms: how often a transmitter that does not hear its receiver sends a sync packet.
        spacing_hz: between frequencies.
    """

    interval_us: int
    sensitivity_dbm: float
    air_us: int
    packet_bytes: int
    hop_slots: int
    channels: int
    lost_ms: int
    sync_lost_ms: int
    spacing_hz: float = 1e6

    def __post_init__(self) -> None:
        if not (0 < self.air_us < self.interval_us and self.hop_slots > 0 and self.channels > 0):
            raise ValueError(
                f"packets of {self.air_us} us in slots of {self.interval_us} us: shorter, above 0"
            )

    @property
    def carriers(self) -> Carriers:
        """Where it is on the air."""
        return Carriers.centred(self.channels, self.spacing_hz)

    @property
    def bit_rate_bps(self) -> float:
        """Of a packet, with all that is on the air before and behind it."""
        return 8e6 * self.packet_bytes / self.air_us

    @property
    def data_bytes(self) -> int:
        """That a packet carries."""
        return 10 if self.packet_bytes == LONG_PACKET_BYTES else 5

    @property
    def burst(self) -> int:
        """Data packets of a receiver between two with link statistics, at a telemetry ratio of 1:2."""
        return max(1, STATS_EVERY_MS * (1_000_000 // self.interval_us) // 2 // 1000 - 1)

    @property
    def down_bytes_per_s(self) -> float:
        """Room in data packets at a telemetry ratio of 1:2, as the firmware tells its users.

        `TXModuleParameters.cpp`, `updateTlmBandwidth`: data packets a second times their bytes. What chunks need of it
        for themselves is not taken off; `user_bytes_per_s` has that.
        """
        return self.data_bytes * (1_000_000 // self.interval_us) / 2 * self.burst / (self.burst + 1)

    @property
    def user_bytes_per_s(self) -> float:
        """Of a stream down, in full chunks, if nothing is lost and no sync comes."""
        return CHUNK_BYTES / (_frames_of_a_chunk(self.data_bytes, self.burst) * 2e-6 * self.interval_us)

    def user_bytes_up_per_s(self, *, has_rc: bool) -> float:
        """The same of a stream up; a remote control takes every second slot of it."""
        frames = math.ceil((CHUNK_BYTES + CHUNK_HEAD_BYTES) / self.data_bytes)
        return CHUNK_BYTES / (frames * (4e-6 if has_rc else 2e-6) * self.interval_us)

    @property
    def lost_down_ms(self) -> int:
        """A transmitter that hears nothing for longer takes its link for lost."""
        return max(LEAST_LOST_MS, 2 * self.interval_us * LOST_PACKETS // 1000) + 2


@cache
def _frames_of_a_chunk(data_bytes: int, burst: int) -> float:
    """How many frames down a full chunk takes in the mean: one after each burst has statistics, and less room."""
    frames = 0
    for _ in range(MANY_CHUNKS):
        left_bytes = CHUNK_BYTES + CHUNK_HEAD_BYTES
        while left_bytes > 0:
            left_bytes -= data_bytes - (STATS_BYTES if frames % (burst + 1) == burst else 0)
            frames += 1
    return frames / MANY_CHUNKS


GHZ_24, FCC_915 = 80, 40
"""Frequencies of the bands at 2.4 GHz and, of those about 900 MHz, of FCC 915; EU 868 has 13.

They are 2400.4 to 2479.4 MHz, and 903.5 to 926.9 MHz.
"""
FCC_915_SPACING_HZ: Final = 600e3
ELRS_MODES: Final = MappingProxyType(
    {
        "flrc-1000": ElrsMode(1_000, -104.0, 389, 8, 2, GHZ_24, 2500, 3),
        "lora-500": ElrsMode(2_000, -105.0, 1_507, 8, 4, GHZ_24, 2500, 3),
        "lora-333-full": ElrsMode(3_003, -105.0, 2_374, 13, 4, GHZ_24, 2500, 4),
        "lora-150": ElrsMode(6_666, -112.0, 5_871, 8, 4, GHZ_24, 3500, 10),
        "lora-50": ElrsMode(20_000, -115.0, 10_798, 8, 2, GHZ_24, 4000, 0),
        "900-200": ElrsMode(5_000, -112.0, 4_380, 8, 4, FCC_915, 3000, 600, FCC_915_SPACING_HZ),
        "900-100-full": ElrsMode(10_000, -112.0, 6_690, 13, 4, FCC_915, 3500, 600, FCC_915_SPACING_HZ),
        "900-25": ElrsMode(40_000, -123.0, 29_950, 8, 2, FCC_915, 6000, 600, FCC_915_SPACING_HZ),
    }
)
"""By band or modulation, and packets per second: SX1280 at 2.4 GHz, SX127x at 900 MHz.

LR1121 has the same numbers but for FLRC, which it lacks (its FSK 1000 has 690 us and -103 dBm); LR2021 has all.
"""
