"""Emitters that nothing in a run hears, and sensors that hear none."""

from __future__ import annotations

from collections.abc import Iterator

from bridge.scenario.model import Scenario
from bridge.scenario.resolve.radio import radios_of
from bridge.scenario.resolve.sensing import emitters_of, sensors_of
from channel.sensing.sensor import Sensor


def unheard(scenario: Scenario) -> Iterator[str]:
    """Warnings: emitters of which no radio's filter and no sensor's band has anything; sensors that measure none."""
    emitters = emitters_of(scenario)
    if not emitters:
        return
    radios = [
        radio for name in scenario.network_names for radio in radios_of(scenario, emitters, name).values()
    ]
    sensors = {node: Sensor(config) for node, config in sensors_of(scenario).items()}
    heard = {each.name for radio in radios for each in radio.emitters}
    for emitter in emitters:
        if emitter.name in heard or any(sensor.hears(emitter.frequency_hz) for sensor in sensors.values()):
            continue
        carriers = sorted({radio.config.frequency_hz for radio in radios})
        yield (
            f"emitter {emitter.name} at {emitter.frequency_hz / 1e6:g} MHz is heard by no radio and no sensor; radios "
            f"are at {', '.join(f'{carrier / 1e6:g}' for carrier in carriers)} MHz"
        )
    deaf: dict[tuple[float, float], list[str]] = {}
    for node, sensor in sensors.items():
        if not any(sensor.hears(emitter.frequency_hz) for emitter in emitters):
            deaf.setdefault(sensor.band_hz, []).append(node)
    for (low_hz, high_hz), nodes in deaf.items():
        band = f"{low_hz / 1e6:g} to {high_hz / 1e6:g} MHz (sensor.band_hz)"
        yield f"sensor of node {', '.join(nodes)}: no emitter has its frequency in its band, {band}"
