"""A program attached to a node, from its start to whatever ends it: itself, the run, or the user."""

from __future__ import annotations

import asyncio
import signal
import threading
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Final

from bridge.bus.keys import Keys
from bridge.bus.session import Session
from lostlink.attach.forwarder import Forwarder
from lostlink.attach.link import IpLink
from lostlink.attach.plan import AttachPlan
from lostlink.attach.program import GRACE_S, Program

INTERFACE: Final = "radio0"
LOOK_PERIOD_S: Final = 0.5
"""So often it is seen whether the run still goes on: one that was killed says no word."""
SIGNALS: Final = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT)
Say = Callable[[str], object]


def attach(plan: AttachPlan, command: Sequence[str], say: Say) -> tuple[int, Forwarder]:
    """Have the program attached; returns its exit code, and the counts of its packets.

    Raises:
        NoProgram: its namespace cannot be made.
        SessionError: the run lets nobody in.
    """
    blocked = signal.pthread_sigmask(signal.SIG_BLOCK, SIGNALS)
    node = plan.node.node
    forwarder = Forwarder(node, plan.addresses, plan.subnet, plan.mtu_bytes)
    own, netmask = str(plan.addresses[node]), str(plan.subnet.netmask)
    program = Program.prepare(INTERFACE, own, netmask, plan.mtu_bytes, plan.hosts, command)
    status = 0
    try:
        with plan.access.open() as session:
            asyncio.run(_Attached(plan, program, forwarder, say).live(session))
    finally:
        status = program.close()
        signal.pthread_sigmask(signal.SIG_SETMASK, blocked)
    return status, forwarder


class _Attached:
    """While the program runs."""

    def __init__(self, plan: AttachPlan, program: Program, forwarder: Forwarder, say: Say) -> None:
        self._plan, self._program, self._forwarder, self._say = plan, program, forwarder, say
        self._ends = False

    async def live(self, session: Session) -> None:
        """Let the program begin, and wait for its end."""
        loop, over = asyncio.get_running_loop(), asyncio.Event()
        keys = Keys(self._plan.access.run)
        link = IpLink(
            session,
            keys,
            self._plan.node.node,
            self._plan.radio,
            self._forwarder,
            self._program.tun,
            self._run_ended,
        )
        for line in (*self._plan.lines(), *filter(None, [self._program.remark])):
            self._say(line)
        self._pass_signals_on(loop)
        loop.add_reader(self._program.pidfd, over.set)
        link.open()
        self._program.go()
        while not over.is_set():
            with suppress(TimeoutError):
                async with asyncio.timeout(LOOK_PERIOD_S):
                    await over.wait()
            if not self._plan.directory.is_live:
                self._run_ended()
        loop.remove_reader(self._program.pidfd)
        link.close()

    def _run_ended(self) -> None:
        if not self._ends:
            self._say("the run is over: ends the program")
            self._end()

    def _end(self) -> None:
        """Have the program end, if need be in a while and by force."""
        if not self._ends:
            self._ends = True
            self._program.end()
            asyncio.get_running_loop().call_later(GRACE_S, self._program.kill)

    def _came(self, number: int) -> None:
        """Somebody sent us a signal: it is for the program."""
        if number in (signal.SIGTERM, signal.SIGHUP):
            self._end()
        else:
            self._program.signal(number)

    def _pass_signals_on(self, loop: asyncio.AbstractEventLoop) -> None:
        """What a terminal sends (Ctrl-C) the program has got as well, being of the same group."""

        def wait() -> None:
            while True:
                came = signal.sigwaitinfo(SIGNALS)
                if came.si_code <= 0 or came.si_signo in (signal.SIGTERM, signal.SIGHUP):
                    with suppress(RuntimeError):  # the loop is closed: the program has ended
                        loop.call_soon_threadsafe(self._came, came.si_signo)

        threading.Thread(target=wait, name="signals", daemon=True).start()
