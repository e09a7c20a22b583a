"""Sensors and emitters at places, measured tick by tick."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

import numpy as np

from channel.link.emitters.emitter import Emitter
from channel.presets import radio_from_mapping
from channel.sensing.measured import NOTHING, Measured, Places
from channel.sensing.sensing import Sensing
from channel.sensing.sensor import SensorConfig

TICK_NS = 50_000_000
CARRIER_HZ = 433.92e6
PLAIN = {"fading": {"model": "none"}, "shadowing": {"model": "none"}}
"""Of a radio: neither shadowing nor fading."""
Point = tuple[float, float, float]


def config(radio: Mapping[str, object] | None = None, **settings: object) -> SensorConfig:
    """A sensor: the preset with changes to its radio, at every tick and in fine steps unless told otherwise."""
    changed = radio_from_mapping({"preset": "rf-sensor"} | dict(radio or {}))
    return SensorConfig(radio=changed, **{"rate_hz": 20.0, "step_db": 0.001} | settings)


def emitter(name: str = "beacon", **changes: object) -> Emitter:
    """An emitter of 20 dBm on the sensor's carrier."""
    return Emitter(**{"name": name, "frequency_hz": CARRIER_HZ, "power_dbm": 20.0} | changes)


def law_dbm(
    distance_m: np.ndarray, power_dbm: float | np.ndarray = 20.0, frequency_hz: float = CARRIER_HZ
) -> np.ndarray:
    """The preset's mean power by its closed form: free space to 1 m, then exponent 2.2."""
    first_m_db = 20.0 * np.log10(4.0 * np.pi * frequency_hz / 299_792_458.0)
    return power_dbm - first_m_db - 22.0 * np.log10(distance_m)


def measured(
    sensors: Mapping[str, SensorConfig],
    emitters: Sequence[Emitter],
    ways: Mapping[str, np.ndarray],
    *,
    seed: int = 1,
    ticks: int = 1,
    bases: Collection[str] = (),
) -> Measured:
    """All measurements of a flight.

    Args:
        sensors: by node.
        emitters: in order.
        ways: of sensors and emitters by name: a place, or one for each tick.
        seed: of the run.
        ticks: how many.
        bases: sensors on the ground.
    """
    sensing = Sensing(sensors, emitters, seed=seed, bases=bases)
    tracks = {name: np.broadcast_to(way, (ticks, 3)) for name, way in ways.items()}
    found = []
    for tick in range(ticks):
        here = Places(np.array([tracks[node][tick] for node in sensors]))
        there = Places(np.array([tracks[each.name][tick] for each in emitters]).reshape(-1, 3))
        found.append(sensing.measure(tick * TICK_NS, here, there))
    parts = [each for each in found if each.size] or [NOTHING]
    return Measured(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))


def told(found: Measured, sensors: Sequence[str], emitters: Sequence[Emitter]) -> dict[tuple, tuple]:
    """What was measured, by node, emitter and number; numbers to more places than the record has."""
    return {
        (sensors[s], emitters[e].name, number): tuple(round(each, 6) for each in rest)
        for s, e, number, *rest in zip(*(column.tolist() for column in found), strict=True)
    }
