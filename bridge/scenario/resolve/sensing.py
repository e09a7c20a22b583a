"""From what a scenario names to the objects of the channel: RF sensors and emitters.

Apart from `resolve`, as the channel takes its time to import.
"""

from __future__ import annotations

from bridge.scenario import nodes
from bridge.scenario.model import Scenario
from bridge.scenario.resolve.radio import radio_from
from bridge.scenario.sections import Origin
from bridge.scenario.sensor import RfSensor
from channel.link.emitters.emission import Emission
from channel.link.emitters.emitter import Emitter
from channel.sensing.sensor import SensorConfig
from channel.sensing.settings import SensorSettings


def emitters_of(scenario: Scenario) -> tuple[Emitter, ...]:
    """The emitters of a scenario.

    Raises:
        ValidationError: an antenna is none.
    """
    return tuple(emitter_of(node) for node in scenario.emitters)


def emitter_of(node: nodes.EmitterNode) -> Emitter:
    """An emitter as the channel has it.

    Raises:
        ValidationError: its antenna is none.
    """
    emission = {name: getattr(node, name) for name in Emission.model_fields}
    return Emitter.model_validate({"name": node.id, "antenna": node.antenna} | emission)


def sensors_of(scenario: Scenario) -> dict[str, SensorConfig]:
    """The sensor of each node that has one.

    Raises:
        PresetError: there is no such radio preset, or a key or value is wrong.
    """
    return {
        node.node: sensor_of(node.sensor, scenario.origin)
        for node in scenario.transceivers
        if node.sensor is not None
    }


def sensor_of(sensor: RfSensor, origin: Origin) -> SensorConfig:
    """A sensor as the channel has it.

    Raises:
        PresetError: there is no such radio preset, or a key or value is wrong.
    """
    settings = {name: getattr(sensor, name) for name in SensorSettings.model_fields}
    return SensorConfig(radio=radio_from(sensor.radio, origin).config, **settings)
