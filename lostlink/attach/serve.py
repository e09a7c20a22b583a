"""A program attached to a node, from its start to whatever ends it: itself, the run, or the user."""

from __future__ import annotations

import asyncio
import os
import signal
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Final

from bridge.bus.keys import Keys
from bridge.bus.session import Session
from lostlink.attach.forwarder import Dropped, Forwarder
from lostlink.attach.link import IpLink
from lostlink.attach.plan import AttachPlan
from lostlink.attach.program import GRACE_S, AttachedProgram
from lostlink.flight.signals import ending_signals

INTERFACE: Final = "radio0"
LOOK_PERIOD_S: Final = 0.5
"""So often it is seen whether the run still goes on: one that was killed says no word."""
Say = Callable[[str], object]


def attach(plan: AttachPlan, command: Sequence[str], say: Say, warn: Say) -> tuple[int, Forwarder]:
    """Have the program attached; returns its exit code, and the counts of its packets.

    Args:
        plan: of the attachment.
        command: the program, with its arguments.
        say: told how it goes.
        warn: told what makes its times wrong.

    Raises:
        NoProgram: its namespace cannot be made.
        SessionError: the run lets nobody in.
    """
    node = plan.node.node
    forwarder = Forwarder(node, plan.addresses, plan.subnet, plan.mtu_bytes)
    own, netmask = str(plan.addresses[node]), str(plan.subnet.netmask)
    program = AttachedProgram.prepare(INTERFACE, own, netmask, plan.mtu_bytes, plan.hosts, command)
    status = 0
    try:
        with plan.access.open() as session:
            asyncio.run(_Attached(plan, program, forwarder, say, warn).live(session))
    finally:
        for number in _passed_on():  # what is left of the program has to be ended first
            signal.signal(number, signal.SIG_IGN)
        status = program.close()
        forwarder.dropped += Counter({Dropped.NOT_READ: program.unread_packets})
    return status, forwarder


class _Attached:
    """While the program runs."""

    def __init__(
        self, plan: AttachPlan, program: AttachedProgram, forwarder: Forwarder, say: Say, warn: Say
    ) -> None:
        self._plan, self._program, self._forwarder = plan, program, forwarder
        self._say, self._warn = say, warn
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
        for number in _passed_on():
            loop.add_signal_handler(number, self._came, number)
        loop.add_reader(self._program.pidfd, over.set)
        link.open()
        self._program.go()
        while not over.is_set():
            with suppress(TimeoutError):
                async with asyncio.timeout(LOOK_PERIOD_S):
                    await over.wait()
            if not over.is_set() and not self._plan.directory.is_live:
                self._run_ended()
        loop.remove_reader(self._program.pidfd)
        link.close()
        if link.clock.warning:
            self._warn(link.clock.warning)

    def _run_ended(self) -> None:
        if not self._ends:
            self._say("the run is over: ends the program")
            self._end()

    def _end(self) -> None:
        """Have the program end, if need be in a while and by force."""
        if not self._ends:
            self._ends = True
            asyncio.get_running_loop().call_later(GRACE_S, self._program.kill)
            self._program.end()

    def _came(self, number: int) -> None:
        """Somebody sent us a signal: it is for the program."""
        if number in (signal.SIGTERM, signal.SIGHUP):
            self._end()
        elif not _is_in_front():
            self._program.signal(number)


def _passed_on() -> tuple[signal.Signals, ...]:
    return (*ending_signals(), signal.SIGQUIT)


def _is_in_front() -> bool:
    """Whether a terminal has us in front: then what it sends (Ctrl-C) the program has got as well."""
    try:
        terminal = os.open("/dev/tty", os.O_RDONLY | os.O_NOCTTY | os.O_CLOEXEC)
    except OSError:
        return False
    try:
        return os.tcgetpgrp(terminal) == os.getpgrp()
    except OSError:
        return False
    finally:
        os.close(terminal)
