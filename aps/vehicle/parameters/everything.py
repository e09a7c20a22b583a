"""All parameters by the quickest way that the autopilot knows: the packed file over FTP, else one by one."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from aps.vehicle.autopilots.choice import autopilot_of
from aps.vehicle.execution import CommandResult, Execution, Outcome
from aps.vehicle.parameters.ftp import PackedExecution
from aps.vehicle.parameters.transfer import ListExecution
from aps.vehicle.telemetry import VehicleState

OPEN_TRIES: Final = 2
"""How often an autopilot is asked that may know no FTP at all."""


class AllExecution(Execution):
    """Gets all parameters: the result's value is name -> number.

    Args:
        state: the UA now.
        ftp: whether to try the packed file first, if the autopilot is of those that have one.
    """

    wanted = PackedExecution.wanted | ListExecution.wanted

    def __init__(self, state: VehicleState, *, ftp: bool) -> None:
        super().__init__("parameters", "parameters")
        self._state = state
        packed = ftp and autopilot_of(state.autopilot).packed_parameters
        self._inner: Execution = PackedExecution(state, OPEN_TRIES) if packed else ListExecution(state)

    def poll(self, state: VehicleState, now_ns: int) -> list[Any]:
        """As of every execution."""
        if self.result is not None:
            return []
        messages = self._inner.poll(state, now_ns)
        self.events += self._inner.events
        self._inner.events = []
        result = self._inner.result
        if result is None:
            return messages
        if isinstance(self._inner, PackedExecution) and result.outcome in (
            Outcome.REFUSED,
            Outcome.TIMED_OUT,
        ):
            self.tell("feedback", f"not by FTP ({result.reason}): one by one")
            self._inner = ListExecution(state)
            return messages + self.poll(state, now_ns)
        self._take(result)
        return messages

    def _take(self, result: CommandResult) -> None:
        self.end(result.outcome, result.reason, result.value)

    def _poll(self, state: VehicleState, now_ns: int) -> list[Any]:
        raise NotImplementedError

    def _due_ns(self) -> int | None:
        return self._inner.deadline_ns()

    def on_message(self, name: str, fields: Mapping[str, Any], now_ns: int) -> None:
        """What the way in use wants to know."""
        self._inner.on_message(name, fields, now_ns)

    def on_link(self, connected: bool, now_ns: int) -> None:
        """The link went down or came back."""
        self._inner.on_link(connected, now_ns)


def get_all(state: VehicleState, ftp: bool = True) -> AllExecution:
    """Get all parameters: the result's value is name -> number.

    Args:
        state: the UA now.
        ftp: whether to try the autopilot's packed file first, which takes seconds where one by one takes a minute.
    """
    return AllExecution(state, ftp=ftp)
