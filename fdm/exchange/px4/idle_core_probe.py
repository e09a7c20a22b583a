"""The process that `idle_core` asks: ``python -m fdm.exchange.px4.idle_core_probe READ WRITE CORE``.

Each line that it reads begins with the place of a PX4. One with more words has a PX4 join: its process, and the ports
at which it is woken. One without asks for rest; the answer is a byte, the place. It ends when READ does.
"""

from __future__ import annotations

import os
import socket
import sys
import time
from collections.abc import Iterable, Sequence
from contextlib import suppress

from fdm.exchange.px4.idle_core import READY
from fdm.exchange.px4.quiet import PROC, Thread, spent_ns, thread_ids

LOWEST = 1
"""The lowest real-time priority of Linux."""
WRITERS = ("dataman", "logger", "wq:lp_default")
"""Threads of PX4 that write files in flight (missions, directories of logs, parameters), and then do what others wait
for: one that waits for the disk can run no more than one that sleeps, but is not at rest. The log's own writer
(log_writer_file) is no such: nobody waits for it, and it waits for the disk every second."""
_READ_BYTES = 4096
_MOMENT_S = 0.00005


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
                thread = Thread(f"{PROC}/{pid}/task/{tid}")
                if thread.name() in WRITERS:
                    self._writers.append(thread)
                else:
                    thread.close()

    def spent_ns(self) -> int:
        """How long it has run so far; 0: it has ended."""
        with suppress(OSError):
            return spent_ns(self._pid)
        return 0

    def waits_for_disk(self) -> bool:
        """Whether one of its threads does, as far as that matters."""
        with suppress(OSError):
            return not all(thread.sleeps() for thread in self._writers)
        return False

    def wake(self, sender: socket.socket) -> bool:
        """Have its MAVLink threads look at the time; False: there are none to wake."""
        for port in self._ports:
            with suppress(OSError):
                sender.sendto(b"", ("127.0.0.1", port))
        return bool(self._ports)


def settle(asked: Sequence[FlownPx4], sender: socket.socket) -> None:
    """Return when these are at rest, were woken, and are at rest again."""
    _come_to_rest(asked)
    if [px4 for px4 in asked if px4.wake(sender)]:
        _come_to_rest(asked)


def _come_to_rest(asked: Sequence[FlownPx4]) -> None:
    _let_others_run(asked)
    while any(px4.waits_for_disk() for px4 in asked):
        time.sleep(_MOMENT_S)
        _let_others_run(asked)


def _let_others_run(asked: Sequence[FlownPx4]) -> None:
    """Threads of higher priority did so before; those of the same one have their turn now."""
    before: list[int] = []
    while (now := [px4.spent_ns() for px4 in asked]) != before:
        before = now
        os.sched_yield()


def _lines(fd: int) -> Iterable[list[list[int]]]:
    """What is read, as the lines that came together, each as its numbers."""
    left = b""
    while data := os.read(fd, _READ_BYTES):
        *lines, left = (left + data).split(b"\n")
        yield [[int(word) for word in line.split()] for line in lines]


def main(arguments: Sequence[str]) -> None:
    """Answer until nobody asks any more."""
    read, write, core = map(int, arguments)
    os.sched_setaffinity(0, {core})
    os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(LOWEST))
    os.write(write, bytes((READY,)))
    flown: dict[int, FlownPx4] = {}
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender, suppress(BrokenPipeError):
        for lines in _lines(read):
            flown.update({place: FlownPx4(*_joining(words)) for place, *words in lines if words})
            asked = [place for place, *words in lines if not words]
            settle([flown[place] for place in asked], sender)
            os.write(write, bytes(asked))


def _joining(words: Sequence[int]) -> tuple[int, Sequence[int]]:
    return words[0], words[1:]


if __name__ == "__main__":
    main(sys.argv[1:])
