"""A node without an aircraft: it is where the scenario says, and carries out nothing."""

from __future__ import annotations

from collections.abc import Sequence

from aps.inputs import Input
from bridge.aircraft.body import OnEvent
from bridge.bus.messages import GROUND_MODE, AircraftState, CommandEvent, CommandGoal, Header, Vector3
from bridge.scenario.resolve.ground_track import GroundTrack


class GroundBody:
    """One ground node; its state is its place, and nothing else.

    Args:
        node: its node id.
        track: where it is, and when.
    """

    def __init__(self, node: str, track: GroundTrack) -> None:
        self.takes_input = True
        self._node = node
        self._track = track
        self._now_ns = 0

    def inject(self, inputs: Sequence[Input]) -> None:
        """Nothing of a record can be for it: it has no MAVLink."""
        if inputs:
            raise ValueError(f"node {self._node} has no MAVLink, but the record has input on it")

    def swap(self) -> None:
        """There is nobody to hear."""

    def begin(self, now_ns: int) -> None:
        """Take the time."""
        self._now_ns = now_ns

    def end(self) -> None:
        """Nothing is said to anybody."""

    def state(self) -> AircraftState:
        """Where it stands; its height is that over the fleet's origin."""
        place = self._track.at(self._now_ns)
        position = place.position
        return AircraftState(
            Header.at(self._now_ns, self._node),
            longitude_deg=position.lon_deg,
            latitude_deg=position.lat_deg,
            altitude_amsl_m=position.alt_amsl_m,
            altitude_rel_m=-place.position_ned_m[2],
            position_ned_m=Vector3(*place.position_ned_m),
            velocity_ned_mps=Vector3(*place.velocity_ned_mps),
            mode=GROUND_MODE,
        )

    def start(self, verb: str, goal: CommandGoal, on_event: OnEvent) -> None:  # noqa: ARG002
        """Refuse: there is nothing that could fly."""
        text = f"{verb}: node {self._node} has no aircraft"
        on_event(CommandEvent(CommandEvent.RESULT, False, text, outcome="refused"))
