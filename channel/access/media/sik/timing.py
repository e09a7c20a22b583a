"""Settings and timing of SiK telemetry radios (3DR, Holybro, RFD900): how their firmware, SiK 2.2, reckons in ticks.

Source: ArduPilot/SiK, `Firmware/radio/tdm.c` (`tdm_init`, `flight_time_estimate`) and `radio_446x.c` (frames).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

NOMINAL_TICK_NS: Final = 16_000
"""What the firmware takes a tick for."""
REAL_TICK_NS: Final = 15_673
"""What a tick is: 32 counts of a timer at 24.5 MHz / 12."""
AIR_RATES_KBPS: Final = (2, 4, 8, 16, 19, 24, 32, 48, 64, 96, 128, 192, 250)
TRAILER_BYTES: Final = 2
STATISTICS_BYTES: Final = 4
LEAST_ROOM_BYTES: Final = TRAILER_BYTES + 16
"""No packet is started when fewer bytes than this fit."""
MAX_FRAME_BYTES: Final = 252
LBT_TICKS: Final = 312
"""Listening before talking: 5 ms."""
LINK_TICKS: Final = 32_769
"""Between two looks at the link: "0.5 s", really 0.5136 s."""
UINT8: Final = 256
MAX_CHANNELS: Final = 50

_PREAMBLE_BYTES, _SYNC_BYTES, _NETID_BYTES, _LENGTH_BYTES, _CRC_BYTES = 8, 2, 2, 1, 2
_GOLAY_HEADER_BYTES = 6
"""NETID and length, CRC and length, before they are coded."""
_SIGNATURE_BYTES = 13
_TDM_PREAMBLE_BYTES = 5
"""What windows and silence are reckoned with, whatever the preamble is."""
_TICKS_PER_MS = 62
_TRAILER_MAX = 0x1FFF


@dataclass(frozen=True, slots=True)
class SikTiming:
    """Of one radio, in ticks.

    Attributes:
        air_kbps: on the air.
        ecc: whether frames are coded by Golay(23,12).
        byte: for one byte, as the firmware estimates it.
        latency: for a packet without any byte; also the pause after each packet.
        silence: between windows.
        window: in which one of the two sends.
        max_data_bytes: of users in one frame.
    """

    air_kbps: int
    ecc: bool
    byte: int
    latency: int
    silence: int
    window: int
    max_data_bytes: int

    @property
    def round(self) -> int:
        """Both windows, both silences."""
        return 2 * (self.window + self.silence)

    def flight(self, data_bytes: int) -> int:
        """How long a packet is under way by the firmware's estimate, which is too long by some bytes."""
        return self.latency + (data_bytes + TRAILER_BYTES) * self.byte

    @property
    def framed_bytes(self) -> int:
        """The longest MAVLink 2 packet that is kept whole: the firmware adds 13 B that a signature could take."""
        return min((self.window - self.latency) // self.byte, self.max_data_bytes) - _SIGNATURE_BYTES

    def fits_bytes(self, remaining: int, *, uint8_fault: bool) -> int:
        """How many bytes fit in what is left of a window, before trailer and limits; -1: none.

        With the firmware's fault it is taken modulo 256, as `max_xmit` is a uint8.
        """
        if remaining < self.latency:
            return -1
        fits = (remaining - self.latency) // self.byte
        return fits % UINT8 if uint8_fault else fits

    def room_bytes(self, fits_bytes: int) -> int:
        """How many bytes of users a packet may have, where so many fit."""
        return min(fits_bytes - TRAILER_BYTES - 1, self.max_data_bytes)

    def pause(self, remaining: int) -> int:
        """Ticks until the fault lets a packet start again, where too few bytes fit modulo 256; 0: it does not."""
        wraps = max(remaining - self.latency, 0) // self.byte // UINT8
        return remaining - self.latency - (wraps * UINT8 * self.byte - 1) if wraps else 0

    def frame_bytes(self, data_bytes: int) -> int:
        """All that is on the air."""
        if self.ecc:
            return _PREAMBLE_BYTES + _SYNC_BYTES + 1 + 2 * self.fragile_bytes(data_bytes)
        return _PREAMBLE_BYTES + self.fragile_bytes(data_bytes)

    def fragile_bytes(self, data_bytes: int) -> int:
        """What errors can hit: all after the preamble; with ECC what is coded, before it is."""
        payload_bytes = data_bytes + TRAILER_BYTES
        if self.ecc:
            return _GOLAY_HEADER_BYTES + -(-payload_bytes // 3) * 3
        return _SYNC_BYTES + _NETID_BYTES + _LENGTH_BYTES + payload_bytes + _CRC_BYTES

    @property
    def sync_ns(self) -> int:
        """From the start of a frame until a receiver knows of it: all before the NETID."""
        return (_PREAMBLE_BYTES + _SYNC_BYTES) * 8_000_000 // self.air_kbps

    def frame_ns(self, data_bytes: int) -> int:
        """How long a frame is on the air."""
        return self.frame_bytes(data_bytes) * 8_000_000 // self.air_kbps


def sik_timing(
    air_kbps: int = 64, *, ecc: bool = False, max_window_ms: int = 131, lbt: bool = False
) -> SikTiming:
    """Timing as `tdm_init` works it out, in integers.

    Raises:
        ValueError: a rate that the radio does not have.
    """
    if air_kbps not in AIR_RATES_KBPS:
        raise ValueError(f"air rate {air_kbps} kb/s: one of {', '.join(map(str, AIR_RATES_KBPS))}")
    byte = (8 + 8_000_000 // (air_kbps * 1000)) // 16 + 1
    latency = (_PREAMBLE_BYTES + _TDM_PREAMBLE_BYTES) * byte + 13
    max_data_bytes = MAX_FRAME_BYTES - TRAILER_BYTES
    if ecc:
        max_data_bytes = MAX_FRAME_BYTES // 2 - (_GOLAY_HEADER_BYTES + TRAILER_BYTES)
        byte *= 2
        latency += 4 * byte
    silence = 2 * latency
    window = 3 * (latency + max_data_bytes * byte)
    if lbt:
        window = max(window, 3 * LBT_TICKS)
    window = min(window, max_window_ms * _TICKS_PER_MS, _TRAILER_MAX)
    latency += (_PREAMBLE_BYTES - _TDM_PREAMBLE_BYTES) * byte
    if window < latency + LEAST_ROOM_BYTES * byte:
        raise ValueError(f"a window of {max_window_ms} ms at {air_kbps} kb/s: no packet fits")
    return SikTiming(air_kbps, ecc, byte, latency, silence, window, max_data_bytes)


def hop_order(netid: int, channels: int) -> tuple[int, ...]:
    """The channels in the order in which a network hops over them (`freq_hopping.c`)."""
    order, state = list(range(channels)), netid
    for place in range(channels - 1):
        state = (state * 1_103_515_245 + 12_345) & 0xFFFF_FFFF
        other = ((state >> 16) & 0x7FFF) % UINT8 % channels
        order[place], order[other] = order[other], order[place]
    return tuple(order)


@dataclass(frozen=True, slots=True)
class SikSettings:
    """Of all radios, by the names of their parameters; defaults are the firmware's.

    Attributes:
        air_kbps: AIR_SPEED.
        ecc: ECC: Golay(23,12).
        framing: MAVLINK = 1: packets up to 237 B (less at low rates and with ECC) stay whole; else they are a stream.
        max_window_ms: MAX_WINDOW.
        duty_cycle_percent: DUTY_CYCLE; 100: no limit.
        lbt: LBT_RSSI: whether radios listen before they talk.
        channels: NUM_CHANNELS: 50 at 915 MHz, 10 at 433 and 868.
        uint8_fault: whether the bytes that fit are reckoned modulo 256, as the firmware does.
        tick_ns: how long a tick is: `REAL_TICK_NS`, or `NOMINAL_TICK_NS`, by which the firmware reckons.
        takes_estimate: whether a receiver takes the window in a trailer as it is, which the sender has shortened by too
            long an estimate of the packet's flight, so that windows open early; else what the sender really has left.
        locked: whether the radios of a NETID have found each other before instant 0.
        networks: the nodes of each NETID, two or more; None: the nodes in their order, two by two.
        netids: of these networks; None: 25 (the default of the firmware), 26 and so on.
        phases: (node, ticks since the start of its round at instant 0); others are drawn. Of a locked network all
            follow the first.
    """

    air_kbps: int = 64
    ecc: bool = False
    framing: bool = True
    max_window_ms: int = 131
    duty_cycle_percent: int = 100
    lbt: bool = False
    channels: int = 50
    uint8_fault: bool = True
    tick_ns: int = REAL_TICK_NS
    takes_estimate: bool = False
    locked: bool = True
    networks: tuple[tuple[int, ...], ...] | None = None
    netids: tuple[int, ...] | None = None
    phases: tuple[tuple[int, int], ...] = ()

    def __post_init__(self) -> None:
        if not 1 <= self.channels <= MAX_CHANNELS:
            raise ValueError(f"{self.channels} channels: 1 to {MAX_CHANNELS}")
        if not 0 <= self.duty_cycle_percent <= 100:
            raise ValueError(f"a duty cycle of {self.duty_cycle_percent} %: 0 to 100")
        if not REAL_TICK_NS <= self.tick_ns <= NOMINAL_TICK_NS:
            raise ValueError(
                f"a tick of {self.tick_ns} ns: {REAL_TICK_NS} (real) to {NOMINAL_TICK_NS} (nominal)"
            )

    def timing(self) -> SikTiming:
        """In ticks."""
        return sik_timing(self.air_kbps, ecc=self.ecc, max_window_ms=self.max_window_ms, lbt=self.lbt)
