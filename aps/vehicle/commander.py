"""Commands: ``result = await daemon.commands.takeoff(40.0)``, or ``daemon.commands.start("takeoff", 40.0, ...)``."""

from __future__ import annotations

import asyncio
import inspect
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from functools import cache
from typing import Any, Final, TypeGuard

from aps.callbacks import Callbacks
from aps.timeouts import SHOWN_LAG_S, SILENCE_TIMEOUT_S
from aps.vehicle import messages
from aps.vehicle.commands.command_execution import NO_LINK, NOT_ARMED, CommandExecution
from aps.vehicle.commands.plan import ARMING, FLIGHT, CommandPlan
from aps.vehicle.execution import NS_PER_S, CommandProgress, CommandResult, Execution, Refusal
from aps.vehicle.flight import orbit, plans, targets
from aps.vehicle.missions import fly, transfer
from aps.vehicle.parameters import transfer as parameters
from aps.vehicle.parameters.everything import get_all
from aps.vehicle.status_text import StatusText
from aps.vehicle.telemetry import VehicleState
from aps.wire.dialect import mavlink

OnProgress = Callable[[CommandProgress], None]
OnDone = Callable[[CommandResult], None]

VERBS: Final[dict[str, Callable[..., CommandPlan | Execution]]] = {
    "arm": plans.arm,
    "disarm": plans.disarm,
    "mode": plans.set_mode,
    "takeoff": plans.takeoff,
    "hold": targets.hold,
    "goto": targets.goto,
    "goto_ned": targets.goto_ned,
    "velocity": targets.velocity,
    "follow": targets.follow,
    "orbit": orbit.orbit,
    "speed": plans.change_speed,
    "rtl": plans.rtl,
    "land": plans.land,
    "reboot": plans.reboot,
    "mission": fly.fly,
    "mission_set_current": fly.set_current,
    "mission_upload": transfer.upload,
    "mission_download": transfer.download,
    "mission_clear": transfer.clear,
    "parameter_get": parameters.get,
    "parameter_set": parameters.set_one,
    "parameters_set": parameters.set_all,
    "parameters": get_all,
    "message": messages.request,
    "send": messages.send,
}
"""Verb -> what makes its plan or execution from the state and the command's arguments."""
UPLOAD_REASON_NS: Final = 10_000_000_000
"""For so long what was said since an upload began may be why the mission is refused: PX4 acknowledges the upload, then
says what is wrong with it, once."""
MOST_TEXTS: Final = 32
"""That are kept of them."""
_TAKES_OVER: Final = frozenset({FLIGHT, ARMING})
"""What a newer command takes from the one before; of anything else that is occupied it is refused."""
_ARM: Final = frozenset({int(mavlink.MAV_CMD_COMPONENT_ARM_DISARM), int(mavlink.MAV_CMD_MISSION_START)})
"""What may arm the UA; PX4 does with MISSION_START, too."""


