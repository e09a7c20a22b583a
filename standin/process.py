"""The shell: one loop for all autopilots of a process. Each is served as if it were alone.

Wall time decides two things only: when a servo packet that got no answer is sent again, and when a client that
does not read is given up (`standin.sockets`). Until then such a client holds the simulation back.
"""

from __future__ import annotations

import signal
from collections.abc import Sequence
from time import monotonic
from types import FrameType

from standin.sockets import AutopilotSockets
from standin.waiter import Waiter

RESEND_AFTER_S = 1.1
"""Silence of the physics after which the last servo packet is sent again."""
KNOCK_AGAIN_S = 0.05
"""The same if there is no physics: whoever starts both at once need not wait for long."""


class StandinError(Exception):
    """The code of one autopilot failed; the cause is chained.

    Attributes:
        autopilot: its name.
    """

    def __init__(self, autopilot: str, cause: Exception) -> None:
        super().__init__(f"{autopilot} cannot go on: {type(cause).__name__}: {cause}")
        self.autopilot = autopilot


class Process:
    """Some autopilots on real sockets, at least one. ``run`` returns after ``stop`` or a signal."""

    def __init__(self, served: Sequence[AutopilotSockets]) -> None:
        self._served = tuple(served)
        self._stopped = False
        self._waiter: Waiter[AutopilotSockets] = Waiter()
        for one in self._served:
            one.join(self._waiter)

    def stop(self) -> None:
        """End ``run``; callable from a signal handler or another thread."""
        self._stopped = True
        for one in self._served:
            one.shut_down()  # which ends a wait at once

    def stop_on_signals(self) -> None:
        """End ``run`` on SIGTERM and SIGINT."""

        def handler(_number: int, _frame: FrameType | None) -> None:
            self.stop()

        signal.signal(signal.SIGTERM, handler)
        signal.signal(signal.SIGINT, handler)

    def run(self) -> None:
        """Serve until stopped.

        Raises:
            AutopilotError: the code of one autopilot failed.
        """
        for one in self._served:
            one.send_packet()
        now_s = monotonic()
        resend_s = now_s + RESEND_AFTER_S
        while not self._stopped:
            due = self._waiter.wait(max(0.0, resend_s - now_s))
            for one in due:
                try:
                    listens = one.turn()
                except Exception as error:
                    raise StandinError(one.name, error) from error
                if not listens:
                    resend_s = min(resend_s, now_s + KNOCK_AGAIN_S)
            now_s = monotonic()
            if now_s >= resend_s:
                resend_s = self._send_again(now_s)

    def close(self) -> None:
        """Close the sockets."""
        self._waiter.close()
        for one in self._served:
            one.close()

    def _send_again(self, now_s: float) -> float:
        """Send the last servo packet of those that the physics has left in silence; return when to look again."""
        for one in self._served:
            if now_s - one.sent_s >= RESEND_AFTER_S:
                one.send_packet()
        return min(one.sent_s for one in self._served) + RESEND_AFTER_S
