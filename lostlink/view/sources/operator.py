"""What a viewer may do with `--control`: commands as an operator.

Those to aircraft and radios are taken at a tick and recorded as inputs; those to the clock change how fast it goes, and
no result.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable

import zenoh

from bridge.bus.clock_commands import named_speed
from bridge.bus.inbox import Inbox
from bridge.bus.keys import Keys
from bridge.bus.messages import CommandEvent, CommandGoal
from bridge.bus.replies import event_of
from bridge.bus.session import Session
from bridge.run.access import Access
from bridge.timeouts import COMMAND_QUERY_S

CLOCK_ANSWER_S = 10.0
SUPERSEDED = "superseded"
"""Outcome of a command that ended as a later one took its place."""


class Operator:
    """Commands aircraft and radios of a running simulation, and its clock (a `TimeControl`).

    Args:
        access: as operator.
        tell: called with the result of each command: node, text.
    """

    can_seek = False

    def __init__(self, access: Access, tell: Callable[[str, str], object]) -> None:
        self._access, self._tell = access, tell
        self._keys = Keys(access.run)
        self._session: Session | None = None
        self._loop = asyncio.get_running_loop()

    async def open(self) -> None:
        """Join the run.

        Raises:
            SessionError: it is over, or does not let us in.
        """
        self._session = await asyncio.to_thread(self._access.open)

    def command(
        self,
        node: str,
        verb: str,
        goal: CommandGoal | None = None,
        on_done: Callable[[], object] = lambda: None,
    ) -> None:
        """Ask for a command; its result is reported. ``on_done`` is called when it is done, unless it fails."""
        assert self._session is not None, "an operator commands after it has joined"
        inbox: Inbox[CommandEvent] = Inbox(
            self._loop, lambda event: self._on_event(node, verb, event, on_done)
        )
        self._tell(node, f"{verb}: asked")
        self._session.query(
            self._keys.command(node, verb),
            goal or CommandGoal(),
            lambda reply: inbox.push(event_of(reply)),
            lambda: None,
            timeout_s=COMMAND_QUERY_S,
        )

    def _on_event(self, node: str, verb: str, event: CommandEvent, on_done: Callable[[], object]) -> None:
        if event.phase == CommandEvent.ACCEPTED:
            self._tell(node, f"{verb}: accepted")
        elif event.phase == CommandEvent.RESULT:
            outcome = "failed" if not event.success else SUPERSEDED if event.outcome == SUPERSEDED else "done"
            self._tell(node, f"{verb}: {outcome} ({event.text})" if event.text else f"{verb}: {outcome}")
            if outcome == "done":
                on_done()

    # The clock.

    def pause(self) -> None:
        """Hold sim time."""
        self._ask_clock("pause")

    def resume(self) -> None:
        """Let it go on."""
        self._ask_clock("resume")

    def step(self) -> None:
        """One tick further, and hold."""
        self._ask_clock("step")

    def speed(self, factor: float) -> None:
        """Sim time per wall time; infinite: as fast as possible."""
        self._ask_clock("speed", str(named_speed(factor)))

    def seek(self, sim_time_s: float) -> None:
        """Raises ValueError: time goes forward only."""
        raise ValueError(f"a running simulation cannot go to {sim_time_s} s")

    def _ask_clock(self, verb: str, number: str = "") -> None:
        assert self._session is not None, "an operator commands after it has joined"
        asked = f"{verb} {number}".strip()
        inbox: Inbox[zenoh.Reply] = Inbox(self._loop, lambda reply: self._on_clock_answer(asked, reply))
        key = self._keys.clock_command(verb)
        self._session.query_bytes(key, number.encode(), inbox.push, timeout_s=CLOCK_ANSWER_S)

    def _on_clock_answer(self, asked: str, reply: zenoh.Reply) -> None:
        why = "" if reply.ok is not None or reply.err is None else reply.err.payload.to_string()
        self._tell("", f"{asked}: refused ({why})" if why else f"{asked}: done")

    async def close(self) -> None:
        """Leave."""
        if self._session is not None:
            await asyncio.to_thread(self._session.close)