class CommandHandle:
    """A command that was started."""

    def __init__(
        self,
        execution: Execution,
        commander: Commander,
        on_progress: OnProgress | None,
        on_done: OnDone | None,
    ) -> None:
        self.execution = execution
        self._commander, self._on_progress, self._on_done = commander, on_progress, on_done

    @property
    def verb(self) -> str:
        """What was asked for."""
        return self.execution.verb

    @property
    def result(self) -> CommandResult | None:
        """How it ended; ``None`` while it is under way."""
        return self.execution.result

    def cancel(self) -> None:
        """End the command's supervision (not the flight): ``on_done`` is called with an interruption."""
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
    ``CommandResult``. ``on_progress`` is called on acceptance and, while the UA flies, with the way to go.
    Cancelling the awaiting task ends the command's supervision, not the flight.

    Args:
        state: gives the UA's state now.
        send: sends pymavlink messages to the autopilot, and remembers what waits for their acknowledgement.
        now_ns: the daemon's clock: monotonic wall time, or sim time in held mode.
        wake: called when deadlines may have changed, or messages were sent.
        callbacks: calls users' functions.
        silence_s: for how long, by that clock, the autopilot's may stand still under an accepted command.
    """

    def __init__(
        self,
        state: Callable[[], VehicleState],
        send: Callable[[list[Any], object], None],
        now_ns: Callable[[], int],
        wake: Callable[[], None],
        callbacks: Callbacks,
        silence_s: float = SILENCE_TIMEOUT_S,
    ) -> None:
        self._silence_s = silence_s
        self._state, self._send, self._now_ns, self._wake = state, send, now_ns, wake
        self._callbacks = callbacks
        self.ftp = True
        """Whether files may be read by MAVLink FTP. ArduPilot serves them in a thread of its own, whose answers come
        when the machine lets them: a simulation that is to repeat does without."""
        self.on_flight: Callable[[str], None] = lambda _: None
        """Called with each flight command, before its first message: the mode with sticks in which it leaves the UA."""
        self._running: list[CommandHandle] = []
        self._said: deque[tuple[int, StatusText]] | None = None
        """What the autopilot has said since the latest upload of a mission began, and when."""
        self._has_circled = False
        """Whether the newest flight command is an ``orbit``."""
        self._arming_ns = 0
        """From when on a heartbeat shows what became of the last command that may arm the UA."""

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
        **options: Any,
    ) -> CommandResult:
        """Fly to a point in GUIDED and stay; ``alt_rel_m`` above home. Options: see ``targets.goto``."""
        return await self._run("goto", on_progress, lat_deg, lon_deg, alt_rel_m, speed_mps, **options)

    async def rtl(self, on_progress: OnProgress | None = None) -> CommandResult:
        """Return to launch; done when a copter has landed or a fixed wing circles over home."""
        return await self._run("rtl", on_progress)

    async def land(self, on_progress: OnProgress | None = None) -> CommandResult:
        """Land; done when on the ground."""
        return await self._run("land", on_progress)

    async def run(
        self, verb: str, *arguments: Any, on_progress: OnProgress | None = None, **options: Any
    ) -> CommandResult:
        """Any command of ``VERBS``; what each takes is said by the function that it names.

        Raises:
            ValueError: no such verb, or an argument that is wrong or out of range.
        """
        return await self._run(verb, on_progress, *arguments, **options)

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
            arguments: as of the function that ``VERBS`` names, without the state.
            on_progress: called on acceptance, and with the way to go.
            on_done: called with the result, exactly once; from within this call if the command ends at once.
            options: keyword arguments, likewise.

        Raises:
            ValueError: no such verb, or an argument that is wrong or out of range.
        """
        _check_verb(verb)
        return self.begin(self._execution(verb, *arguments, **options), on_progress, on_done)

    def begin(
        self, execution: Execution, on_progress: OnProgress | None = None, on_done: OnDone | None = None
    ) -> CommandHandle:
        """As ``start``, of what has been made already."""
        handle = CommandHandle(execution, self, on_progress, on_done)
        if not self._state().link_open:
            execution.refuse(NO_LINK)
        elif _flies(execution) and self._is_disarmed():
            execution.interrupt(NOT_ARMED)
        if execution.result is None:
            self._take_over(execution)
            self._explain(execution)
            if isinstance(execution, CommandExecution) and execution.occupies == FLIGHT:
                self._has_circled = execution.verb == "orbit"
                self.on_flight(execution.plan.stick_mode)
        self._running.append(handle)
        self.poll()
        return handle

    def start_named(
        self,
        verb: str,
        arguments: Mapping[str, Any],
        *,
        on_progress: OnProgress | None = None,
        on_done: OnDone | None = None,
    ) -> CommandHandle:
        """As ``start``, with the arguments of somebody else, by name.

        Raises:
            ValueError: no such verb, or an argument that is wrong, missing or unknown.
        """
        check_names(verb, arguments)
        return self.start(verb, on_progress=on_progress, on_done=on_done, **arguments)

    def check(self, verb: str, arguments: Mapping[str, Any]) -> None:
        """See that ``start_named`` would take these arguments now; nothing is started.

        Raises:
            ValueError: no such verb, or an argument that is wrong, missing or unknown.
        """
        check_names(verb, arguments)
        self._execution(verb, **arguments)

    def _execution(self, verb: str, *arguments: Any, **options: Any) -> Execution:
        state = self._state()
        if not state.vehicle_type:
            return _refused(verb, "the autopilot has not been heard")
        make = VERBS[verb]
        if verb == "parameters" and not self.ftp:
            options["ftp"] = False
        try:
            made = make(state, *arguments, **options)
        except Refusal as refusal:
            return _refused(verb, str(refusal))
        except (TypeError, OverflowError) as error:
            raise ValueError(f"wrong arguments of {verb}: {error}") from error
        if not isinstance(made, CommandPlan):
            return made
        if self._has_circled:
            made = replace(made, steps=(*made.after_circle, *made.steps))
        return CommandExecution(made, self._silence_s)

    def _is_disarmed(self) -> bool:
        """Whether a heartbeat says so that is no older than what may have armed the UA since."""
        state = self._state()
        heard_ns = state.heard_ns.get(mavlink.MAVLINK_MSG_ID_HEARTBEAT, -1)
        return state.connected and not state.armed and heard_ns >= self._arming_ns

    def _take_over(self, newer: Execution) -> None:
        """Give the newer command what it occupies, or refuse it."""
        for handle in self._running:
            older = handle.execution
            if newer.verb == "speed" and isinstance(older, CommandExecution):
                older.setpoints.leave_speed()
            if not newer.occupies or older.occupies != newer.occupies or older.result is not None:
                continue
            if newer.occupies not in _TAKES_OVER:
                newer.refuse(f"{older.verb} is under way")
            elif _is_target(older) and _is_target(newer):
                older.supersede(f"by {newer.verb}")
                newer.setpoints.leads_on(older.setpoints)
            else:
                older.interrupt(f"by {newer.verb}")

    def _explain(self, newer: Execution) -> None:
        """Tell a mission what was said to its upload."""
        if isinstance(newer, transfer.UploadExecution):
            self._said = deque(maxlen=MOST_TEXTS)
        elif newer.verb == "mission" and isinstance(newer, CommandExecution) and self._said is not None:
            since_ns = self._now_ns() - UPLOAD_REASON_NS
            newer.steps.follows(text for at_ns, text in self._said if at_ns >= since_ns)

    def complete(self, handle: CommandHandle) -> None:
        """Called by a handle: take a command that has ended off the list, and report its result."""
        if handle in self._running and handle.result is not None:
            self._running.remove(handle)
            handle.end(self._callbacks)

    # Called by the daemon.

    def poll(self) -> None:
        """Carry all commands on: send what is due, report progress, complete what is done."""
        state, now_ns = self._state(), self._now_ns()
        for handle in list(self._running):
            if handle in self._running:  # else a callback has ended it
                messages = handle.execution.poll(state, now_ns)
                if messages:
                    self._send(messages, handle.execution.request)
                handle.tell(self._callbacks)
                self.complete(handle)
        self._wake()

    def wants(self, msg_id: int) -> bool:
        """Whether a command under way waits for messages of a type."""
        return any(msg_id in running.execution.wanted for running in self._running)

    def deadline_ns(self) -> int | None:
        """When ``poll`` is due even if nothing happens."""
        deadlines = [running.execution.deadline_ns() for running in self._running]
        return min((deadline for deadline in deadlines if deadline is not None), default=None)

    def command_sent(self, command: int) -> None:
        """A MAV_CMD goes to the autopilot, of ours or of a client's."""
        if command in _ARM:
            self._arming_ns = self._now_ns() + round(SHOWN_LAG_S * NS_PER_S)

    def on_ack(self, request: object, command: int, result: int, progress: int) -> bool:
        """COMMAND_ACK for a request of ours; returns whether one of the commands waited for it."""
        waiting = [running.execution for running in self._running if running.execution.request is request]
        for execution in waiting:
            execution.on_ack(command, result, progress)
        self.poll()
        return bool(waiting)

    def on_message(self, name: str, fields: Mapping[str, Any]) -> None:
        """A message of the autopilot that is for us or for all, and feeds neither state nor acknowledgements alone."""
        now_ns = self._now_ns()
        for running in self._running:
            running.execution.on_message(name, fields, now_ns)
        self.poll()

    def on_other_system(self, sysid: int, fields: Mapping[str, Any]) -> None:
        """PARAM_VALUE of another system's autopilot on the link: perhaps of ours, which has been renamed."""
        for running in self._running:
            running.execution.on_other_system(sysid, fields)
        self.poll()

    def on_reboot(self) -> None:
        """The autopilot has rebooted: commands end, that which asked for it with success."""
        for running in self._running:
            running.execution.on_reboot()
        self.poll()

    def on_text(self, text: StatusText) -> None:
        """STATUSTEXT of the autopilot."""
        if self._said is not None:
            self._said.append((self._now_ns(), text))
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


