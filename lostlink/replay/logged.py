"""What an agent logged between two ticks of a record, read as the record is played."""

from __future__ import annotations

from pathlib import Path

from bridge.bus.messages import AgentStatus
from bridge.record.logged import LoggedValue, logged_of


class NodeLogged:
    """What one agent logged and said of its work; going back begins anew.

    Args:
        run: the run directory.
        node: the node's id.
    """

    def __init__(self, run: Path, node: str) -> None:
        self._run, self._node = run, node
        self._begin()

    def _begin(self) -> None:
        self._entries = logged_of(self._run, self._node)
        self._next = next(self._entries, None)
        self._read_ns = -1

    def between(self, after_ns: int, until_ns: int) -> list[tuple[int, LoggedValue | AgentStatus]]:
        """Return what is later than ``after_ns`` and not later than ``until_ns``, with its sim time in ns.

        Raises:
            ValueError, OSError: the record of it is damaged or cannot be read.
        """
        if after_ns < self._read_ns:
            self._begin()
        found: list[tuple[int, LoggedValue | AgentStatus]] = []
        while self._next is not None and self._next[0] <= until_ns:
            if self._next[0] > after_ns:
                found.append(self._next)
            self._next = next(self._entries, None)
        self._read_ns = until_ns
        return found
