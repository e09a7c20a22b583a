"""Emitters that nothing in a run hears."""

from __future__ import annotations

from collections.abc import Iterator

from bridge.scenario.model import Scenario
from bridge.scenario.resolve.radio import radios_of
from bridge.scenario.resolve.sensing import emitters_of, sensors_of
from channel.sensing.sensor import Sensor


def unheard(scenario: Scenario) -> Iterator[str]:
    """Warnings: of emitters whose spectrum is in no receiver's filter, and whose carrier in no sensor's band."""
    emitters = emitters_of(scenario)
    if not emitters:
        return
    radios = [
        radio for name in scenario.network_names for radio in radios_of(scenario, emitters, name).values()
    ]
    sensors = [Sensor(config) for config in sensors_of(scenario).values()]
    heard = {each.name for radio in radios for each in radio.emitters}
    for emitter in emitters:
        if emitter.name in heard or any(sensor.hears(emitter.frequency_hz) for sensor in sensors):
            continue
        carriers = sorted({radio.config.frequency_hz for radio in radios})
        yield (
            f"emitter {emitter.name} at {emitter.frequency_hz / 1e6:g} MHz is heard by no radio and no sensor; radios "
            f"are at {', '.join(f'{carrier / 1e6:g}' for carrier in carriers)} MHz"
        )
