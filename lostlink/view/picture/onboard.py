"""What a UA's autopilot has on board and says, by the MAVLink that was recorded: home, mission, fence, messages.

A plain class that is fed with frames; no I/O, no clock. Nothing is asked of an autopilot for it.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final

from aps.timeouts import REBOOT_STEP_MS
from aps.vehicle.missions.items import MissionItem
from aps.vehicle.missions.overheard import OVERHEARD, Overheard
from aps.vehicle.status_text import STATUSTEXT_ID, StatusText, StatusTextAssembler
from aps.vehicle.telemetry import CLOCKS
from aps.wire.dialect import ARDUPILOT, AUTOPILOT_COMPID, enum_label, mavlink, message_fields
from aps.wire.framer import Frame

TEXTS_KEPT: Final = 200
_HEARTBEAT, _SYS_STATUS, _GPS_RAW, _CURRENT, _COMMAND_INT, _HOME = 0, 1, 24, 42, 75, 242
_REPOSITION: Final = int(mavlink.MAV_CMD_DO_REPOSITION)
_TOLD: Final = {
    _HEARTBEAT: slice(5, 6),  # autopilot
    _SYS_STATUS: slice(30, 31),  # battery_remaining
    _GPS_RAW: slice(28, 30),  # fix_type, satellites_visible
    _CURRENT: slice(0, 6),
    _HOME: slice(0, 12),  # latitude, longitude, altitude
}
"""Messages that come again and again, and the bytes of their payloads that matter here."""
_WRAPPED_MS: Final = 1 << 31
"""A clock of 32 bits that falls by more than this began anew without a reboot."""
Fields = Mapping[str, Any]
Earth = tuple[float, float, float]
"""Latitude, longitude, degrees; height above mean sea level, m."""


@dataclass(frozen=True, slots=True)
class AutopilotText:
    """A STATUSTEXT: when it came, MAV_SEVERITY (0 emergency ... 7 debug), and what it says."""

    sim_time_ns: int
    severity: int
    text: str


class Sieve:
    """Lets through the frames that change what is on board: of a message that repeats itself, the first.

    Of those that carry the autopilot's clock, the one that shows a reboot.
    """

    def __init__(self) -> None:
        self._last: dict[int, bytes] = {}
        self._clock_ms = 0

    def is_news(self, frame: Frame, *, to_autopilot: bool) -> bool:
        """Whether a frame of the link with the autopilot matters."""
        if to_autopilot:
            return frame.msg_id in OVERHEARD or frame.msg_id == _COMMAND_INT
        if frame.compid != AUTOPILOT_COMPID:
            return False
        place = CLOCKS.get(frame.msg_id)
        if place is not None:
            return self._shows_reboot(frame.payload.ljust(place + 4, b"\0")[place : place + 4])
        told = _TOLD.get(frame.msg_id)
        if told is None:
            return frame.msg_id in OVERHEARD or frame.msg_id == STATUSTEXT_ID
        said = frame.payload.ljust(told.stop, b"\0")[told]
        if self._last.get(frame.msg_id) == said:
            return False
        self._last[frame.msg_id] = said
        return True

    def _shows_reboot(self, clock: bytes) -> bool:
        clock_ms = int.from_bytes(clock, "little")
        back_ms = self._clock_ms - clock_ms
        if 0 <= back_ms <= REBOOT_STEP_MS:
            return False
        self._clock_ms = clock_ms
        if not 0 < back_ms < _WRAPPED_MS:
            return False
        self._last.clear()
        return True


class Onboard:
    """One UA's autopilot.

    Attributes:
        changes: how many frames were taken: as long as it is the same, so is all else.
        home: where it counts heights from; None until it says so.
        current: number of the mission's item that is flown to; -1 if it does not say.
        mission_state: MISSION_STATE label, "" if it does not say.
        target: latitude and longitude, degrees, of where it was last told to go in GUIDED; None if it was not.
        battery_percent: what is left; -1 if it does not say.
        gps_fix: GPS_FIX_TYPE; -1 until there is a GPS.
        satellites: that its GPS sees.
        texts: its messages, the newest last, TEXTS_KEPT at most; those of the boots before, too.
    """

    def __init__(self) -> None:
        self.changes = 0
        self.texts: deque[AutopilotText] = deque(maxlen=TEXTS_KEPT)
        self._autopilot = ARDUPILOT
        self._chunks = StatusTextAssembler()
        self._handlers: dict[int, Callable[[Fields], None]] = {
            _HEARTBEAT: self._take_heartbeat,
            _SYS_STATUS: self._take_status,
            _GPS_RAW: self._take_gps,
            _CURRENT: self._take_current,
            _COMMAND_INT: self._take_command,
            _HOME: self._take_home,
        }
        self._boot()

    def _boot(self) -> None:
        """Forget what the boot before has said."""
        self.home: Earth | None = None
        self.current, self.mission_state = -1, ""
        self.target: tuple[float, float] | None = None
        self.battery_percent = self.gps_fix = -1
        self.satellites = 0
        self._overheard = Overheard()

    def take(self, sim_time_ns: int, frame: Frame, *, to_autopilot: bool) -> None:
        """Take a frame that `Sieve` lets through."""
        self.changes += 1
        self._add(sim_time_ns, self._chunks.overdue(sim_time_ns))
        if frame.msg_id in OVERHEARD:
            self._overheard.take(frame, to_autopilot=to_autopilot)
        elif frame.msg_id in CLOCKS:
            self._boot()
        elif frame.msg_id == STATUSTEXT_ID:
            self._add(sim_time_ns, self._chunks.take(frame, sim_time_ns))
        elif fields := message_fields(frame.raw):
            self._handlers[frame.msg_id](fields)

    def _add(self, sim_time_ns: int, texts: list[StatusText]) -> None:
        self.texts.extend(AutopilotText(sim_time_ns, text.severity, text.text) for text in texts)

    def _take_heartbeat(self, fields: Fields) -> None:
        self._autopilot = int(fields["autopilot"])

    def _take_status(self, fields: Fields) -> None:
        self.battery_percent = int(fields["battery_remaining"])

    def _take_gps(self, fields: Fields) -> None:
        self.gps_fix, self.satellites = int(fields["fix_type"]), int(fields["satellites_visible"])

    def _take_current(self, fields: Fields) -> None:
        state = int(fields["mission_state"])
        self.current = int(fields["seq"])
        self.mission_state = enum_label("MISSION_STATE", state) if state else ""

    def _take_command(self, fields: Fields) -> None:
        if fields["command"] == _REPOSITION:
            lat_deg, lon_deg = fields["x"] / 1e7, fields["y"] / 1e7
            is_earth = abs(lat_deg) <= 90.0 and abs(lon_deg) <= 180.0
            self.target = (lat_deg, lon_deg) if is_earth else None

    def _take_home(self, fields: Fields) -> None:
        self.home = fields["latitude"] / 1e7, fields["longitude"] / 1e7, fields["altitude"] / 1e3

    @property
    def first_item(self) -> int:
        """Number of the mission's first item: ArduPilot counts home as item 0."""
        return int(self._autopilot == ARDUPILOT)

    def items(self, kind: str) -> tuple[MissionItem, ...] | None:
        """What it has of a kind (mission, fence, rally), without home; None as long as none was transferred."""
        found = self._overheard.lists.get(kind)
        return found[self.first_item :] if found and kind == "mission" else found
