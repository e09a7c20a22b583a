"""What agents log, on its way from Zenoh's threads into the view: bounded in memory and in rate, fair between nodes.

Of each name the newest few values wait, so that a name that is logged seldom is not lost beside one that is logged at
every tick.
"""

from __future__ import annotations

import json
import threading
from collections import deque
from collections.abc import Sequence
from typing import Any, NamedTuple

from bridge.record.logged import NAME_MAX

WAITING_MAX = 4
"""Values of one name that wait; the oldest give way."""
NAMES_WAITING_MAX = 1024
"""Names of one node that wait: as many as an agent can log at a tick; those that wait longest give way."""
BYTES_WAITING_MAX = 1 << 20
"""Of one node, likewise."""
PAYLOAD_MAX_BYTES = 8192
"""Of a longer value only its length is shown."""
VALUES_PER_READ = 500
BYTES_PER_READ = 1 << 19
"""What is read at once: a hundredth of a second or so."""


class LoggedSample(NamedTuple):
    """A value as it came: JSON."""

    node: str
    name: str
    sim_time_ns: int
    payload: bytes

    @property
    def value(self) -> Any:
        """What it says; the start of its bytes if that is not JSON."""
        try:
            return json.loads(self.payload)
        except (ValueError, RecursionError):
            return f"not JSON: {self.payload[:32]!r}"


class _Waiting:
    """The values of one node."""

    def __init__(self) -> None:
        self._names: dict[str, deque[LoggedSample]] = {}
        self._length_bytes = 0

    def __bool__(self) -> bool:
        return bool(self._names)

    def push(self, sample: LoggedSample) -> None:
        """Add a value; what is too much gives way."""
        samples = self._names.setdefault(sample.name, deque())
        samples.append(sample)
        self._length_bytes += len(sample.payload)
        if len(samples) > WAITING_MAX:
            self._length_bytes -= len(samples.popleft().payload)
        while len(self._names) > NAMES_WAITING_MAX or self._length_bytes > BYTES_WAITING_MAX:
            self.pop()

    def pop(self) -> deque[LoggedSample]:
        """Take the values of the name that waits longest."""
        samples = self._names.pop(next(iter(self._names)))
        self._length_bytes -= sum(len(sample.payload) for sample in samples)
        return samples


class LoggedQueue:
    """Values of ``nodes`` that wait to be read. `push` may be called in any thread, `read` in one."""

    def __init__(self, nodes: Sequence[str]) -> None:
        self._lock = threading.Lock()
        self._waiting = {node: _Waiting() for node in nodes}

    def push(self, sample: LoggedSample) -> None:
        """Have a value wait; one of a node that is unknown, or with too long a name, is passed over."""
        if len(sample.name) > NAME_MAX:
            return
        if len(sample.payload) > PAYLOAD_MAX_BYTES:
            length = json.dumps(f"{len(sample.payload)} bytes, too long to be shown")
            sample = sample._replace(payload=length.encode())
        with self._lock:
            if sample.node in self._waiting:
                self._waiting[sample.node].push(sample)

    def read(self) -> list[LoggedSample]:
        """Take what waits, as much as may be read at once: of each node a name in turn, what waits longest first."""
        found: list[LoggedSample] = []
        length_bytes = 0
        with self._lock:
            while length_bytes < BYTES_PER_READ and len(found) < VALUES_PER_READ:
                node = next((node for node, waiting in self._waiting.items() if waiting), None)
                if node is None:
                    break
                waiting = self._waiting.pop(node)
                self._waiting[node] = waiting  # its turn comes again after the others
                samples = waiting.pop()
                found += samples
                length_bytes += sum(len(sample.payload) for sample in samples)
        return found
