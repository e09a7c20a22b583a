"""When PX4s that have booted are at rest, told by a process that runs on their core only then.

To look at each of a PX4's threads in /proc takes as long as its frame. But where its threads are real-time ones on one
core, any that can run does so before a probe whose priority is the lowest of them: when the probe runs, all of them
wait. It is asked when a frame is answered; the next one is computed while PX4 ends what the frame has set going.
"""

from __future__ import annotations

import contextlib
import logging
import os
import subprocess
from collections.abc import Callable, Sequence
from functools import partial

from fdm.exchange.px4.one_core import core_in_order
from fdm.module_process import start_module

PROBE = "fdm.exchange.px4.idle_core_probe"
READY, PLACES = 255, 255
"""What the probe says when it is ready; else it says the place of a PX4, of which there are so many."""
JOIN, LEAVE, ASK = "join", "leave", "ask"
"""First words of what it is told."""
AT_ONCE = 2
"""PX4s of a core that fly in turn: one computes its frame while the other's next one is computed."""
END_S = 1.0
"""Wall time for the probe to end."""
_READ_BYTES = 4096
_log = logging.getLogger(__name__)


class IdleCore:
    """Asks whether PX4s that share a core are at rest. Its program is `fdm.exchange.px4.idle_core_probe`.

    Args:
        core: the core; all threads of the PX4s are on it.

    Attributes:
        is_ready: whether the probe runs, as it has said. One that may have no real-time priority never does.
        is_over: whether it has ended.
        asked: places of those of whom it was asked, and has not said yet, that they are at rest.
        flying: places of those that have their turn.

    Raises:
        OSError: no process can be started.
    """

    def __init__(self, core: int) -> None:
        self.is_ready = self.is_over = False
        self.asked: set[int] = set()
        self.flying: set[int] = set()
        self._joined = 0
        with contextlib.ExitStack() as ours, contextlib.ExitStack() as theirs:
            their_read, self._write = os.pipe()
            theirs.callback(os.close, their_read)
            ours.callback(os.close, self._write)
            self._read, their_write = os.pipe()
            theirs.callback(os.close, their_write)
            ours.callback(os.close, self._read)
            os.set_blocking(self._read, False)
            fds = (their_read, their_write)
            self._process = start_module(
                PROBE, (*fds, core), fds, own_session=True
            )  # Ctrl-C is for who has started it
            self._ends = ours.pop_all()

    def fileno(self) -> int:
        """Can be read when somebody who was asked about may be at rest, and when the probe has ended."""
        return self._read

    def join(self, pid: int, wake_ports: Sequence[int]) -> CoreShare:
        """A PX4 flies on this core; returns its part in it.

        Args:
            pid: its process.
            wake_ports: UDP ports of this machine, each of which is sent an empty datagram as soon as it is at rest.
                Then it is to come to rest again.

        Raises:
            ValueError: there are too many.
        """
        if self._joined == PLACES:
            raise ValueError(f"{PLACES} PX4s have flown on one core")
        place, self._joined = self._joined, self._joined + 1
        self.say(JOIN, place, pid, *wake_ports)
        return CoreShare(self, place)

    def hear(self) -> None:
        """Take what the probe has said."""
        try:
            said = os.read(self._read, _READ_BYTES)
        except BlockingIOError:
            return
        if not said:
            self.is_ready, self.is_over = False, True
        elif READY in said:
            self.is_ready = True
        self.asked.difference_update(said)

    def close(self) -> None:
        """End it; again has no effect. Before the PX4s: one that spins leaves the probe no time to end."""
        self.is_ready = False
        self._ends.close()
        try:
            self._process.wait(END_S)
        except subprocess.TimeoutExpired:
            self._process.kill()

    def say(self, *words: str | int) -> None:
        """Tell the probe something."""
        try:
            os.write(self._write, f"{' '.join(map(str, words))}\n".encode())
        except OSError as error:
            self.is_ready, self.is_over = False, True
            _log.debug("the probe has ended: %s", error)


class CoreShare:
    """A PX4's part in the core on which it flies.

    Args:
        core: the core.
        place: what the PX4 is called there.
    """

    def __init__(self, core: IdleCore, place: int) -> None:
        self._core, self._place = core, place

    @property
    def is_ready(self) -> bool:
        """Whether it can be asked."""
        return self._core.is_ready

    @property
    def is_over(self) -> bool:
        """Whether it never can be again."""
        return self._core.is_over

    def may_fly(self) -> bool:
        """Whether it has its turn, which it takes if fewer than AT_ONCE have.

        They fly for as long as they may: what each computes with stays in the core's caches.
        """
        if len(self._core.flying) < AT_ONCE:
            self._core.flying.add(self._place)
        return self._place in self._core.flying

    def end_turn(self) -> None:
        """It has nothing to do for now."""
        self._core.flying.discard(self._place)

    def ask(self) -> None:
        """Ask for rest, and rest after the wakes."""
        if self._place not in self._core.asked:
            self._core.asked.add(self._place)
            self._core.say(ASK, self._place)

    def is_at_rest(self) -> bool:
        """Whether what was asked for is done. Nothing is where the probe has ended."""
        if self._place in self._core.asked:
            self._core.hear()
        return self._place not in self._core.asked

    def leave(self) -> None:
        """It flies no more, or is looked at from now on."""
        self.end_turn()
        self._core.asked.discard(self._place)
        self._core.say(LEAVE, self._place)


class IdleCores:
    """The cores on which the PX4s of an exchange fly.

    Args:
        listen: has the exchange's loop call something when a file descriptor can be read.
        forget: takes that back.
    """

    def __init__(
        self, listen: Callable[[int, Callable[[], object]], object], forget: Callable[[int], object]
    ) -> None:
        self._listen, self._forget = listen, forget
        self._cores: dict[int, IdleCore] = {}

    def share(self, pid: int, wake_ports: Sequence[int]) -> CoreShare | None:
        """A PX4 has booted; None: whether it is at rest has to be looked for.

        Args:
            pid: its process.
            wake_ports: see `IdleCore.join`.
        """
        try:
            core = core_in_order(pid)
            if core is None:
                return None
            if core not in self._cores:
                self._cores[core] = IdleCore(core)
                self._listen(self._cores[core].fileno(), partial(self._hear, self._cores[core]))
            return None if self._cores[core].is_over else self._cores[core].join(pid, wake_ports)
        except (OSError, ValueError) as error:
            _log.debug("whether PX4 (process %d) is at rest is looked for: %s", pid, error)
            return None

    def close(self) -> None:
        """End what tells of them."""
        for core in self._cores.values():
            core.close()

    def _hear(self, core: IdleCore) -> None:
        core.hear()
        if core.is_over:
            self._forget(core.fileno())
