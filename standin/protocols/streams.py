"""When each message is due: intervals in simulation time, kept over reconnects, as ArduPilot keeps them."""

from __future__ import annotations

from pymavlink.dialects.v20 import ardupilotmega as dialect

HEARTBEAT_INTERVAL_US = 1_000_000
INTERVAL_MIN_US = 3000
"""ArduPilot denies what is faster with a loop of 400 Hz (``GCS_MAVLINK::cap_message_interval``)."""
INTERVAL_MAX_US = 60_000_000
"""What is asked for more rarely comes so often, as ArduPilot's."""
DISABLED = -1
NEVER_NS = 2**63 - 1

GROUPS: dict[int, tuple[int, ...]] = {
    dialect.MAV_DATA_STREAM_EXTENDED_STATUS: (
        dialect.MAVLINK_MSG_ID_SYS_STATUS,
        dialect.MAVLINK_MSG_ID_MISSION_CURRENT,
        dialect.MAVLINK_MSG_ID_GPS_RAW_INT,
        dialect.MAVLINK_MSG_ID_NAV_CONTROLLER_OUTPUT,
    ),
    dialect.MAV_DATA_STREAM_POSITION: (
        dialect.MAVLINK_MSG_ID_GLOBAL_POSITION_INT,
        dialect.MAVLINK_MSG_ID_LOCAL_POSITION_NED,
    ),
    dialect.MAV_DATA_STREAM_EXTRA1: (dialect.MAVLINK_MSG_ID_ATTITUDE,),
    dialect.MAV_DATA_STREAM_EXTRA2: (dialect.MAVLINK_MSG_ID_VFR_HUD,),
    dialect.MAV_DATA_STREAM_EXTRA3: (
        dialect.MAVLINK_MSG_ID_SYSTEM_TIME,
        dialect.MAVLINK_MSG_ID_WIND,
        dialect.MAVLINK_MSG_ID_BATTERY_STATUS,
        dialect.MAVLINK_MSG_ID_EKF_STATUS_REPORT,
    ),
}
"""REQUEST_DATA_STREAM's groups: which messages ArduCopter sends in each, of those that the stand-in has."""
DEFAULT_INTERVALS_US = {dialect.MAVLINK_MSG_ID_HEARTBEAT: HEARTBEAT_INTERVAL_US}


class Streams:
    """The intervals and the next due times."""

    def __init__(self) -> None:
        self._interval_ns = {message: interval * 1000 for message, interval in DEFAULT_INTERVALS_US.items()}
        self._due_ns = dict.fromkeys(self._interval_ns, 0)
        self.next_due_ns = 0
        """The earliest due time: nothing to do before."""

    def set_interval(self, message_id: int, interval_us: int, now_ns: int) -> None:
        """Stream a message every ``interval_us`` (0 = its default, -1 = not at all)."""
        if interval_us == 0:
            interval_us = DEFAULT_INTERVALS_US.get(message_id, DISABLED)
        self._interval_ns.pop(message_id, None)
        self._due_ns.pop(message_id, None)
        if interval_us > 0:
            self._interval_ns[message_id] = min(max(interval_us, INTERVAL_MIN_US), INTERVAL_MAX_US) * 1000
            self._due_ns[message_id] = now_ns + self._interval_ns[message_id]
        self._find_next()

    def set_group(self, group: int, rate_hz: int, now_ns: int) -> None:
        """Stream the messages of a REQUEST_DATA_STREAM group (0 = all groups) at a rate; 0 stops them."""
        interval_us = round(1e6 / rate_hz) if rate_hz > 0 else DISABLED
        groups = list(GROUPS) if group == dialect.MAV_DATA_STREAM_ALL else [group]
        for one in groups:
            for message_id in GROUPS.get(one, ()):
                self.set_interval(message_id, interval_us, now_ns)

    def hasten(self, message_id: int, now_ns: int) -> None:
        """Make a streamed message due now."""
        if message_id in self._due_ns:
            self._due_ns[message_id] = now_ns
            self._find_next()

    def take_due(self, now_ns: int, slowdown_ns: int = 0, stretch: int = 1) -> list[int]:
        """Return the messages that are due, and plan their next times.

        Args:
            now_ns: the time.
            slowdown_ns: added to the interval of each but the heartbeat, which is not slowed down.
            stretch: by how much these sums are then multiplied.
        """
        due = []
        for message_id, due_ns in self._due_ns.items():
            if due_ns <= now_ns:
                due.append(message_id)
                interval_ns = self._interval_ns[message_id]
                if message_id != dialect.MAVLINK_MSG_ID_HEARTBEAT:
                    interval_ns = (interval_ns + slowdown_ns) * stretch
                following_ns = due_ns + interval_ns
                if following_ns <= now_ns:  # more than an interval late: do not catch up
                    following_ns = now_ns + interval_ns
                self._due_ns[message_id] = following_ns
        self._find_next()
        return due

    def _find_next(self) -> None:
        self.next_due_ns = min(self._due_ns.values(), default=NEVER_NS)
