"""A ground station's part of the mission protocol."""

from __future__ import annotations

from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as mav


def mission_items(count: int) -> list[mav.MAVLink_mission_item_int_message]:
    return [
        mav.MAVLink_mission_item_int_message(
            2, 1, seq, 3, 16, 0, 1, 0, 0, 0, 0, int(40.1331e7) + 100 * seq, int(-105.2404e7), 20.0
        )
        for seq in range(count)
    ]


def upload(client: mavutil.mavfile, items: list[mav.MAVLink_mission_item_int_message]) -> None:
    """Upload a mission as a ground station does."""
    client.mav.mission_count_send(2, 1, len(items))
    while True:
        message = client.recv_match(
            type=["MISSION_REQUEST", "MISSION_REQUEST_INT", "MISSION_ACK"], blocking=True, timeout=20
        )
        assert message is not None, "the upload stands still"
        if message.get_type() == "MISSION_ACK":
            assert message.type == mav.MAV_MISSION_ACCEPTED
            return
        client.mav.send(items[message.seq])
