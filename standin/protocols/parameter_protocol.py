"""The parameter protocol: list, read, set. Without I/O; a list goes out a few values per step."""

from __future__ import annotations

from collections.abc import Callable

from pymavlink.dialects.v20 import ardupilotmega as dialect

from standin.vehicle.parameters import TABLE, StandinParameters, UnknownParameterError
from standin.wire.mavlink_codec import Message

VALUES_PER_STEP = 10
NOT_IN_LIST = 65535


class ParameterProtocol:
    """One vehicle's end of the protocol."""

    def __init__(self, parameters: StandinParameters, send: Callable[[Message], None]) -> None:
        self._parameters = parameters
        self._send = send
        self._next: int | None = None
        self.refused = 0
        """Settings of unknown names or of values that are no numbers: not answered, as in ArduPilot."""
        self.handlers: dict[str, Callable[[Message], None]] = {
            "PARAM_REQUEST_LIST": self._list,
            "PARAM_REQUEST_READ": self._read,
            "PARAM_SET": self._set,
        }

    @property
    def is_listing(self) -> bool:
        """Whether a list is on its way."""
        return self._next is not None

    def step(self, values: int = VALUES_PER_STEP) -> None:
        """Send the next values of a list that is on its way."""
        if self._next is None:
            return
        end = min(self._next + values, len(TABLE))
        for index in range(self._next, end):
            self._send_value(TABLE[index].name, index)
        self._next = end if end < len(TABLE) else None

    def _list(self, _: Message) -> None:
        self._next = 0

    def _read(self, message: Message) -> None:
        """Answer a read by index, or by name if that is -1; silence for what does not exist."""
        if 0 <= message.param_index < len(TABLE):
            self._send_value(TABLE[message.param_index].name, message.param_index)
        elif message.param_index < 0 and message.param_id in self._parameters:
            self._send_value(message.param_id, NOT_IN_LIST)

    def _set(self, message: Message) -> None:
        """Set a value and send what is stored."""
        try:
            self._parameters.set(message.param_id, message.param_value)
        except (UnknownParameterError, ValueError):
            self.refused += 1
            return
        self._send_value(message.param_id, NOT_IN_LIST)

    def _send_value(self, name: str, index: int) -> None:
        row, value = self._parameters.row(name), self._parameters[name]
        self._send(
            dialect.MAVLink_param_value_message(name.encode(), value, int(row.type), len(TABLE), index)
        )
