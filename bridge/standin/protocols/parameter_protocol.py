"""The parameter protocol: list, read, set. Without I/O; a list goes out a few values per step."""

from __future__ import annotations

from collections.abc import Callable

from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridge.standin.vehicle.parameters import Parameters, UnknownParameterError
from bridge.standin.wire.mavlink_codec import Message

VALUES_PER_STEP = 10
NOT_IN_LIST = 65535


class ParameterProtocol:
    """One vehicle's end of the protocol."""

    def __init__(self, parameters: Parameters, send: Callable[[Message], None]) -> None:
        self._parameters = parameters
        self._send = send
        self._next: int | None = None
        self.refused = 0
        """Settings of unknown names or of values that are no numbers: not answered, as in ArduPilot."""

    @property
    def listing(self) -> bool:
        """Whether a list is on its way."""
        return self._next is not None

    def handle(self, message: Message) -> bool:
        """Take a message of the protocol; return False if it is none."""
        kind = message.get_type()
        if kind == "PARAM_REQUEST_LIST":
            self._next = 0
        elif kind == "PARAM_REQUEST_READ":
            self._read(message)
        elif kind == "PARAM_SET":
            self._set(message)
        else:
            return False
        return True

    def step(self) -> None:
        """Send the next values of a list."""
        if self._next is None:
            return
        end = min(self._next + VALUES_PER_STEP, len(self._parameters))
        for index in range(self._next, end):
            self._send_value(self._parameters.at(index).name, index)
        self._next = end if end < len(self._parameters) else None

    def _read(self, message: Message) -> None:
        """Answer a read by index, or by name if that is -1; silence for what does not exist."""
        if message.param_index >= 0:
            if message.param_index < len(self._parameters):
                self._send_value(self._parameters.at(message.param_index).name, message.param_index)
        elif message.param_id in self._parameters:
            self._send_value(message.param_id, NOT_IN_LIST)

    def _set(self, message: Message) -> None:
        """Set a value and tell what is stored."""
        try:
            self._parameters.set(message.param_id, message.param_value)
        except (UnknownParameterError, ValueError):
            self.refused += 1
            return
        self._send_value(message.param_id, NOT_IN_LIST)

    def _send_value(self, name: str, index: int) -> None:
        row = self._parameters.at(self._parameters.index_of(name))
        self._send(
            dialect.MAVLink_param_value_message(
                name.encode(), self._parameters[name], int(row.type), len(self._parameters), index
            )
        )
