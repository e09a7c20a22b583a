"""What the vehicle asks of the flight mode that flies it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from enum import Enum, IntEnum, auto

from standin.control.navigator import FlightLimits
from standin.vehicle.mission import SpeedKind


class ModeNumber(IntEnum):
    """ArduCopter's custom_mode."""

    STABILIZE = 0
    AUTO = 3
    GUIDED = 4
    LOITER = 5
    RTL = 6
    LAND = 9
    BRAKE = 17


class Drive(Enum):
    """What the motors do between two decisions of the mode."""

    IDLE = auto()
    SPOOL = auto()
    """Level, at the throttle given."""
    FOLLOW = auto()
    """Follow the navigator's references."""


class FlightMode(ABC):
    """One flight mode, made anew each time it is entered."""

    number: ModeNumber
    armable = True
    needs_mission = False
    guided_flag = True
    """Whether the heartbeat carries MAV_MODE_FLAG_GUIDED_ENABLED."""
    only_one_of: frozenset[SpeedKind] = frozenset()
    """Speeds that may be asked for of which each ends the others."""

    @property
    def name(self) -> str:
        """ArduCopter's name of the mode."""
        return self.number.name

    @abstractmethod
    def refusal(self) -> str:
        """Return why an armed vehicle cannot enter the mode now; empty if it can."""

    def enter(self) -> None:  # noqa: B027
        """Begin: the navigator has just been commanded to stop where the vehicle is."""

    def limits(self, limits: FlightLimits) -> FlightLimits:
        """Return the limits that it flies with, from those of the parameters."""
        return limits

    @abstractmethod
    def update(self, step_s: float) -> None:
        """Decide the drive and the target; ``step_s`` since the last call."""

    def touched_ground(self) -> None:  # noqa: B027
        """The vehicle was found standing; its motors are idle now."""
