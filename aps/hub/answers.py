"""What we answer as a component of our own: nobody who asks us is left waiting. No I/O and no clock."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

from aps.wire.dialect import AUTOPILOT_COMPID, Encoder, mavlink, message_fields
from aps.wire.framer import Frame

PING: Final = 4
PARAM_REQUEST_READ: Final = 20
PARAM_REQUEST_LIST: Final = 21
PARAM_SET: Final = 23
COMMAND_INT: Final = 75
COMMAND_LONG: Final = 76
_MISSION_REQUESTS: Final = frozenset({38, 39, 40, 41, 43, 44, 45, 51, 73})
"""MISSION_WRITE_PARTIAL_LIST ... MISSION_ITEM_INT."""
_ASKS: Final = frozenset({PING, PARAM_REQUEST_READ, PARAM_REQUEST_LIST, PARAM_SET, COMMAND_INT, COMMAND_LONG})
ANSWERED: Final = _ASKS | _MISSION_REQUESTS
"""Ids of the messages that may want an answer."""
MAX_ENCODERS: Final = 256


class Answers:
    """Answers what is addressed to (sysid, compid): with no parameters, no missions, and no commands of its own.

    Args:
        sysid: our system id.
        compid: our component id.
    """

    def __init__(self, sysid: int, compid: int) -> None:
        self.sysid, self.compid = sysid, compid
        self.counters: dict[str, int] = {"answered": 0, "denied": 0}
        self._encoders: dict[int, Encoder] = {}
        """Link -> its encoder: sequence numbers are per link, or a gap would look like a loss."""
        self._in_its_name = Encoder(sysid, AUTOPILOT_COMPID)

    def reply(self, frame: Frame, link_id: int) -> bytes | None:
        """The answer to a frame, if it wants one from us."""
        if frame.msg_id not in ANSWERED:
            return None
        named = frame.target_system == self.sysid and frame.target_component == self.compid
        if not named and not (frame.msg_id == PING and not frame.target_system):
            return None
        if (
            frame.msg_id in _MISSION_REQUESTS
            and frame.compid == AUTOPILOT_COMPID
            and frame.sysid == self.sysid
        ):
            return (
                None  # the list that we have asked for: PX4 would take a denial for the end of the transfer
            )
        fields = message_fields(frame.raw)
        message = _answer(frame, fields) if fields else None
        if message is None:
            return None
        self.counters["answered"] += 1
        return self._encoder_of(link_id).encode(message)

    def denial(self, frame: Frame) -> bytes | None:
        """The answer to a client's command that the autopilot is not given; ``None`` if the frame is no command.

        In the autopilot's name: clients (QGroundControl, MAVSDK) look for it by the ids that they have asked.
        """
        if frame.msg_id not in (COMMAND_INT, COMMAND_LONG):
            return None
        command = message_fields(frame.raw).get("command")
        if command is None:
            return None
        self.counters["denied"] += 1
        asker = (frame.sysid, frame.compid)
        denied = mavlink.MAVLink_command_ack_message(command, mavlink.MAV_RESULT_DENIED, 0, 0, *asker)
        return self._in_its_name.encode(denied)

    def _encoder_of(self, link_id: int) -> Encoder:
        if link_id not in self._encoders:
            if len(self._encoders) >= MAX_ENCODERS:
                self._encoders.clear()
            self._encoders[link_id] = Encoder(self.sysid, self.compid)
        return self._encoders[link_id]


def _answer(frame: Frame, fields: dict[str, Any]) -> Any | None:
    asker = (frame.sysid, frame.compid)
    if frame.msg_id in _MISSION_REQUESTS:
        kind = fields.get("mission_type", 0)
        return mavlink.MAVLink_mission_ack_message(*asker, mavlink.MAV_MISSION_DENIED, kind)
    return _ANSWERS[frame.msg_id](asker, fields)


def _ping(asker: tuple[int, int], fields: dict[str, Any]) -> Any:
    return mavlink.MAVLink_ping_message(fields["time_usec"], fields["seq"], *asker)


def _command(asker: tuple[int, int], fields: dict[str, Any]) -> Any:
    unsupported = mavlink.MAV_RESULT_UNSUPPORTED
    return mavlink.MAVLink_command_ack_message(fields["command"], unsupported, 0, 0, *asker)


def _no_parameters(_asker: tuple[int, int], _fields: dict[str, Any]) -> Any:
    """To a list of none: a value of nothing that says that there are 0."""
    return mavlink.MAVLink_param_value_message(b"", 0.0, mavlink.MAV_PARAM_TYPE_REAL32, 0, NO_INDEX)


def _no_such_parameter(asker: tuple[int, int], fields: dict[str, Any]) -> Any:
    name = fields["param_id"].encode() if isinstance(fields["param_id"], str) else fields["param_id"]
    index = fields.get("param_index", -1)
    return mavlink.MAVLink_param_error_message(*asker, name, index, mavlink.MAV_PARAM_ERROR_DOES_NOT_EXIST)


NO_INDEX: Final = 65535
_ANSWERS: Final[dict[int, Callable[[tuple[int, int], dict[str, Any]], Any]]] = {
    PING: _ping,
    COMMAND_INT: _command,
    COMMAND_LONG: _command,
    PARAM_REQUEST_LIST: _no_parameters,
    PARAM_REQUEST_READ: _no_such_parameter,
    PARAM_SET: _no_such_parameter,
}
