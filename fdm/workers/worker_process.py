"""The parent's end of one worker process: started, talked to, and ended for sure."""

from __future__ import annotations

import contextlib
import socket
import subprocess
import time
from collections.abc import Sequence
from multiprocessing.connection import Connection
from multiprocessing.reduction import ForkingPickler

from fdm.errors import WorkerError
from fdm.module_process import how_it_ended, start_module
from fdm.workers.worker_messages import Ended, Failed, Message, WorkerPlan


class WorkerProcess:
    """One worker process. It ends by itself when this process does, however that ends.

    Args:
        plan: what it is to do; the file descriptors in it stay the caller's.

    Attributes:
        name: for messages.
        control: the connection to it.
    """

    def __init__(self, plan: WorkerPlan) -> None:
        ids = ", ".join(str(spec.ua_id) for spec in plan.aircraft)
        self.name = f"flight dynamics worker {plan.index} (UA {ids})"
        packed = ForkingPickler.dumps(plan)  # first: what cannot be sent leaves no process behind
        ours, theirs = socket.socketpair()
        with theirs:
            fds = (theirs.fileno(), *plan.socket_fds, plan.board_fd, plan.wake_fd, *plan.wake_fds)
            self._process = start_module("fdm.workers.worker", [theirs.fileno()], fds)
        self.control = Connection(ours.detach())
        with contextlib.suppress(BrokenPipeError, ConnectionResetError):  # shows in `receive`
            self.control.send_bytes(packed)

    @property
    def pid(self) -> int:
        """Its process id."""
        return self._process.pid

    def tell(self, message: object) -> None:
        """Send it something; if it has ended that shows in `receive`."""
        with contextlib.suppress(BrokenPipeError, ConnectionResetError):
            self.control.send(message)

    def receive(self) -> Message:
        """Its next message; waits for it.

        Raises:
            FdmError: it has failed, with the error that it met.
            WorkerError: it has ended without a word.
        """
        try:
            message: Message = self.control.recv()
        except (EOFError, OSError):  # killed while it said something, too
            raise WorkerError(f"{self.name} {self._how_it_ended()}") from None
        if isinstance(message, Failed):
            raise message.error or WorkerError(f"{self.name} failed: {message.trace}")
        return message

    def end(self, until_s: float) -> Ended | None:
        """Have it end, by killing it at `until_s` (monotonic) at worst; gives its last message if there was one."""
        self.tell(("stop",))
        last = None
        with contextlib.suppress(EOFError, OSError):
            while last is None and self.control.poll(max(0.0, until_s - time.monotonic())):
                message = self.control.recv()
                last = message if isinstance(message, Ended) else None
        self.control.close()
        try:
            self._process.wait(max(0.1, until_s - time.monotonic()))
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        return last

    def _how_it_ended(self) -> str:
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(1.0)
        status = self._process.returncode
        return "has closed its connection" if status is None else how_it_ended(status)


def end_all(workers: Sequence[WorkerProcess], timeout_s: float) -> dict[int, dict[str, int]]:
    """End all within `timeout_s` together; returns the last counters of those that sent them, by UA id."""
    until_s = time.monotonic() + timeout_s
    for worker in workers:
        worker.tell(("stop",))
    counters: dict[int, dict[str, int]] = {}
    for worker in workers:
        last = worker.end(until_s)
        if last is not None:
            counters.update((ua_id, dict(counts)) for ua_id, counts in last.counters.items())
    return counters
