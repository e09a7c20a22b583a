"""Which class of a queue a MAVLink frame is in: heartbeats and commands before parameters and missions, then telemetry.

Only the head of a frame is looked at (mavlink.io/en/guide/serialization.html); numbers are those of `common.xml`.
"""

from __future__ import annotations

from typing import Final

from channel.access.packets import Handling

V1, V2 = 0xFE, 0xFD
_OVERHEAD_BYTES: Final = {V1: 8, V2: 12}
_HEAD_BYTES: Final = {V1: 6, V2: 10}
_SIGNATURE_BYTES: Final = 13
_SIGNED: Final = 0x01
URGENT, ORDERLY, TELEMETRY = 2, 1, 0
"""Priorities."""
URGENT_IDS: Final = frozenset(
    (
        *(0, 11),  # HEARTBEAT, SET_MODE
        *(69, 70),  # MANUAL_CONTROL, RC_CHANNELS_OVERRIDE
        *(75, 76, 77, 80),  # COMMAND_INT, _LONG, _ACK, _CANCEL
        *(82, 84, 86),  # SET_ATTITUDE_TARGET, SET_POSITION_TARGET_LOCAL_NED, _GLOBAL_INT
    )
)
ORDERLY_IDS: Final = frozenset(
    (
        *range(20, 24),  # PARAM_REQUEST_READ to PARAM_SET
        *(37, 38, 39, 40, 41, 43, 44, 45, 47, 51, 73),  # of the mission protocol
        253,  # STATUSTEXT
        *range(320, 325),  # PARAM_EXT_...
    )
)


def handled(payload: bytes, handling: Handling) -> Handling:
    """The handling of a packet: with the class of its most urgent frame, unless its sender gave it a priority."""
    if handling.priority:
        return handling
    priority = max((_class_of(message) for message in _messages(payload)), default=TELEMETRY)
    return handling._replace(priority=priority) if priority else handling


def _class_of(message: int) -> int:
    return URGENT if message in URGENT_IDS else ORDERLY if message in ORDERLY_IDS else TELEMETRY


def _messages(payload: bytes) -> list[int]:
    """Numbers of the messages of which a payload consists; none, if there is anything else in it."""
    place, found = 0, []
    while place < len(payload):
        magic, head = payload[place], payload[place : place + 10]
        if magic not in _HEAD_BYTES or len(head) < _HEAD_BYTES[magic]:
            return []
        found.append(head[5] if magic == V1 else int.from_bytes(head[7:10], "little"))
        signature = _SIGNATURE_BYTES if magic == V2 and head[2] & _SIGNED else 0
        place += _OVERHEAD_BYTES[magic] + head[1] + signature
    return found if place == len(payload) else []
