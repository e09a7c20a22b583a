"""A setting by lostlink."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from functools import lru_cache
from math import inf

from benchmarks.channel.ns3.settings import Count, Counts, Place, Setting
from channel.access.air import Hearing
from channel.access.media.csma import Csma, DcfSettings
from channel.access.packets import AirFate, AirFrame, AirPacket
from channel.access.queue import QueueLimits
from channel.access.timing import NS_PER_S, Wifi, wifi_a, wifi_b
from channel.access.trial import Load, instants
from channel.access.world import Arrival, Piece, PlainWorld, World
from channel.link.radio import Radio
from channel.network.radio_world import RadioWorld
from channel.numbers.units import ratio_from_db
from channel.presets import radio_from_mapping

AFTER_S = 2.0
"""For what waits when the last packet has entered."""
CLOSE_DELAY_NS = 3
CCA_NS = 4_000
"""ns-3 takes so long to detect a preamble."""
STEP_M = 1.0
"""In which a moving node goes on."""
HEIGHT_M = 40.0


class CountingWorld:
    """A world that counts the frames with packets in them, by sender and part."""

    def __init__(self, world: World, setting: Setting) -> None:
        self.nodes, self._world, self._setting = world.nodes, world, setting
        self.survives, self.comes_alone = world.survives, world.comes_alone
        self.transmitted: dict[tuple[int, int], int] = defaultdict(int)

    def reach(self, frame: AirFrame) -> Sequence[Arrival]:
        if frame.packet is not None:
            self.transmitted[key_of(frame.packet, self._setting)] += 1
        return self._world.reach(frame)


class MovingWorld:
    """A world whose last node moves along x, in steps: during a frame all stand still."""

    def __init__(self, setting: Setting, seed: int) -> None:
        self.nodes = tuple(range(len(setting.places_m)))
        self._setting, self._seed, self._radio = setting, seed, radio_of(setting)
        self._after = lru_cache(maxsize=None)(self._world_after)

    def reach(self, frame: AirFrame) -> Sequence[Arrival]:
        return self._at(frame).reach(frame)

    def survives(
        self, frame: AirFrame, receiver: int, power_mw: float, pieces: Sequence[Piece]
    ) -> tuple[bool, bool]:
        return self._at(frame).survives(frame, receiver, power_mw, pieces)

    def comes_alone(self, frame: AirFrame, receiver: int, power_mw: float) -> bool:
        return self._at(frame).comes_alone(frame, receiver, power_mw)

    def _at(self, frame: AirFrame) -> RadioWorld:
        return self._after(round(self._setting.speed_mps * frame.started_ns / NS_PER_S / STEP_M))

    def _world_after(self, steps: int) -> RadioWorld:
        *still, (x, y) = self._setting.places_m
        return RadioWorld(self._radio, placed([*still, (x + steps * STEP_M, y)]), self._seed)


def placed(places_m: Sequence[Place]) -> dict[int, tuple[float, float, float]]:
    return {node: (x, y, -HEIGHT_M) for node, (x, y) in enumerate(places_m)}


def radio_of(setting: Setting) -> Radio:
    return Radio(
        radio_from_mapping(
            {
                "name": "ns3",
                "frequency_hz": 5.18e9,
                "bandwidth_hz": 20e6,
                "bit_rate_bps": 1e6 * setting.rate_mbps,
                "transmit_power_dbm": setting.transmit_dbm,
                "earth_radius_factor": None,
                "propagation": {
                    "model": "log-distance",
                    "exponent": setting.exponent,
                    "reference_loss_db": 46.6777,
                },
                "noise": {"model": "thermal", "noise_figure_db": 7.0},
                "error": {"model": "ofdm-nist", "rate_mbps": int(setting.rate_mbps)},
            }
        )
    )


def world_of(setting: Setting, seed: int) -> World:
    if setting.received_dbm is not None:
        power_mw = float(ratio_from_db(setting.received_dbm))
        return PlainWorld(range(len(setting.places_m)), power_mw=power_mw, delay_ns=CLOSE_DELAY_NS, seed=seed)
    if setting.speed_mps:
        return MovingWorld(setting, seed)
    return RadioWorld(radio_of(setting), placed(setting.places_m), seed)


def timing_of(setting: Setting) -> Wifi:
    """Broadcasts at the rate of data; acknowledgements at 6 Mb/s, or at 11: what ns-3 answers with."""
    basic_mbps = setting.rate_mbps if setting.to is None or setting.is_b else 6.0
    return (wifi_b if setting.is_b else wifi_a)(setting.rate_mbps, basic_mbps)


def run(setting: Setting, seed: int) -> Counts:
    """One seed of a setting."""
    world = CountingWorld(world_of(setting, seed), setting)
    hearing = Hearing(
        *(float(ratio_from_db(dbm)) for dbm in (setting.preamble_dbm, setting.energy_dbm)),
        capture=float(ratio_from_db(setting.capture_db)) if setting.capture_db < inf else inf,
        cca_ns=CCA_NS,
    )
    rts_from_bytes = 0 if setting.rts else None
    settings = DcfSettings(uses_eifs=setting.uses_eifs, rts_from_bytes=rts_from_bytes)
    medium = Csma(
        world, timing_of(setting), seed=seed, settings=settings, limits=QueueLimits(0), hearing=hearing
    )
    offered: dict[tuple[int, int], int] = defaultdict(int)
    for packet in packets(setting, seed):
        medium.offer(packet)
        offered[key_of(packet, setting)] += 1
    until_s = setting.seconds + (AFTER_S if setting.a_second else 0.0)
    fates = [one for one in medium.run(int(until_s * NS_PER_S)) if isinstance(one, AirFate)]
    if not setting.a_second and not all(medium.queued(node)[0] for node in setting.senders):
        raise RuntimeError("not saturated to the end")
    delays = defaultdict(list)
    for fate in fates:
        if fate.receiver == setting.observer and fate.loss is None:
            delays[key_of(fate.packet, setting)].append((fate.at_ns - fate.packet.at_ns) / NS_PER_S)
    return {
        key: Count(count, world.transmitted[key], len(delays[key]), sum(delays[key]))
        for key, count in offered.items()
    }


def key_of(packet: AirPacket, setting: Setting) -> tuple[int, int]:
    part = int(packet.at_ns / NS_PER_S / setting.seconds * setting.parts)
    return packet.node, min(part, setting.parts - 1)


def packets(setting: Setting, seed: int) -> list[AirPacket]:
    """What enters the radios: at random, or more than they can send."""
    bytes_, to, found = setting.length_bytes, setting.to, []
    for node in setting.senders:
        if setting.a_second:
            load = Load(8.0 * bytes_ * setting.a_second, bytes_, to, setting.seconds, seed)
            times = instants(node, setting.a_second, load)
        else:
            frame_s = timing_of(setting).duration_ns(bytes_) / NS_PER_S
            times = [0] * int(1.6 * setting.seconds / frame_s / len(setting.senders) + 100)
        found += [AirPacket(node, number, to, bytes_, at_ns) for number, at_ns in enumerate(times)]
    return found
