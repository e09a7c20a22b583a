"""What happens to the UA of an exchange, besides stepping."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum, unique

from fdm.wire.sensor_frame import SensorFrame


@unique
class EventKind(Enum):
    """Kinds of events."""

    JOINED = "joined"
    """The autopilot sent its first packet."""
    RESTARTED = "restarted"
    """The autopilot booted anew; the UA is back at its home."""
    ABSENT = "absent"
    """The autopilot had sent nothing when the start timeout passed; the fleet starts without it."""
    STALLED = "stalled"
    """The autopilot stopped answering; nobody waits for it any more."""
    RETURNED = "returned"
    """A stalled autopilot answers again; it goes on where it was, at the fleet's present time."""
    SILENT = "silent"
    """The autopilot takes frames and answers none; it is served on."""
    REFUSED = "refused"
    """The autopilot cannot be flown in lockstep; its connection is served no more."""
    REPLACED = "replaced"
    """Another autopilot took the place of one that still sends to the UA's port; it is served on."""
    DIVERGED = "diverged"
    """The flight model left the plausible range; the UA is out until its autopilot boots anew."""


@dataclass(frozen=True, slots=True)
class UaEvent:
    """One event.

    Attributes:
        kind: what happened.
        ua_id: to which UA.
        sim_time_ns: fleet sim time of that UA.
        detail: for people.
        last_frame: the last sensor frame that was sent; None if none was.
    """

    kind: EventKind
    ua_id: int
    sim_time_ns: int
    detail: str = ""
    last_frame: SensorFrame | None = None
