"""Commands: ``result = await daemon.commands.takeoff(40.0)``, or ``daemon.commands.start("takeoff", 40.0, ...)``."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Any, Final

from aps.callbacks import Callbacks
from aps.timeouts import SILENCE_TIMEOUT_S
from aps.vehicle import plans
from aps.vehicle.commands import CommandExecution, CommandProgress, CommandResult, Plan
from aps.vehicle.status_text import StatusText
from aps.vehicle.telemetry import AircraftState

__all__ = ["VERBS", "CommandHandle", "Commander", "OnDone", "OnProgress"]

OnProgress = Callable[[CommandProgress], None]
OnDone = Callable[[CommandResult], None]

VERBS: Final[dict[str, Callable[..., Plan]]] = {
    "arm": plans.arm,
    "disarm": plans.disarm,
    "mode": plans.set_mode,
    "takeoff": plans.takeoff,
    "goto": plans.goto,
    "rtl": plans.rtl,
    "land": plans.land,
}
"""Verb -> what makes its plan from the state and the command's arguments."""


class CommandHandle:
    """A command that was started."""

    def __init__(
        self,
        execution: CommandExecution,
        commander: Commander,
        on_progress: OnProgress | None,
        on_done: OnDone | None,
    ) -> None:
        self.execution = execution
        self._commander, self._on_progress, self._on_done = commander, on_progress, on_done

    @property
    def verb(self) -> str:
        """What was asked for."""
        return self.execution.plan.verb

    @property
    def result(self) -> CommandResult | None:
        """How it ended; ``None`` while it is under way."""
        return self.execution.result

    def cancel(self) -> None:
        """End the command's supervision (not the flight): ``on_done`` is told that it was interrupted."""
        self.execution.interrupt("the caller gave up")
        self._commander.complete(self)

    def tell(self, callbacks: Callbacks) -> None:
        """Called by the commander: pass on what has happened since the last call."""
        events, self.execution.events = self.execution.events, []
        for event in events:
            callbacks.call(f"the progress callback of {self.verb}", self._on_progress, event)

    def end(self, callbacks: Callbacks) -> None:
        """Called by the commander, once: the command has ended."""
        callbacks.call(f"the result callback of {self.verb}", self._on_done, self.result)


