"""Classes of MAVLink frames, as pymavlink packs them."""

from __future__ import annotations

import pytest
from pymavlink.dialects.v10 import ardupilotmega as v1
from pymavlink.dialects.v20 import ardupilotmega as v2

from channel.access.mavlink import ORDERLY_IDS, URGENT_IDS, handled
from channel.access.packets import PLAIN, Handling

HEARTBEAT = (2, 3, 81, 0, 4, 3)
ATTITUDE = (0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
COMMAND = (1, 1, 400, 0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
PARAM = (b"RTL_ALT", 15.0, 9, 900, 3)


def frame(dialect: object, name: str, fields: tuple[object, ...], *, is_signed: bool = False) -> bytes:
    link = dialect.MAVLink(None, srcSystem=1, srcComponent=1)  # type: ignore[attr-defined]
    if is_signed:
        link.signing.secret_key, link.signing.sign_outgoing = bytes(32), True
    return bytes(getattr(dialect, f"MAVLink_{name}_message")(*fields).pack(link))


@pytest.mark.parametrize("dialect", [v1, v2])
@pytest.mark.parametrize(
    ("name", "fields", "priority"),
    [
        ("heartbeat", HEARTBEAT, 2),
        ("command_long", COMMAND, 2),
        ("param_value", PARAM, 1),
        ("attitude", ATTITUDE, 0),
    ],
)
def test_heartbeats_and_commands_go_before_parameters_and_these_before_telemetry(
    dialect: object, name: str, fields: tuple[object, ...], priority: int
) -> None:
    assert handled(frame(dialect, name, fields), PLAIN).priority == priority


def test_of_several_frames_the_most_urgent_counts() -> None:
    attitude, heartbeat = frame(v2, "attitude", ATTITUDE, is_signed=True), frame(v1, "heartbeat", HEARTBEAT)
    assert handled(attitude + attitude + heartbeat, PLAIN).priority == 2
    assert handled(attitude + b"x" + heartbeat, PLAIN).priority == 0


def test_what_a_sender_says_counts_and_what_is_no_frame_is_left() -> None:
    heartbeat = frame(v2, "heartbeat", HEARTBEAT)
    asked = Handling(-3, 10, "state")
    assert handled(heartbeat, asked) is asked
    assert handled(heartbeat, Handling(0, 10, "state")) == Handling(2, 10, "state")
    for payload in (
        b"",
        b"\xfd",
        heartbeat[:9],
        heartbeat[:-1],
        heartbeat + b"x",
        b"text",
        b"\xfe" + bytes(99),
    ):
        assert handled(payload, PLAIN) is PLAIN


def test_the_numbers_are_those_of_the_dialect() -> None:
    names = {number: message.msgname for number, message in v2.mavlink_map.items()}
    assert {names.get(number, "COMMAND_CANCEL") for number in URGENT_IDS} == {
        "HEARTBEAT",
        "SET_MODE",
        "MANUAL_CONTROL",
        "RC_CHANNELS_OVERRIDE",
        "COMMAND_INT",
        "COMMAND_LONG",
        "COMMAND_ACK",
        "COMMAND_CANCEL",
        "SET_ATTITUDE_TARGET",
        "SET_POSITION_TARGET_LOCAL_NED",
        "SET_POSITION_TARGET_GLOBAL_INT",
    }
    orderly = {names[number] for number in ORDERLY_IDS}
    assert all(name.startswith(("PARAM_", "MISSION_")) or name == "STATUSTEXT" for name in orderly)
    told = {name for name in names.values() if name.startswith(("PARAM_", "MISSION_"))}
    assert told - orderly == {"PARAM_MAP_RC", "PARAM_ERROR", "MISSION_CURRENT", "MISSION_ITEM_REACHED"}
