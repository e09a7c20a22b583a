"""One aircraft on Zenoh: its state as messages, and its commands as queryables.

`AircraftBridge` joins an APS daemon with a session; the process around it is in `bridge.aircraft.process`.
"""

from __future__ import annotations

import asyncio
import logging
import math
from collections.abc import Awaitable, Callable, Mapping

import zenoh

from aps.commands import CommandProgress, CommandResult
from aps.daemon import Daemon
from aps.telemetry import AircraftState
from bridge.bus import messages
from bridge.bus.inbox import Inbox
from bridge.bus.keys import Keys
from bridge.bus.messages import (
    Clock,
    CommandEvent,
    CommandGoal,
    DecodeError,
    Header,
    Vector3,
    decode,
    encode,
    encoding_of,
)
from bridge.bus.session import Query, Sample, Session

STATE_RATE_HZ = 10
OnProgress = Callable[[CommandProgress], None]
log = logging.getLogger("aircraft")


def state_message(state: AircraftState, node: str, sim_time_ns: int) -> messages.AircraftState:
    """Table I as a message."""
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


class AircraftBridge:
    """Publishes the state at STATE_RATE_HZ of sim time and serves the commands of one UA."""

    def __init__(self, session: Session, keys: Keys, node: str, daemon: Daemon) -> None:
        self._session = session
        self._keys = keys
        self._node = node
        self._daemon = daemon
        self._next_state_ns = 0
        self._tasks: set[asyncio.Task[None]] = set()
        loop = asyncio.get_running_loop()
        ticks: Inbox[Sample] = Inbox(loop, self._on_clock, limit=1000)
        queries: Inbox[tuple[str, Query]] = Inbox(loop, self._on_query, limit=1000)
        session.subscribe(keys.clock, ticks.push)
        for verb in self._verbs:
            session.serve(keys.command(node, verb), lambda query, verb=verb: queries.push((verb, query)))  # type: ignore[misc]

    @property
    def _verbs(self) -> Mapping[str, Callable[[CommandGoal, OnProgress], Awaitable[CommandResult]]]:
        commands = self._daemon.commands
        return {
            "arm": lambda _, tell: commands.arm(on_progress=tell),
            "disarm": lambda _, tell: commands.disarm(on_progress=tell),
            "mode": lambda goal, tell: commands.set_mode(goal.mode, on_progress=tell),
            "takeoff": lambda goal, tell: commands.takeoff(goal.altitude_rel_m, on_progress=tell),
            "goto": lambda goal, tell: commands.goto(
                goal.latitude_deg,
                goal.longitude_deg,
                goal.altitude_rel_m,
                speed_mps=goal.speed_mps or None,
                on_progress=tell,
            ),
            "rtl": lambda _, tell: commands.rtl(on_progress=tell),
            "land": lambda _, tell: commands.land(on_progress=tell),
        }

    def _on_clock(self, sample: Sample) -> None:
        try:
            sim_time_ns = decode(sample.payload.to_bytes(), Clock).header.stamp.ns
        except DecodeError as error:
            log.warning("%s", error)
            return
        if sim_time_ns >= self._next_state_ns:
            self._next_state_ns = sim_time_ns + 1_000_000_000 // STATE_RATE_HZ
            message = state_message(self._daemon.state, self._node, sim_time_ns)
            self._session.put(self._keys.state(self._node), message)

    def _on_query(self, item: tuple[str, Query]) -> None:
        task = asyncio.create_task(self._carry_out(*item))
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def _carry_out(self, verb: str, query: Query) -> None:
        with query:
            try:
                goal = decode(query.payload.to_bytes(), CommandGoal) if query.payload else CommandGoal()
                result = await self._verbs[verb](
                    goal, lambda progress: self._reply(verb, query, _progress(progress))
                )
            except (DecodeError, ValueError) as error:
                event = CommandEvent(CommandEvent.RESULT, False, str(error))
            else:
                event = CommandEvent(CommandEvent.RESULT, result.reached, str(result))
            log.info("%s: %s", verb, event.text)
            self._reply(verb, query, event)

    def _reply(self, verb: str, query: Query, event: CommandEvent) -> None:
        try:
            query.reply(
                self._keys.command(self._node, verb), encode(event), encoding=encoding_of(CommandEvent)
            )
        except zenoh.ZError as error:
            log.warning("%s: whoever asked is gone: %s", verb, error)


def _progress(progress: CommandProgress) -> CommandEvent:
    phase = CommandEvent.ACCEPTED if progress.phase == "accepted" else CommandEvent.FEEDBACK
    remaining_m = math.nan if progress.remaining_m is None else progress.remaining_m
    return CommandEvent(phase, True, progress.text, remaining_m)