@cache
def _check_verb(verb: str) -> None:
    if verb not in VERBS:
        raise ValueError(f"command {verb!r} is none of {', '.join(VERBS)}")


def check_names(verb: str, arguments: Iterable[str]) -> None:
    """See that there is such a command with arguments of such names.

    Raises:
        ValueError: there is not; the text has what there is.
    """
    _check_verb(verb)
    known = argument_names(verb)
    for name in arguments:
        if name not in known:
            raise ValueError(f"{verb} has no argument {name!r}: {', '.join(known) or 'it has none'}")


def argument_names(verb: str) -> tuple[str, ...]:
    """What a verb can be given, by name."""
    return tuple(inspect.signature(VERBS[verb]).parameters)[1:]


def _is_target(execution: Execution) -> TypeGuard[CommandExecution]:
    return isinstance(execution, CommandExecution) and execution.plan.target


def _flies(execution: Execution) -> bool:
    """Whether it is nothing for a UA that is not armed."""
    if isinstance(execution, CommandExecution) and execution.plan.launches:
        return True
    return _is_target(execution) and not execution.plan.may_stand


def _refused(verb: str, reason: str) -> Execution:
    execution = CommandExecution(CommandPlan(verb, (), lambda _: False, 0.0, occupies=""))
    execution.refuse(reason)
    return execution
