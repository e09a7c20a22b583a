"""What is written down of one node: MAVLink, states, its agent's log, inputs, counters, and why it may not repeat."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from bridge.bus.messages import AgentStatus, AircraftState
from bridge.record import names
from bridge.record.events import AGENT_BLOCKED, AGENT_WARNING, OTHER_SYSTEM, Report, RunEvent
from bridge.record.inputs.file import InputWriter, RecordedInput, inputs_of
from bridge.record.logged import LoggedValue, encode_logged
from bridge.record.names import Kind
from bridge.record.streams import StreamWriter
from bridge.record.tables.states import StateWriter
from bridge.run.directory import RunDirectory


class NodeRecord:
    """The record of one node.

    Args:
        run: where it is written; it may name another run whose inputs are to be repeated.
        node: the node id.
        has_autopilot: whether there is MAVLink to record.

    Attributes:
        now_ns: the instant that what is written belongs to.
        replay: the inputs to repeat; None if this run repeats no other.
        on_warning: called, in any thread, with an event that somebody must see while the run goes on.

    Raises:
        InputError: the inputs to repeat are not in order.
        OSError: a file cannot be made or read.
    """

    def __init__(self, run: RunDirectory, node: str, *, has_autopilot: bool = True) -> None:
        self.now_ns = 0
        self.on_warning: Callable[[RunEvent], object] = lambda _: None
        replay = run.info.replay
        self.replay: list[RecordedInput] | None = inputs_of(Path(replay), node) if replay else None
        self._report = Report(run.path, f"node-{node}")
        self._node = node
        self._reasons: set[str] = set()
        self._inputs = InputWriter(names.inputs_path(run.path, node))
        files = {"from_autopilot": names.from_autopilot(node), "to_autopilot": names.to_autopilot(node)}
        self._mavlink = {
            direction: StreamWriter(stream.path(run.path))
            for direction, stream in files.items()
            if has_autopilot
        }
        self._logged = StreamWriter(names.logged(node).path(run.path))
        self._states = StateWriter(run.path, node)
        self._run, self._serial = run.path, dict[names.Stream, StreamWriter]()
        self._writers: list[StreamWriter | StateWriter] = [
            *self._mavlink.values(),
            self._logged,
            self._states,
        ]

    def write_mavlink(self, direction: str, data: bytes) -> None:
        """Bytes that were read from, or written to, the autopilot at this instant."""
        self._mavlink[direction].write(self.now_ns, data)

    def write_serial(self, radio: str, kind: Kind, data: bytes) -> None:
        """Serial bytes that went to, or came from, the node's modem at a radio, at this instant."""
        stream = names.Stream(kind, self._node, radio)
        if stream not in self._serial:
            self._serial[stream] = StreamWriter(stream.path(self._run))
            self._writers.append(self._serial[stream])
        self._serial[stream].write(self.now_ns, data)

    def write_input(self, item: RecordedInput) -> None:
        """An input that takes effect at this instant."""
        self._inputs.write(item)

    def write_state(self, state: AircraftState) -> None:
        """The node's state, as it is published at this instant."""
        self._states.append(state)

    def write_logged(self, item: LoggedValue | AgentStatus) -> None:
        """What the node's agent logged or reported at this instant."""
        self._logged.write(self.now_ns, encode_logged(item))

    def may_not_repeat(self, reason: str) -> None:
        """Wall time decided something; each reason counts once, with the instant of the first time."""
        if reason in self._reasons:
            return
        self._reasons.add(reason)
        text = f"node {self._node}: {reason}"
        self._report.event(self.now_ns, self._node, "wall_time", text)
        self._report.may_not_repeat(f"{text} (at {self.now_ns / 1e9:.2f} s)")

    def warn(self, text: str) -> None:
        """The node's agent does what its author cannot want; from any thread."""
        self._warn(AGENT_WARNING, text)

    def agent_blocked(self, text: str) -> None:
        """The node's agent is at work on a tick for long, by wall time: it changes no result.

        On disk at once: no other tick may come, and whoever gives the run up reads it.
        """
        self._warn(AGENT_BLOCKED, text)
        self._report.flush()

    def other_system(self, sysid: int) -> None:
        """The node's autopilot calls itself another system than it was told to be."""
        text = f"its autopilot calls itself system {sysid}: nothing that it says is taken"
        self._warn(OTHER_SYSTEM, text)

    def _warn(self, kind: str, text: str) -> None:
        event = RunEvent(self.now_ns, self._node, kind, text)
        self._report.event(event.sim_time_ns, event.node, event.kind, event.text)
        self.on_warning(event)

    def flush(self) -> None:
        """Hand everything to the operating system."""
        for writer in self._writers:
            writer.flush()
        self._report.flush()

    def close(self, statistics: Mapping[str, Any], counters: Mapping[str, int]) -> None:
        """Write the counters of the daemon and the node, and close all files."""
        self._report.set_counters(_flat(statistics) | dict(counters))
        self._report.close()
        self._inputs.close()
        for writer in self._writers:
            writer.close()


def _flat(statistics: Mapping[str, Any], prefix: str = "mavlink") -> dict[str, int]:
    """Nested counters as ``mavlink.routes.loop``; zeros and what is no count are left out."""
    found: dict[str, int] = {}
    for name, value in statistics.items():
        if isinstance(value, Mapping):
            found |= _flat(value, f"{prefix}.{name}")
        elif isinstance(value, int) and not isinstance(value, bool) and value:
            found[f"{prefix}.{name}"] = value
    return found
