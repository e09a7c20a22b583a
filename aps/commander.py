"""Commands as coroutines: ``result = await daemon.commands.takeoff(40.0)``."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable
from typing import Any

from aps import plans
from aps.commands import CommandExecution, CommandProgress, CommandResult, Outcome, Plan
from aps.status_text import StatusText
from aps.telemetry import AircraftState

__all__ = ["Commander", "OnProgress"]

OnProgress = Callable[[CommandProgress], None]

_log = logging.getLogger(__name__)


class _Running:
    def __init__(self, execution: CommandExecution, on_progress: OnProgress | None) -> None:
        self.execution = execution
        self.on_progress = on_progress
        self.done: asyncio.Future[CommandResult] = asyncio.get_running_loop().create_future()


class Commander:
    """Runs commands one after the other: a new flight command takes over from the one before.

    Every method returns when the goal is reached, or the command is refused, timed out or interrupted; see
    ``CommandResult``. ``on_progress`` is told about acceptance and, while the UA flies, how far it has to go.
    Cancelling the awaiting task ends the command's supervision, not the flight.

    Args:
        state: gives the UA's state now.
        send: sends pymavlink messages to the autopilot; returns False when there is no connection.
        now_ns: wall clock, monotonic.
        wake: called when deadlines may have changed.
    """

    def __init__(
        self,
        state: Callable[[], AircraftState],
        send: Callable[[list[Any]], bool],
        now_ns: Callable[[], int],
        wake: Callable[[], None],
    ) -> None:
        self._state, self._send, self._now_ns, self._wake = state, send, now_ns, wake
        self._running: list[_Running] = []

    @property
    def busy(self) -> bool:
        """Whether a command is under way."""
        return bool(self._running)

    async def arm(self, on_progress: OnProgress | None = None) -> CommandResult:
        """Arm the motors; refused with the autopilot's own reason."""
        return await self._run("arm", plans.arm, on_progress)

    async def disarm(self, *, force: bool = False, on_progress: OnProgress | None = None) -> CommandResult:
        """Disarm the motors; in flight only if forced."""
        return await self._run("disarm", lambda state: plans.disarm(state, force=force), on_progress)

    async def set_mode(self, mode: str, on_progress: OnProgress | None = None) -> CommandResult:
        """Change the flight mode by name, e.g. ``"GUIDED"``.

        Raises:
            ValueError: the vehicle has no such mode.
        """
        return await self._run("mode", lambda state: plans.set_mode(state, mode), on_progress)

    async def takeoff(self, alt_rel_m: float, on_progress: OnProgress | None = None) -> CommandResult:
        """Climb to a height above home, m; the UA must be armed."""
        return await self._run("takeoff", lambda state: plans.takeoff(state, alt_rel_m), on_progress)

    async def goto(
        self,
        lat_deg: float,
        lon_deg: float,
        alt_rel_m: float,
        speed_mps: float | None = None,
        on_progress: OnProgress | None = None,
    ) -> CommandResult:
        """Fly to a point in GUIDED and stay; ``alt_rel_m`` above home."""
        return await self._run(
            "goto", lambda state: plans.goto(state, lat_deg, lon_deg, alt_rel_m, speed_mps), on_progress
        )

    async def rtl(self, on_progress: OnProgress | None = None) -> CommandResult:
        """Return to launch; done when a copter has landed or a fixed wing circles over home."""
        return await self._run("rtl", plans.rtl, on_progress)

    async def land(self, on_progress: OnProgress | None = None) -> CommandResult:
        """Land; done when on the ground."""
        return await self._run("land", plans.land, on_progress)

    async def _run(
        self, verb: str, make: Callable[[AircraftState], Plan], on_progress: OnProgress | None
    ) -> CommandResult:
        state = self._state()
        if not state.vehicle_type:
            return CommandResult(verb, Outcome.REFUSED, "the autopilot has not been heard")
        plan = make(state)
        self._take_over(plan)
        running = _Running(CommandExecution(plan), on_progress)
        self._running.append(running)
        self.poll()
        try:
            return await running.done
        finally:
            running.execution.interrupt("the caller gave up")
            if running in self._running:
                self._running.remove(running)

    def _take_over(self, plan: Plan) -> None:
        for running in self._running:
            other = running.execution.plan
            if other.flight == plan.flight:
                running.execution.interrupt(f"by {plan.verb}")

    # Called by the daemon.

    def poll(self) -> None:
        """Carry all commands on: send what is due, tell progress, complete what is done."""
        state, now_ns = self._state(), self._now_ns()
        for running in list(self._running):
            messages = running.execution.poll(state, now_ns)
            if messages:
                self._send(messages)
            self._tell(running)
            if running.execution.result is not None:
                self._running.remove(running)
                if not running.done.done():
                    running.done.set_result(running.execution.result)
        self._wake()

    def _tell(self, running: _Running) -> None:
        events, running.execution.events = running.execution.events, []
        if running.on_progress is None:
            return
        for event in events:
            try:
                running.on_progress(event)
            except Exception:
                _log.exception("the progress callback of %s failed", event.verb)

    def deadline_ns(self) -> int | None:
        """When ``poll`` is due even if nothing happens."""
        deadlines = [running.execution.deadline_ns() for running in self._running]
        return min((deadline for deadline in deadlines if deadline is not None), default=None)

    def on_ack(self, command: int, result: int, progress: int) -> None:
        """COMMAND_ACK for us."""
        for running in self._running:
            running.execution.on_ack(command, result, progress)
        self.poll()

    def on_parameter(self, name: str) -> None:
        """PARAM_VALUE of the autopilot."""
        for running in self._running:
            running.execution.on_parameter(name)

    def on_text(self, text: StatusText) -> None:
        """STATUSTEXT of the autopilot."""
        for running in self._running:
            running.execution.on_text(text)

    def on_link(self, connected: bool) -> None:
        """The link went down or came back."""
        for running in self._running:
            running.execution.on_link(connected, self._now_ns())
        self.poll()

    def interrupt_all(self, reason: str) -> None:
        """End all commands, e.g. because the autopilot rebooted."""
        for running in self._running:
            running.execution.interrupt(reason)
        self.poll()
