"""What fdm raises. All are mistakes of the caller or of data files; nothing received from a socket raises.

FdmError
 +-- AirframeError       an airframe file or its JSBSim model is wrong
 +-- WindError           a wind file or wind map is wrong, or a UA left its map
 +-- WeatherError        a UA starts where no temperature and pressure can be set
 +-- SensorNoiseError    a file of sensor errors is wrong
 +-- PortInUseError      a UDP port cannot be bound
 +-- WorkerError         a worker process ended
 +-- ModelDivergedError  a flight model gave what cannot be (the exchange ends that UA and goes on)
"""

from __future__ import annotations


class FdmError(Exception):
    """Base of all errors of fdm; its text is meant for the user."""


class AirframeError(FdmError):
    """An airframe file, or the JSBSim model that it names, cannot be used."""


class WindError(FdmError):
    """A wind cannot be used, or a UA is outside a wind map that forbids it."""


class WeatherError(FdmError):
    """Temperature and pressure cannot be set where a UA starts."""


class SensorNoiseError(FdmError):
    """A file of sensor errors cannot be used."""


class PortInUseError(FdmError):
    """A UDP port cannot be bound.

    Attributes:
        port: the port's number.
    """

    def __init__(self, message: str, port: int) -> None:
        super().__init__(message)
        self.port = port


class WorkerError(FdmError):
    """A worker process of a fleet ended by itself; the text says which and how."""


class ModelDivergedError(FdmError):
    """A flight model gave a value that is not finite, or left every plausible range."""
