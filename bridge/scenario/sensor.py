"""The RF sensor of a node, as a scenario has it."""

from __future__ import annotations

from bridge.scenario.parts import RadioSetting
from channel.sensing.settings import SensorSettings

DEFAULT_RADIO = "rf-sensor"


class RfSensor(SensorSettings):
    """A sensor; its radio is a preset's name, a file or a mapping, as those of nodes are."""

    radio: RadioSetting = DEFAULT_RADIO
