"""The state of a UA at any tick of a record, from the MAVLink bytes of its autopilot that were written down."""

from __future__ import annotations

from pathlib import Path

from aps.vehicle.telemetry import Telemetry
from aps.wire.dialect import AUTOPILOT_COMPID
from aps.wire.framer import Framer
from bridge.aircraft.aircraft_bridge import state_message
from bridge.bus.messages import AircraftState
from bridge.record.names import from_autopilot
from bridge.record.streams import Entry, entries_of


class NodeStates:
    """The states of one UA; going back begins anew.

    Args:
        run: the run directory.
        node: the node's id.
        sysid: MAVLink system id of its autopilot.
    """

    def __init__(self, run: Path, node: str, sysid: int) -> None:
        self._path = from_autopilot(node).path(run)
        self._node = node
        self._sysid = sysid
        self._begin()

    def _begin(self) -> None:
        self._telemetry = Telemetry(self._sysid)
        self._telemetry.link_up()
        self._framer = Framer()
        self._entries = entries_of(self._path)
        self._next = next(self._entries, None)
        self._heard_ns = 0

    def at(self, sim_time_ns: int) -> AircraftState:
        """Table I as the run's aircraft bridge had it at a tick.

        Raises:
            StreamError, OSError: the record of its MAVLink is damaged or cannot be read.
        """
        if sim_time_ns < self._heard_ns:
            self._begin()
        while self._next is not None and self._next.tick_ns <= sim_time_ns:
            self._hear(self._next)
            self._next = next(self._entries, None)
        self._heard_ns = sim_time_ns
        return state_message(self._telemetry.state(sim_time_ns), self._node, sim_time_ns)

    def _hear(self, entry: Entry) -> None:
        for frame in self._framer.receive(entry.payload):
            if frame.sysid == self._sysid and frame.compid == AUTOPILOT_COMPID:
                self._telemetry.update(frame, entry.tick_ns)
