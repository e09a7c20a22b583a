"""The process that `idle_core` asks: ``python -m fdm.exchange.px4.idle_core_probe READ WRITE CORE``.

It reads lines: ``join PLACE PROCESS [PORT...]`` of a PX4 and the ports at which it is woken, ``leave PLACE``, and ``ask
PLACE`` for rest. It answers with a byte, the place, and ends when READ does.
"""

from __future__ import annotations

import os
import select
import socket
import sys
import time
from collections.abc import Iterable, Sequence
from contextlib import suppress

from fdm.exchange.px4.idle_core import JOIN, LEAVE, READY
from fdm.exchange.px4.quiet import PROC, Thread, spent_ns, thread_ids, thread_name

LOWEST = 1
"""The lowest real-time priority of Linux."""
WRITERS = ("dataman", "logger", "mavlink_rcv", "wq:lp_default")
"""How the names begin of PX4's threads that read and write files in flight (missions, directories of logs, MAVLink FTP,
parameters), and then do what others wait for. One that waits for the disk can run no more than one that sleeps, but is
not at rest. The log's own writer (log_writer_file) is no such: nobody waits for it, and it waits for the disk every
second."""
MOMENTS, MOMENT_S = 10, 0.00005
"""How often, and for how long, it sleeps for a wake that has not come yet: a system with much to do hands datagrams
over in a thread of its own (ksoftirqd), which has no real-time priority."""
_READ_BYTES = 4096


class FlownPx4:
    """A PX4 that flies on this core.

    Args:
        pid: its process.
        ports: at which it is woken.
    """

    def __init__(self, pid: int, ports: Sequence[int]) -> None:
        self._pid, self._ports = pid, ports
        self._writers: list[Thread] = []
        with suppress(OSError):
            for tid in thread_ids(pid):
                self._watch(f"{PROC}/{pid}/task/{tid}")

    def _watch(self, path: str) -> None:
        with suppress(OSError):  # it has ended
            if thread_name(path).startswith(WRITERS):
                self._writers.append(Thread(path))

    def spent_ns(self) -> int:
        """How long it has run so far; 0: it has ended."""
        with suppress(OSError):
            return spent_ns(self._pid)
        return 0

    def waits_for_disk(self) -> bool:
        """Whether one of its threads does, as far as that matters."""
        return any(thread.waits_for_disk() for thread in self._writers)

    def wake(self, sender: socket.socket) -> None:
        """Have its MAVLink threads look at the time."""
        for port in self._ports:
            with suppress(OSError):
                sender.sendto(b"", ("127.0.0.1", port))

    @property
    def is_woken(self) -> bool:
        """Whether it has threads that are woken."""
        return bool(self._ports)

    def close(self) -> None:
        """Close all files."""
        for thread in self._writers:
            thread.close()


def at_rest(asked: Sequence[FlownPx4], sender: socket.socket) -> list[FlownPx4]:
    """Those of the asked that are at rest, were woken, and are at rest again."""
    _let_others_run(asked)
    resting = [px4 for px4 in asked if not px4.waits_for_disk()]
    woken = [px4 for px4 in resting if px4.is_woken]
    before = [px4.spent_ns() for px4 in woken]
    for px4 in woken:
        px4.wake(sender)
    _let_others_run(woken)
    for _ in range(MOMENTS):
        if all(px4.spent_ns() != spent for px4, spent in zip(woken, before, strict=True)):
            break
        time.sleep(MOMENT_S)
        _let_others_run(woken)
    return [px4 for px4 in resting if not (px4.is_woken and px4.waits_for_disk())]


def _let_others_run(asked: Sequence[FlownPx4]) -> None:
    """Threads of higher priority did so before; those of the same one have their turn now."""
    before: list[int] = []
    while (now := [px4.spent_ns() for px4 in asked]) != before:
        before = now
        os.sched_yield()


class Probe:
    """What it was told, and is asked for."""

    def __init__(self) -> None:
        self._flown: dict[int, FlownPx4] = {}
        self._asked: set[int] = set()

    def hear(self, lines: Iterable[bytes]) -> None:
        """Take what was said."""
        for line in lines:
            word, *rest = line.decode().split()
            place, *others = map(int, rest)
            if word == JOIN:
                self._flown[place] = FlownPx4(others[0], others[1:])
            elif word == LEAVE:
                self._asked.discard(place)
                self._flown.pop(place).close()
            else:
                self._asked.add(place)

    @property
    def is_asked(self) -> bool:
        """Whether an answer is due."""
        return bool(self._asked)

    def answers(self, sender: socket.socket) -> bytes:
        """The places that are at rest."""
        places = {self._flown[place]: place for place in sorted(self._asked)}
        resting = bytes(places[px4] for px4 in at_rest(list(places), sender))
        self._asked.difference_update(resting)
        return resting


def main(arguments: Sequence[str]) -> None:
    """Answer until nobody asks any more."""
    read, write, core = map(int, arguments)
    os.sched_setaffinity(0, {core})
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(LOWEST))
    except PermissionError:
        return
    probe, left = Probe(), b""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender, suppress(BrokenPipeError):
        os.write(write, bytes((READY,)))
        while True:
            if not probe.is_asked or select.select([read], (), (), MOMENT_S)[0]:
                data = os.read(read, _READ_BYTES)
                if not data:
                    return
                *lines, left = (left + data).split(b"\n")
                probe.hear(lines)
            os.write(write, probe.answers(sender))


if __name__ == "__main__":
    main(sys.argv[1:])
