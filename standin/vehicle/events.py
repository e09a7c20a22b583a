"""What the vehicle reports to the ground unasked; the MAVLink side turns these into messages."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum


class Severity(IntEnum):
    """MAV_SEVERITY, as far as it is used."""

    CRITICAL = 2
    WARNING = 4
    INFO = 6


@dataclass(frozen=True, slots=True)
class TextEvent:
    """A line for people."""

    severity: Severity
    text: str


@dataclass(frozen=True, slots=True)
class ItemReached:
    """A mission item was reached."""

    seq: int


@dataclass(frozen=True, slots=True)
class HomeChanged:
    """Home was set."""


@dataclass(frozen=True, slots=True)
class ModeChanged:
    """The flight mode or the arming state changed: the heartbeat should not wait."""


Event = TextEvent | ItemReached | HomeChanged | ModeChanged
