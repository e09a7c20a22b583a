"""What a WebSocket client is sent: states, texts, messages, progress and results, the newest first to matter."""

from __future__ import annotations

import asyncio
import json
import time
from collections import deque
from collections.abc import Iterable
from dataclasses import asdict
from typing import Any, Final

from aps.api.backend import DaemonBackend
from aps.status import plain_state
from aps.vehicle.messages import as_json
from aps.vehicle.state import VehicleState
from aps.vehicle.status_text import StatusText

MAX_WAITING: Final = 256
"""Events that wait for a client: then the oldest give way, and the client gets their number."""
MAX_LISTENERS: Final = 32
NS_PER_S: Final = 1_000_000_000
LEAST_RATE_HZ: Final = 1e-6
"""Twelve days: what is slower need not be told apart."""


def state_json(state: VehicleState) -> dict[str, Any]:
    """A state as JSON: unknown numbers are null, and ``age_s`` has the age of every field."""
    return plain_state(state) | {"connected": state.connected, "age_s": as_json(state.ages_s())}


class Listener:
    """One client of the stream.

    Args:
        rate_hz: how often it gets the state and messages at most, by wall time; 0: never.
        messages: names of the MAVLink messages that it wants.
    """

    def __init__(self, rate_hz: float, messages: Iterable[str]) -> None:
        self._period_ns = round(NS_PER_S / max(rate_hz, LEAST_RATE_HZ)) if rate_hz else None
        self._messages = {name.upper(): -1 for name in messages}
        self._waiting: deque[str] = deque()
        self._missed = 0
        self._wake = asyncio.Event()
        self._due_ns = time.monotonic_ns()

    def put(self, event: dict[str, Any]) -> None:
        """Have an event sent."""
        if len(self._waiting) >= MAX_WAITING:
            self._waiting.popleft()
            self._missed += 1
        self._waiting.append(json.dumps(event))
        self._wake.set()

    async def next(self) -> str:
        """The next event to send, as JSON."""
        while not self._waiting:
            self._wake.clear()
            await self._wake.wait()
        if self._missed:
            missed, self._missed = self._missed, 0
            return json.dumps({"type": "missed", "events": missed})
        return self._waiting.popleft()

    def look(self, backend: DaemonBackend, state: VehicleState) -> None:
        """There is a new state: send it, and new messages, if they are due."""
        now_ns = time.monotonic_ns()
        if self._period_ns is None or now_ns < self._due_ns:
            return
        self._due_ns = max(self._due_ns + self._period_ns, now_ns - self._period_ns)
        self.put({"type": "state", **state_json(state)})
        for name, seen in self._messages.items():
            last = backend.last_message(name)
            if last is not None and last.count != seen:
                self._messages[name] = last.count
                self.put({"type": "message", **asdict(last)})


class ApiStream:
    """All clients of one UA's stream.

    Args:
        backend: the UA.
    """

    def __init__(self, backend: DaemonBackend) -> None:
        self._backend = backend
        self._listeners: list[Listener] = []
        self._end = backend.listen(self._new_state, self._new_text)

    def add(self, listener: Listener) -> bool:
        """Take a client; False if there are too many."""
        if len(self._listeners) >= MAX_LISTENERS:
            return False
        self._listeners.append(listener)
        return True

    def remove(self, listener: Listener) -> None:
        """A client is gone."""
        self._listeners.remove(listener)

    def tell(self, event: dict[str, Any]) -> None:
        """Send an event to all."""
        for listener in self._listeners:
            listener.put(event)

    def close(self) -> None:
        """Listen no more."""
        self._end()

    def _new_state(self, state: VehicleState) -> None:
        for listener in self._listeners:
            listener.look(self._backend, state)

    def _new_text(self, text: StatusText) -> None:
        self.tell({"type": "text", "severity": text.severity, "text": text.text})
