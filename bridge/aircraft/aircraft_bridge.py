"""One aircraft at the ticks: its autopilot's MAVLink is exchanged, its state becomes a message, its commands start.

`AircraftBridge` joins a held APS daemon (`aps.held`) with the run; it does no I/O of its own.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Sequence
from typing import Any

from aps.held import HeldDaemon
from aps.inputs import Input
from aps.vehicle.commands import CommandProgress, CommandResult
from aps.vehicle.telemetry import AircraftState
from bridge.aircraft.body import OnEvent
from bridge.bus import messages
from bridge.bus.messages import CommandEvent, CommandGoal, Header, Vector3

__all__ = ["AircraftBridge", "state_message"]

log = logging.getLogger("aircraft")


class AircraftBridge:
    """One aircraft.

    Args:
        daemon: its APS daemon.
        node: its node id.
    """

    def __init__(self, daemon: HeldDaemon, node: str) -> None:
        self.daemon = daemon
        self._node = node
        self._now_ns = 0

    @property
    def takes_input(self) -> bool:
        """Whether MAVLink clients and operators are listened to."""
        return self.daemon.takes_input

    @takes_input.setter
    def takes_input(self, takes_input: bool) -> None:
        self.daemon.takes_input = takes_input

    def inject(self, inputs: Sequence[Input]) -> None:
        """Take what clients said, from a record."""
        self.daemon.inject(list(inputs))

    def begin(self, now_ns: int) -> None:
        """Hear the autopilot and its clients, who have said all that they say before ``now_ns``."""
        self._now_ns = now_ns
        self.daemon.begin_exchange(now_ns)

    def end(self) -> None:
        """Say what is to be said at this instant."""
        self.daemon.end_exchange()

    def state(self) -> messages.AircraftState:
        """Table I of the paper, as the bytes heard by this instant tell it."""
        return state_message(self.daemon.state, self._node, self._now_ns)

    def start(self, verb: str, goal: CommandGoal, on_event: OnEvent) -> None:
        """Begin to carry out ``verb``; ``on_event`` is told of progress and, once, of the result."""

        def on_progress(progress: CommandProgress) -> None:
            on_event(_progress(progress))

        def on_done(result: CommandResult) -> None:
            log.info("%s: %s", verb, result)
            on_event(CommandEvent(CommandEvent.RESULT, result.reached, str(result)))

        try:
            arguments, options = _arguments(verb, goal)
            self.daemon.commands.start(verb, *arguments, on_progress=on_progress, on_done=on_done, **options)
        except ValueError as error:
            on_event(CommandEvent(CommandEvent.RESULT, False, str(error)))


def _arguments(verb: str, goal: CommandGoal) -> tuple[tuple[Any, ...], dict[str, Any]]:
    """What the daemon's command of this name takes from a goal."""
    if verb == "mode":
        return (goal.mode,), {}
    if verb == "takeoff":
        return (goal.altitude_rel_m,), {}
    if verb == "goto":
        place = (goal.latitude_deg, goal.longitude_deg, goal.altitude_rel_m)
        return place, {"speed_mps": goal.speed_mps or None}
    return (), {}


def _progress(progress: CommandProgress) -> CommandEvent:
    phase = CommandEvent.ACCEPTED if progress.phase == "accepted" else CommandEvent.FEEDBACK
    remaining_m = math.nan if progress.remaining_m is None else progress.remaining_m
    return CommandEvent(phase, True, progress.text, remaining_m)


def state_message(state: AircraftState, node: str, sim_time_ns: int) -> messages.AircraftState:
    """Table I as a message, stamped with the tick that its bytes belong to."""
    return messages.AircraftState(
        Header.at(sim_time_ns, node),
        state.sysid,
        Vector3(state.roll_rad, state.pitch_rad, state.yaw_rad),
        state.lon_deg,
        state.lat_deg,
        state.alt_amsl_m,
        state.alt_rel_m,
        Vector3(*state.position_ned_m),
        Vector3(*state.velocity_ned_mps),
        state.indicated_airspeed_mps,
        state.groundspeed_mps,
        state.airspeed_mps,
        state.mode,
        state.base_mode,
        state.heartbeat_age_s,
        state.flight_time_s,
        state.voltage_v,
        state.current_a,
        Vector3(*state.wind_body_mps),
        state.throttle_percent,
        state.armed,
        state.ready_to_arm and state.position_ok,
    )
