"""Whether a program on this machine has come to rest: each of its threads sleeps, and nothing but us can wake it.

PX4 answers no frame before its modules run, and which module starts in which frame would be the machine's choice if
frames went by wall time. So a frame is done when PX4 has answered it, or when it cannot answer it any more: all its
threads, and those of its start script, sleep.

Proof: a thread that sleeps at two instants, and was given no processor from before the first until after the second,
slept all the while. If this holds for all threads, and each first instant is before each second one, then there was an
instant at which all of them slept, and no thread was there to wake another. What may still wake one is a timer of wall
time.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

PROC = Path("/proc")
_AT_REST = (b"S", b"Z", b"X")
"""States of proc(5): sleeps, has ended."""


class Rest:
    """Looks at a process and its descendants; Linux only.

    Args:
        pid: the process.
        reader: name of the thread that has to have run since `sent` was called, if one is to: it reads what we send.
    """

    def __init__(self, pid: int, reader: str = "") -> None:
        self.pid = pid
        self._reader_name = reader
        self._reader = ""
        self._read_at_send = -1

    def sent(self) -> None:
        """Something was sent to it, or is about to be: it is at rest only when it has run since."""
        self._read_at_send = self._runs_of_reader()

    def has_children(self) -> bool:
        """Whether it has started processes that have not ended: PX4's start script goes on."""
        return any(True for _ in _children(self.pid))

    def is_at_rest(self) -> bool:
        """Whether there was an instant since the call at which all its threads slept. False if it has ended."""
        if self._read_at_send >= 0 and self._runs_of_reader() == self._read_at_send:
            return False
        try:
            before = {task: _runs(task) for task in _tasks_of_all(self.pid)}
            if not before or not all(map(_sleeps, before)):
                return False
            return all(map(_sleeps, _tasks_of_all(self.pid))) and all(
                before.get(task) == _runs(task) for task in _tasks_of_all(self.pid)
            )
        except OSError:  # a thread has ended meanwhile: look again
            return False

    def _runs_of_reader(self) -> int:
        """How often the reader was given a processor; -1 if there is no such thread."""
        if not self._reader_name:
            return -1
        try:
            if not self._reader:
                self._reader = _named_thread(self.pid, self._reader_name)
            return _runs(self._reader) if self._reader else -1
        except OSError:
            return -1


def _tasks_of_all(pid: int) -> Iterator[str]:
    """Paths of all threads of the process and its descendants."""
    folder = f"{PROC}/{pid}/task"
    for tid in os.listdir(folder):  # noqa: PTH208 (the hot path: names are enough)
        yield f"{folder}/{tid}"
    for child in _children(pid):
        yield from _tasks_of_all(child)


def _children(pid: int) -> Iterator[int]:
    """Processes that its main thread has started (PX4 runs its script from there)."""
    try:
        text = _read(f"{PROC}/{pid}/task/{pid}/children")
    except OSError:
        return
    yield from map(int, text.split())


def _runs(task: str) -> int:
    return int(_read(f"{task}/schedstat").split()[2])


def _sleeps(task: str) -> bool:
    text = _read(f"{task}/stat")
    at = text.rindex(b")") + 2  # the name before it may hold anything
    return text[at : at + 1] in _AT_REST


def _named_thread(pid: int, name: str) -> str:
    for task in (PROC / str(pid) / "task").iterdir():
        if (task / "comm").read_text().strip() == name:
            return str(task)
    return ""


def _read(path: str) -> bytes:
    fd = os.open(path, os.O_RDONLY)
    try:
        return os.read(fd, 4096)
    finally:
        os.close(fd)
