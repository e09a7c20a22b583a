"""One aircraft at the ticks: its autopilot's MAVLink is exchanged, its state becomes a message, its commands start.

`AircraftBridge` joins a held APS daemon (`aps.held`) with the run; it does no I/O of its own.
"""

from __future__ import annotations

import json
import logging
import math
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any, Final, NamedTuple

from aps.held import HeldDaemon
from aps.inputs import Input
from aps.timeouts import LINK_LOSS_TIMEOUT_S
from aps.vehicle.commander import check_names
from aps.vehicle.execution import NS_PER_S, CommandProgress, CommandResult, Outcome
from aps.vehicle.telemetry import VehicleState
from bridge.aircraft.body import OnEvent
from bridge.bus import messages
from bridge.bus.messages import CommandEvent, CommandGoal, Header, Vector3

log = logging.getLogger("aircraft")

AGED: Final = (
    ("mode", None),
    ("voltage_v", "position_ok"),
    ("roll_rad", None),
    ("lat_deg", None),
    ("position_ned_m", None),
    ("velocity_ned_mps", None),
    ("groundspeed_mps", None),
    ("airspeed_mps", None),
    ("wind_body_mps", None),
    ("current_a", None),
    ("flight_time_s", None),
)
"""By place in a message's ``age_s``: the field of the daemon's state, and another one if the older of two counts."""


class _Early(NamedTuple):
    """A command for an autopilot that has not been heard yet."""

    until_ns: int
    verb: str
    arguments: dict[str, Any]
    on_event: OnEvent


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
        self._early: list[_Early] = []

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

    def swap(self) -> None:
        """With lookahead: say what was decided at the instant before, and hear what the autopilot has said since."""
        self.daemon.swap()

    def begin(self, now_ns: int) -> None:
        """Hear the autopilot and its clients, who have said all that they say before ``now_ns``."""
        self._now_ns = now_ns
        self.daemon.begin_exchange(now_ns)
        if self._early:
            self._look_at_early()

    def end(self) -> None:
        """Say what is to be said at this instant."""
        self.daemon.end_exchange()

    def state(self) -> messages.AircraftState:
        """Table I of the paper, as the bytes heard by this instant report it."""
        return state_message(self.daemon.state, self._node, self._now_ns)

    def start(self, verb: str, goal: CommandGoal, on_event: OnEvent) -> None:
        """Begin to carry out ``verb``, as soon as the autopilot has been heard.

        ``on_event`` is called with progress and, once, with the result.
        """
        try:
            arguments = _arguments(verb, goal)
            check_names(verb, arguments)
        except ValueError as error:
            on_event(_refusal(error))
            return
        if self._is_heard:
            self._start(verb, arguments, on_event)
        else:
            until_ns = self._now_ns + round(LINK_LOSS_TIMEOUT_S * NS_PER_S)
            self._early.append(_Early(until_ns, verb, arguments, on_event))

    @property
    def _is_heard(self) -> bool:
        return self.daemon.vehicle.telemetry.vehicle_type != 0

    def _look_at_early(self) -> None:
        """Start what waits for the autopilot, in its order, or end what has waited too long."""
        early, self._early = self._early, []
        for one in early:
            if self._is_heard:
                self._start(one.verb, one.arguments, one.on_event)
            elif self._now_ns < one.until_ns:
                self._early.append(one)
            else:
                reason = f"the autopilot has not been heard for {LINK_LOSS_TIMEOUT_S:g} s"
                one.on_event(_result(CommandResult(one.verb, Outcome.TIMED_OUT, reason)))

    def _start(self, verb: str, arguments: dict[str, Any], on_event: OnEvent) -> None:
        def on_progress(progress: CommandProgress) -> None:
            on_event(_progress(progress))

        def on_done(result: CommandResult) -> None:
            log.info("%s: %s", verb, result)
            on_event(_result(result))

        try:
            self.daemon.commands.start_named(verb, arguments, on_progress=on_progress, on_done=on_done)
        except ValueError as error:
            on_event(_refusal(error))

    def last_message(self, name: str) -> dict[str, Any] | None:
        """The last MAVLink message of a type that the autopilot sent; ``None`` if there is none.

        Raises:
            ValueError: there is no message of this name; the error names those that were heard.
        """
        messages = self.daemon.vehicle.messages
        try:
            last = messages.last(name, self._now_ns)
        except ValueError as error:
            raise ValueError(f"{error}; heard so far: {', '.join(messages.names()) or 'none'}") from None
        return None if last is None else asdict(last)


def _arguments(verb: str, goal: CommandGoal) -> dict[str, Any]:
    """What the daemon's command of this name takes from a goal: its fields, and over them its ``arguments``."""
    arguments: dict[str, Any] = {}
    if verb == "mode":
        arguments = {"mode": goal.mode}
    elif verb == "takeoff":
        arguments = {"alt_rel_m": goal.altitude_rel_m}
    elif verb == "goto":
        arguments = {
            "lat_deg": goal.latitude_deg,
            "lon_deg": goal.longitude_deg,
            "alt_rel_m": goal.altitude_rel_m,
            "speed_mps": goal.speed_mps or None,
        }
    return arguments | (_object(goal.arguments) if goal.arguments else {})


def _object(text: str) -> dict[str, Any]:
    try:
        content = json.loads(text)
    except RecursionError as error:
        raise ValueError("the arguments are nested too deep") from error
    except json.JSONDecodeError as error:
        raise ValueError(f"arguments are a JSON object, not {text[:40]!r}: {error}") from error
    if not isinstance(content, dict):
        raise ValueError(f"arguments are a JSON object, not {text[:40]!r}")
    return content


def _refusal(error: ValueError) -> CommandEvent:
    return CommandEvent(CommandEvent.RESULT, False, str(error), outcome=Outcome.REFUSED.value)


def _progress(progress: CommandProgress) -> CommandEvent:
    phase = CommandEvent.ACCEPTED if progress.phase == "accepted" else CommandEvent.FEEDBACK
    remaining_m = math.nan if progress.remaining_m is None else progress.remaining_m
    done = -1 if progress.done is None else progress.done
    total = -1 if progress.total is None else progress.total
    outcome = Outcome.REFUSED.value if progress.refused else ""
    return CommandEvent(phase, True, progress.text, remaining_m, outcome, done=done, total=total)


def _result(result: CommandResult) -> CommandEvent:
    success = result.reached or result.outcome is Outcome.SUPERSEDED
    value = "" if result.value is None else json.dumps(result.value)
    return CommandEvent(CommandEvent.RESULT, success, str(result), outcome=result.outcome.value, value=value)


def _ages_s(state: VehicleState) -> tuple[float, ...]:
    age_s = state.age_s
    return tuple([age_s(name) if other is None else max(age_s(name), age_s(other)) for name, other in AGED])


def state_message(state: VehicleState, node: str, sim_time_ns: int) -> messages.AircraftState:
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
        _ages_s(state),
    )