class Commander:
    """Runs commands one after the other: a new flight command takes over from the one before.

    The coroutines return when the goal is reached, or the command is refused, timed out or interrupted; see
    ``CommandResult``. ``on_progress`` is told about acceptance and, while the UA flies, how far it has to go.
    Cancelling the awaiting task ends the command's supervision, not the flight.

    Args:
        state: gives the UA's state now.
        send: sends pymavlink messages to the autopilot, and remembers what waits for their acknowledgement.
        now_ns: the daemon's clock: monotonic wall time, or sim time in held mode.
        wake: called when deadlines may have changed, or messages were sent.
        callbacks: calls what users want to be told.
        silence_s: for how long, by that clock, the autopilot's may stand still under an accepted command.
    """

    def __init__(
        self,
        state: Callable[[], AircraftState],
        send: Callable[[list[Any], object], None],
        now_ns: Callable[[], int],
        wake: Callable[[], None],
        callbacks: Callbacks,
        silence_s: float = SILENCE_TIMEOUT_S,
    ) -> None:
        self._silence_s = silence_s
        self._state, self._send, self._now_ns, self._wake = state, send, now_ns, wake
        self._callbacks = callbacks
        self._running: list[CommandHandle] = []

    @property
    def busy(self) -> bool:
        """Whether a command is under way."""
        return bool(self._running)

    async def arm(self, on_progress: OnProgress | None = None) -> CommandResult:
        """Arm the motors; refused with the autopilot's own reason."""
        return await self._run("arm", on_progress)

    async def disarm(self, *, force: bool = False, on_progress: OnProgress | None = None) -> CommandResult:
        """Disarm the motors; in flight only if forced."""
        return await self._run("disarm", on_progress, force=force)

    async def set_mode(self, mode: str, on_progress: OnProgress | None = None) -> CommandResult:
        """Change the flight mode by name, e.g. ``"GUIDED"``.

        Raises:
            ValueError: the vehicle has no such mode.
        """
        return await self._run("mode", on_progress, mode)

    async def takeoff(self, alt_rel_m: float, on_progress: OnProgress | None = None) -> CommandResult:
        """Climb to a height above home, m; the UA must be armed."""
        return await self._run("takeoff", on_progress, alt_rel_m)

    async def goto(
        self,
        lat_deg: float,
        lon_deg: float,
        alt_rel_m: float,
        speed_mps: float | None = None,
        on_progress: OnProgress | None = None,
    ) -> CommandResult:
        """Fly to a point in GUIDED and stay; ``alt_rel_m`` above home."""
        return await self._run("goto", on_progress, lat_deg, lon_deg, alt_rel_m, speed_mps)

    async def rtl(self, on_progress: OnProgress | None = None) -> CommandResult:
        """Return to launch; done when a copter has landed or a fixed wing circles over home."""
        return await self._run("rtl", on_progress)

    async def land(self, on_progress: OnProgress | None = None) -> CommandResult:
        """Land; done when on the ground."""
        return await self._run("land", on_progress)

    async def _run(
        self, verb: str, on_progress: OnProgress | None, *arguments: Any, **options: Any
    ) -> CommandResult:
        done: asyncio.Future[CommandResult] = asyncio.get_running_loop().create_future()

        def on_done(result: CommandResult) -> None:
            if not done.done():
                done.set_result(result)

        handle = self.start(verb, *arguments, on_progress=on_progress, on_done=on_done, **options)
        try:
            return await done
        finally:
            handle.cancel()

    def start(
        self,
        verb: str,
        *arguments: Any,
        on_progress: OnProgress | None = None,
        on_done: OnDone | None = None,
        **options: Any,
    ) -> CommandHandle:
        """Start a command without waiting for it; its first messages are queued at once.

        Args:
            verb: one of ``VERBS``.
            arguments: as of the coroutine of that name (``mode``: ``set_mode``).
            on_progress: told about acceptance and the way to go.
            on_done: told the result, exactly once; from within this call if the command ends at once.
            options: keyword arguments, as of the coroutine (``force=True`` of ``disarm``).

        Raises:
            ValueError: no such verb, or an argument that is wrong or out of range.
        """
        if verb not in VERBS:
            raise ValueError(f"command {verb!r} is none of {', '.join(VERBS)}")
        execution = self._execution(verb, *arguments, **options)
        handle = CommandHandle(execution, self, on_progress, on_done)
        if execution.result is None:
            self._take_over(execution.plan)
        self._running.append(handle)
        self.poll()
        return handle

    def _execution(self, verb: str, *arguments: Any, **options: Any) -> CommandExecution:
        state = self._state()
        if not state.vehicle_type:
            execution = CommandExecution(Plan(verb, (), lambda _: False, 0.0, flight=False))
            execution.refuse("the autopilot has not been heard")
            return execution
        try:
            return CommandExecution(VERBS[verb](state, *arguments, **options), self._silence_s)
        except TypeError as error:
            raise ValueError(f"wrong arguments of {verb}: {error}") from error

    def _take_over(self, plan: Plan) -> None:
        for running in self._running:
            if running.execution.plan.flight == plan.flight:
                running.execution.interrupt(f"by {plan.verb}")

    def complete(self, handle: CommandHandle) -> None:
        """Called by a handle: take a command that has ended off the list, and tell its result."""
        if handle in self._running and handle.result is not None:
            self._running.remove(handle)
            handle.end(self._callbacks)

    # Called by the daemon.

    def poll(self) -> None:
        """Carry all commands on: send what is due, tell progress, complete what is done."""
        state, now_ns = self._state(), self._now_ns()
        for handle in list(self._running):
            if handle in self._running:  # else a callback has ended it
                messages = handle.execution.poll(state, now_ns)
                if messages:
                    self._send(messages, handle.execution.request)
                handle.tell(self._callbacks)
                self.complete(handle)
        self._wake()

    def deadline_ns(self) -> int | None:
        """When ``poll`` is due even if nothing happens."""
        deadlines = [running.execution.deadline_ns() for running in self._running]
        return min((deadline for deadline in deadlines if deadline is not None), default=None)

    def on_ack(self, request: object, command: int, result: int, progress: int) -> bool:
        """COMMAND_ACK for a request of ours; returns whether one of the commands waited for it."""
        waiting = [running.execution for running in self._running if running.execution.request is request]
        for execution in waiting:
            execution.on_ack(command, result, progress)
        self.poll()
        return bool(waiting)

    def on_parameter(self, name: str, value: float) -> None:
        """PARAM_VALUE of the autopilot."""
        for running in self._running:
            running.execution.on_parameter(name, value)

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
