"""A throttle stick in the middle, for a vehicle without a pilot in a mode that reads one. No I/O, no clock.

ArduCopter without a receiver takes the stick for zero, and sinks in LOITER at full speed. Its own clock paces what is
sent: it forgets the stick after RC_OVERRIDE_TIME, 3 s.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

from aps.wire.dialect import AUTOPILOT_COMPID, ONBOARD_COMPUTER_COMPID, Encoder, mavlink
from aps.wire.framer import Frame

GCS_SYSID: Final = 255
"""MAV_GCS_SYSID: whom ArduPilot lets hold the sticks."""
PERIOD_MS: Final = 200
MIDDLE_US: Final = 1500
RELEASED_US: Final = 0
_UNCHANGED_US: Final = 65535
_STICKS: Final = frozenset({69, 70})
"""MANUAL_CONTROL and RC_CHANNELS_OVERRIDE."""


class MiddleStick:
    """Holds the throttle stick while the UA is armed in a mode that a command of ours has put it into.

    A client that moves sticks itself, or another mode, ends it. A UA that is not armed would not arm with it.

    Args:
        sysid: of the UA.
        put: sends the bytes of one frame to the autopilot.
    """

    def __init__(self, sysid: int, put: Callable[[bytes], None]) -> None:
        self._sysid, self._put = sysid, put
        self._encoder = Encoder(GCS_SYSID, ONBOARD_COMPUTER_COMPID)
        self._mode = ""
        self._armed = self._is_there = False
        self._due_ms = 0

    def flight_begins(self, stick_mode: str) -> None:
        """A flight command begins, and leaves the UA in this mode; empty for one that reads no stick."""
        if self._armed and (stick_mode or self._mode):
            self._say(MIDDLE_US if stick_mode else RELEASED_US)
        self._mode, self._is_there, self._due_ms = stick_mode, False, 0

    def client_frame(self, frame: Frame) -> None:
        """A client's frame is about to go to the autopilot."""
        if frame.msg_id in _STICKS:
            self._mode = ""

    def state_changed(self, mode: str, armed: bool, clock_ms: int) -> None:
        """The autopilot has reported its mode and time."""
        if self._armed and not armed and self._mode:
            self._say(RELEASED_US)
        self._armed = armed
        if not self._mode:
            return
        if mode == self._mode:
            self._is_there = True
        elif self._is_there:
            self.flight_begins("")
            return
        if armed and not 0 < self._due_ms - clock_ms <= PERIOD_MS:  # due; or its clock began anew
            self._say(MIDDLE_US)
            self._due_ms = clock_ms + PERIOD_MS

    def _say(self, throttle_us: int) -> None:
        channels: list[Any] = [_UNCHANGED_US] * 8
        channels[2] = throttle_us
        message = mavlink.MAVLink_rc_channels_override_message(self._sysid, AUTOPILOT_COMPID, *channels)
        self._put(self._encoder.encode(message))
