"""A worker process: hosts part of a fleet for fdm.workers.fleet_exchange, which starts it and is its only user.

It gets a `WorkerPlan` over its control connection, then commands, and answers with messages
(fdm.workers.worker_messages). It serves from the command RUN on: until then what autopilots send waits in their
sockets, as in one process. Its ticks are held until the whole fleet has reached them. It ends when it is stopped, or
when the other end of the connection is gone.
"""

from __future__ import annotations

import os
import signal
import socket
import sys
import traceback
from dataclasses import dataclass, field
from multiprocessing.connection import Connection

from fdm.clock.board import Board
from fdm.clock.status import ClockStatus
from fdm.errors import FdmError
from fdm.exchange.exchange import Exchange
from fdm.model.truth import TrueState
from fdm.workers.worker_messages import COMMANDS, RUN, Ended, Failed, Happened, Reached, Ready, WorkerPlan


@dataclass(slots=True)
class _Worker:
    plan: WorkerPlan
    control: Connection
    truths: list[TrueState] = field(default_factory=list)

    def serve(self) -> None:
        plan = self.plan
        board = Board(plan.board_fd, plan.index, plan.wake_fds)
        self.exchange = Exchange(
            plan.aircraft,
            **plan.settings,  # type: ignore[arg-type]
            hold_ticks=True,
            on_truth=self.truths.append,
            on_tick=self._on_tick,
            on_event=lambda event: self.control.send(Happened(event)),
            sockets=[socket.socket(fileno=fd) for fd in plan.socket_fds],
            peers=board,
        )
        self.exchange.listen(self.control.fileno(), self._obey)
        self.exchange.listen(plan.wake_fd, lambda: os.read(plan.wake_fd, 4096))
        self.control.send(Ready())
        try:
            if self.control.recv() == RUN:
                self.exchange.run()
            self.control.send(Ended(self._counters()))
        finally:
            self.exchange.close()

    exchange: Exchange = field(init=False)

    def _on_tick(self, status: ClockStatus) -> None:
        self.control.send(Reached(status.sim_time_ns, tuple(self.truths), self._counters()))
        self.truths.clear()

    def _counters(self) -> dict[int, dict[str, int]]:
        return {spec.ua_id: self.exchange.counters(spec.ua_id) for spec in self.plan.aircraft}

    def _obey(self) -> None:
        try:
            while self.control.poll():
                name, *arguments = self.control.recv()
                if name in COMMANDS:
                    getattr(self.exchange, name)(*arguments)
        except (EOFError, ConnectionResetError):
            self.exchange.stop()


def main() -> int:
    """Serve the plan that comes over the file descriptor named by the first argument."""
    for number in (signal.SIGINT, signal.SIGTERM):  # sent to a whole group, they are for whoever started it
        signal.signal(number, signal.SIG_IGN)
    with Connection(int(sys.argv[1])) as control:
        try:
            _Worker(control.recv(), control).serve()
        except (EOFError, BrokenPipeError, ConnectionResetError):
            return 1  # nobody is there to report to
        except FdmError as error:
            control.send(Failed(error))
            return 1
        except Exception:
            control.send(Failed(None, traceback.format_exc()))
            return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
