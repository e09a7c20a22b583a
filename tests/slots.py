"""Port slots for tests: free, and not those of other sessions of tests on this machine."""

from __future__ import annotations

import os
import socket
from collections.abc import Iterable
from contextlib import ExitStack

from bridge.fleet.preflight.locks import hold
from bridge.fleet.preflight.slots import FIRST_SLOT

NAME = "lostlink-test-slot"
"""How names of locks begin: not as those of runs, which start at slots that a test has."""


def _is_free(kind: socket.SocketKind, port: int) -> bool:
    with socket.socket(type=kind) as probe:
        try:
            probe.bind(("127.0.0.1", port))
        except OSError:
            return False
    return True


def slot_is_free(slot: int, count: int) -> bool:
    tcp = [
        base + 10 * (slot + i) + extra
        for i in range(count)
        for base, extra in ((5760, 0), (5760, 2), (5760, 3))
    ]
    tcp += [base + 10 * (slot + i) for i in range(count) for base in (6760, 8760)]
    tcp += [4560 + slot + i for i in range(count)]
    udp = [base + 10 * (slot + i) for i in range(count) for base in (9002, 5501, 5760, 5761)]
    return all(_is_free(socket.SOCK_STREAM, p) for p in tcp) and all(
        _is_free(socket.SOCK_DGRAM, p) for p in udp
    )


FIRST = FIRST_SLOT + 20
"""Below are those that runs at free ports take: a study of another test starts and ends them all the time, and one that
is between two of them is free to look at."""
SLOTS, SLOTS_FOR_MANY = 80, 210
"""At slot s + 100 autopilots listen where the daemons of slot s do: 5760 + 10 (s + 100). Those of the last slot listen
below the daemons of `FIRST_SLOT`. More than three processes need more slots than that."""


def slots_of_this_process() -> list[int]:
    """Those of all tests, from where no other process of this session begins; what another has is locked."""
    workers = int(os.environ.get("PYTEST_XDIST_WORKER_COUNT", "1"))
    worker = int(os.environ.get("PYTEST_XDIST_WORKER", "gw0").removeprefix("gw"))
    slots = range(FIRST, FIRST + (SLOTS if workers <= 3 else SLOTS_FOR_MANY))
    first = worker * (len(slots) // workers) + os.getpid() % 3
    return [*slots[first:], *slots[:first]]


def lock(slots: Iterable[int], held: ExitStack) -> bool:
    """Lock slots until ``held`` is closed; False, and none is locked, if somebody has one of them."""
    with ExitStack() as trial:
        if not all(hold(f"{NAME}-{slot}", trial) for slot in slots):
            return False
        held.enter_context(trial.pop_all())
    return True
