"""An asyncio event loop whose time is sim time: what an agent's coroutines run in.

The loop of `asyncio` asks a selector to wait when none of its callbacks is ready. Here that moment is the end of a
tick: everything that could run at this instant of sim time has run. The loop then waits, in wall time, for the next
tick, and `asyncio.sleep`, `asyncio.timeout`, `wait_for` and timers of any code in it wait in sim time.

The same inputs at the same ticks give the same interleaving. Two things of asyncio are in the way of that and mended
here: tasks and futures hash by their address, which orders every set of them (asyncio.wait, TaskGroup) anew in each
process, and tasks are named by a count over all loops of a process; they hash, and are named, by their number in the
loop instead. And threads and sockets answer whenever the host lets them: they are refused.
"""

from __future__ import annotations

import asyncio
import itertools
import math
from collections.abc import Callable, Coroutine
from contextvars import Context
from typing import Any, NoReturn

RESOLUTION_S = 0.5e-9
"""Timers that are due within this of the loop's time are due: times are whole nanoseconds, but for their rounding."""


class SimTimeError(RuntimeError):
    """The agent asked for something whose answer would depend on wall time."""


class _NumberedTask(asyncio.Task[Any]):
    """A task that hashes by its number in the loop, and has it in its name unless it is given one."""

    def __init__(
        self, coro: Coroutine[Any, Any, Any], *, number: int, name: str | None = None, **options: Any
    ) -> None:
        self._number = number
        super().__init__(coro, name=f"Task-{number}" if name is None else name, **options)

    def set_name(self, value: object) -> None:
        """Take a name; None, which loops of Python 3.13.0 to 3.13.2 give to tasks without one, is none."""
        if value is not None:
            super().set_name(value)

    def __hash__(self) -> int:
        return self._number


class _NumberedFuture(asyncio.Future[Any]):
    """A future that hashes by its number in the loop."""

    def __init__(self, *, number: int, loop: asyncio.AbstractEventLoop) -> None:
        self._number = number
        super().__init__(loop=loop)

    def __hash__(self) -> int:
        return self._number


class _IdleSelector:
    """In the place of a selector: it has no files, and calls ``wait`` when the loop has nothing ready."""

    def __init__(self, wait: Callable[[], object], has_due_timer: Callable[[], bool]) -> None:
        self._wait = wait
        self._has_due_timer = has_due_timer

    def select(self, timeout: float | None) -> list[Any]:
        """Return at once if something is ready (0) or a timer is due, else when the next tick has come."""
        if timeout is None or (timeout > 0.0 and not self._has_due_timer()):
            self._wait()
        return []

    def close(self) -> None:
        """Nothing to close."""


class SimLoop(asyncio.BaseEventLoop):
    """The event loop.

    Args:
        wait: called when nothing is ready to run; returns once `advance` (or `stop`) was called.
    """

    def __init__(self, wait: Callable[[], object]) -> None:
        super().__init__()
        self._sim_time_ns = 0
        self._numbers = itertools.count()
        self._raised: list[asyncio.Task[Any]] = []
        self._pending: set[asyncio.Task[Any]] = set()
        """asyncio's own are weak: of those that nobody else refers to some would end whenever Python collects them."""
        self._selector = _IdleSelector(wait, self._has_due_timer)
        self._clock_resolution = RESOLUTION_S
        self.set_task_factory(self._numbered_task)  # type: ignore[arg-type]

    def advance(self, sim_time_ns: int) -> None:
        """Let the loop's time be ``sim_time_ns``; timers due by then run next."""
        self._sim_time_ns = sim_time_ns

    @property
    def sim_time_ns(self) -> int:
        """The loop's time, ns."""
        return self._sim_time_ns

    def time(self) -> float:
        """The loop's time, s: sim time."""
        return self._sim_time_ns / 1e9

    def call_at(  # type: ignore[override]  # typeshed binds the callback's arguments to it
        self, when: float, callback: Callable[..., object], *args: Any, context: Context | None = None
    ) -> asyncio.TimerHandle:
        """A timer.

        Raises:
            ValueError: ``when`` is nan: neither earlier nor later than any other, it would disorder them all.
        """
        if math.isnan(when):
            raise ValueError("a wait of nan seconds has no end")
        return super().call_at(when, callback, *args, context=context)

    def create_future(self) -> asyncio.Future[Any]:
        """A future of this loop."""
        return _NumberedFuture(number=next(self._numbers), loop=self)

    def _numbered_task(
        self, loop: asyncio.AbstractEventLoop, coro: Coroutine[Any, Any, Any], **options: Any
    ) -> _NumberedTask:
        task = _NumberedTask(coro, number=next(self._numbers), loop=loop, **options)
        task.add_done_callback(self._task_done)
        self._pending.add(task)
        return task

    def _task_done(self, task: asyncio.Task[Any]) -> None:
        self._pending.discard(task)
        if not task.cancelled() and task._log_traceback:
            self._raised.append(task)

    def take_raised(self) -> list[asyncio.Task[Any]]:
        """Tasks that have raised and whose exception nobody has looked at.

        asyncio reports them when they are collected, whenever that is; so they are kept until they are taken.
        """
        raised, self._raised = self._raised, []
        return [task for task in raised if task._log_traceback]

    def keep_raised(self, task: asyncio.Task[Any]) -> None:
        """Look at it again later."""
        self._raised.append(task)

    def ready_coroutines(self) -> list[object]:
        """Those of the tasks that wait for nothing, in the order in which the tasks were made; from any thread."""
        tasks: list[Any] = [
            task for task in self._pending.copy() if getattr(task, "_fut_waiter", None) is None
        ]
        return [task.get_coro() for task in sorted(tasks, key=hash)]

    def _has_due_timer(self) -> bool:
        """Whether asyncio takes its earliest timer for due, by the comparison that it makes itself.

        By any other, a timer a nanosecond after a tick would be neither waited for nor run.
        """
        timers: list[asyncio.TimerHandle] = self._scheduled  # type: ignore[attr-defined]
        return bool(timers) and timers[0].when() < self.time() + self._clock_resolution

    # What BaseEventLoop leaves to its kinds.

    def _process_events(self, event_list: list[Any]) -> None:
        """There are none."""

    def _write_to_self(self) -> None:
        """Wake nobody: what another thread adds is run with the next tick."""


def _refuse(*_: object, **__: object) -> NoReturn:
    raise SimTimeError(
        "an agent lives in sim time: threads, sockets and subprocesses answer whenever the host lets them; compute in "
        "the coroutine itself, or in a program beside the run that talks to the aircraft (lostlink.connect_ua)"
    )


for _name in (
    *("run_in_executor", "getaddrinfo", "getnameinfo", "add_reader", "add_writer", "add_signal_handler"),
    *("create_connection", "create_server", "create_unix_connection", "create_unix_server"),
    *(
        "create_datagram_endpoint",
        "subprocess_exec",
        "subprocess_shell",
        "connect_read_pipe",
        "connect_write_pipe",
    ),
    *(
        "sock_connect",
        "sock_accept",
        "sock_recv",
        "sock_recv_into",
        "sock_recvfrom",
        "sock_sendall",
        "sock_sendto",
    ),
):
    setattr(SimLoop, _name, _refuse)
