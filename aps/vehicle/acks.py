"""Which request a COMMAND_ACK answers. No I/O, no clock.

A COMMAND_ACK names its command and for whom it is, but not which request it answers; so what answers what
follows from the order. An autopilot handles a link's commands one after the other and answers each once
(but for IN_PROGRESS, which announces a later answer). So an acknowledgement answers the oldest request of
the same command and sender that is still owed one. It counts for that request alone: if nobody waits for it
any more (a retry was quicker, another command took over, all tries have timed out), it is late and must not
be taken for the answer to a newer request.

An autopilot with a full send buffer drops acknowledgements. One that is not there after OWED_HEARTBEATS of
the autopilot's heartbeats is not owed any more; until then the next request of the same command loses its
first answer to the lost one, and is answered on its second try.

Clients' own commands are remembered too: autopilots that speak MAVLink 1 acknowledge without naming anyone,
and only the order shows whose answer it is.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import Final

from aps.timeouts import IN_PROGRESS_TIMEOUT_S, OWED_HEARTBEATS

MAX_OWED: Final = 256
"""Bound on requests that are remembered: the oldest are forgotten first."""
FOREIGN: Final = object()
"""The request of a client, which waits for its answer itself; or one of ours whose answer changes nothing."""


@dataclass(slots=True)
class AckCounters:
    """What became of the acknowledgements of our requests."""

    matched: int = 0
    late: int = 0
    """For requests that nobody waited for any more."""
    stray: int = 0
    """For no request that is known."""
    given_up: int = 0
    """Requests, ours or clients', whose acknowledgement never came."""


@dataclass(slots=True, eq=False)
class _Owed:
    command: int
    sysid: int
    compid: int
    request: object
    heartbeats: int = 0


class AckLedger:
    """The requests that the autopilot still owes an acknowledgement, in the order of sending."""

    def __init__(self) -> None:
        self.counters = AckCounters()
        self._owed: deque[_Owed] = deque()

    def __len__(self) -> int:
        return len(self._owed)

    def sent(self, command: int, sysid: int, compid: int, request: object) -> None:
        """A command goes to the autopilot.

        Args:
            command: MAV_CMD.
            sysid: system id of its sender.
            compid: component id of its sender.
            request: whatever waits for the answer; the same object for each of its tries.
        """
        if len(self._owed) >= MAX_OWED:
            self._owed.popleft()
            self.counters.given_up += 1
        self._owed.append(_Owed(command, sysid, compid, request))

    def answered(self, command: int, sysid: int, compid: int, *, final: bool = True) -> object | None:
        """The request that an acknowledgement answers, or ``None``.

        Args:
            command: MAV_CMD.
            sysid: target system of the acknowledgement; 0 when it names none.
            compid: target component; 0 when it names none.
            final: false for IN_PROGRESS: another acknowledgement of the same request will follow.
        """
        for owed in self._owed:
            if owed.command == command and sysid in (0, owed.sysid) and compid in (0, owed.compid):
                if final:
                    self._owed.remove(owed)
                else:
                    owed.heartbeats = -round(IN_PROGRESS_TIMEOUT_S)
                return owed.request
        return None

    def heartbeat(self) -> None:
        """A heartbeat of the autopilot: what it has not answered for long it will not answer."""
        for owed in self._owed:
            owed.heartbeats += 1
        kept = [owed for owed in self._owed if owed.heartbeats < OWED_HEARTBEATS]
        self.counters.given_up += len(self._owed) - len(kept)
        self._owed = deque(kept)

    def forget(self) -> None:
        """The connection is new or the autopilot has rebooted: nothing is owed."""
        self._owed.clear()
