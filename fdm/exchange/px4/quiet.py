"""Whether a program on this machine has come to rest: each of its threads sleeps, and nothing but us can wake it.

PX4 answers no frame before its modules run, and which module starts in which frame would be the machine's choice if
frames went by wall time. So a frame is done when PX4 has answered it, or when it cannot answer it any more: all its
threads, and those of its start script, sleep.

Proof: a thread that sleeps at two instants, and was given no processor from before the first until after the second,
slept all the while. If this holds for all threads, and each first instant is before each second one, then there was an
instant at which all of them slept, and no thread was there to wake another. What may still wake one is a timer of wall
time: whether one naps so is seen between the two instants. One that has run since, and naps again while all others
sleep, waits for what the next frame brings.
"""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import suppress

PROC = "/proc"
_AT_REST = (b"S", b"Z", b"X")
"""States of proc(5): sleeps, has ended."""
_SLEEPS = b"S"
_NAPS = (b"hrtimer_nanosleep", b"do_nanosleep")
"""Where threads that sleep for a time wait in the kernel (proc(5): wchan)."""
_NOWHERE = b"0"
"""What wchan says of a thread that runs; where it is not shown; and, since Linux 6.12, of one that sleeps and has not
yet left the queue of its processor."""
_NUM_THREADS = 17
"""Place of the number of threads in /proc/PID/stat, counted after the name (proc(5): field 20)."""
_LONGEST_NAP_NS = 2_000_000_000
"""Wall time for which naps are waited for after something was sent; those that go on are never waited for again."""
_READ_BYTES = 1024
_MOMENT_S = 0.001


def shows_rest() -> bool:
    """Whether this system's /proc has what rest is seen by: children, and counts that go up when a thread runs.

    Some kernels are built without one or the other, or show zeros. Sleeps for a moment.
    """
    own = f"{PROC}/self/task/{threading.get_native_id()}"
    try:
        _read(f"{own}/children")
        before = _read(f"{own}/schedstat").split()
        time.sleep(_MOMENT_S)
        return _read(f"{own}/schedstat").split()[2] != before[2]
    except (OSError, IndexError):
        return False


class Rest:
    """Looks at a process and its descendants; Linux only.

    Args:
        pid: the process.
        reader: name of the thread that has to have run since `sent` was called, if one is to: it reads what we send.
            Without it the process is not at rest.
    """

    def __init__(self, pid: int, reader: str = "") -> None:
        self.pid = pid
        self._reader_name = reader
        self._reader: _Thread | None = None
        self._reads_at_send = -1
        self._main = f"{PROC}/{pid}/task/{pid}"
        self._threads: dict[str, _Thread] = {}
        self._is_known = False
        self._own = 0
        self._nappers: dict[str, int] = {}
        """Threads that nap, and how often each had run when it was first found so."""
        self._lasting: set[str] = set()
        """Threads whose naps are not waited for."""
        self._since_ns: int | None = None
        """Since when naps are waited for."""
        self._shows_places = False
        """Whether this system has shown where a thread waits."""

    def sent(self) -> None:
        """Something is about to be sent to it: it is at rest only when its reader has run since."""
        self._reads_at_send = self._reads()
        self._nappers, self._since_ns = {}, None

    def has_children(self) -> bool:
        """Whether it has started processes that have not ended: PX4's start script goes on."""
        return any(True for _ in _children(self.pid))

    def is_at_rest(self, naps: int = 0) -> bool:
        """Whether there was an instant since the call at which all its threads slept. False if it has ended.

        Args:
            naps: a thread that naps counts as at rest only when it has run so often since it was first found to, after
                `sent`; 0: at once.
        """
        if self._reader_name and self._reads() in (-1, self._reads_at_send):
            return False
        try:
            threads = self._all()
            before = [thread.runs() for thread in threads]
            if not threads or not all(thread.sleeps() for thread in threads):
                return False
            nappers = self._now_nap() if naps else set()
            if (nappers is None and not self._outlast()) or not self._are_all(threads):
                return False
            if not all(thread.sleeps() for thread in threads) or [t.runs() for t in threads] != before:
                return False  # last, as another one may have come and gone: whoever had to do with it has run
            if not nappers:
                self._nappers = {}
                return True
            runs = zip(self._threads, before, strict=True)
            return self._have_napped({path: count for path, count in runs if path in nappers}, naps)
        except OSError:  # a thread has ended meanwhile: look again
            self.close()
            return False

    def _now_nap(self) -> set[str] | None:
        """The threads, but the main one, that sleep for a time; None: of one the system does not say just now."""
        places = {path: each.waits_in() for path, each in self._threads.items()}
        self._shows_places |= any(place not in (b"", _NOWHERE) for place in places.values())
        places.pop(self._main, None)
        if self._shows_places and _NOWHERE in places.values():
            return None
        return {path for path, place in places.items() if place in _NAPS} - self._lasting

    def _have_napped(self, runs: dict[str, int], naps: int) -> bool:
        """Whether each thread that naps has run so often meanwhile.

        Args:
            runs: of those that nap, how often each has run.
            naps: see `is_at_rest`.
        """
        self._nappers = {path: self._nappers.get(path, count) for path, count in runs.items()}
        if all(runs[path] - first >= naps for path, first in self._nappers.items()):
            return True
        if not self._outlast():
            return False
        self._lasting |= runs.keys()
        return True

    def _outlast(self) -> bool:
        """Whether naps go on for too long: the time begins with the first call after `sent`."""
        now_ns = time.monotonic_ns()
        if self._since_ns is None:
            self._since_ns = now_ns
        return now_ns - self._since_ns >= _LONGEST_NAP_NS

    @property
    def naps(self) -> bool:
        """Whether a thread, not its main one, slept for a time when it was last found at rest."""
        return bool(self._nappers)

    def close(self) -> None:
        """Close all files; another look opens them anew."""
        for thread in self._threads.values():
            thread.close()
        self._threads.clear()
        self._reader, self._is_known = None, False

    def _are_all(self, threads: Sequence[_Thread]) -> bool:
        """Whether there were no others when these slept."""
        if self.has_children():
            self._is_known = False
            return set(_tasks(self.pid)) == set(self._threads)
        self._is_known = threads[0].count() == len(threads) == self._own
        return self._is_known

    def _all(self) -> list[_Thread]:
        """All threads that there are now; those that have ended are forgotten."""
        if self._is_known:
            return list(self._threads.values())
        own, paths = f"{PROC}/{self.pid}/task/", list(_tasks(self.pid))
        self._own = sum(path.startswith(own) for path in paths)
        known, self._threads = self._threads, {}
        try:
            for path in paths:
                self._threads[path] = known.pop(path) if path in known else _Thread(path)
        finally:
            for thread in known.values():
                thread.close()
                self._reader = None if thread is self._reader else self._reader
        return list(self._threads.values())

    def _reads(self) -> int:
        """How often the reader was given a processor; -1 if there is no such thread."""
        if not self._reader_name:
            return -1
        try:
            if self._reader is None:
                self._reader = next((each for each in self._all() if each.name() == self._reader_name), None)
            return -1 if self._reader is None else self._reader.runs()
        except OSError:  # it has ended, or another thread has just now
            self.close()
            return -1


class _Thread:
    """One thread: its files stay open, as they are read again and again."""

    __slots__ = ("_path", "_schedstat", "_stat")

    def __init__(self, path: str) -> None:
        self._path = path
        self._stat = os.open(f"{path}/stat", os.O_RDONLY | os.O_CLOEXEC)
        try:
            self._schedstat = os.open(f"{path}/schedstat", os.O_RDONLY | os.O_CLOEXEC)
        except OSError:
            os.close(self._stat)
            raise

    def runs(self) -> int:
        """How often it was given a processor."""
        return int(os.pread(self._schedstat, _READ_BYTES, 0).split()[2])

    def sleeps(self) -> bool:
        """Whether it sleeps, or has ended."""
        return self._state() in _AT_REST

    def _state(self) -> bytes:
        text = os.pread(self._stat, _READ_BYTES, 0)
        at = text.rindex(b")") + 2  # the name before it may hold anything
        return text[at : at + 1]

    def count(self) -> int:
        """How many threads its process has."""
        text = os.pread(self._stat, _READ_BYTES, 0)
        return int(text[text.rindex(b")") + 2 :].split()[_NUM_THREADS])

    def waits_in(self) -> bytes:
        """Where in the kernel it waits; empty if it has ended, or if it cannot be read."""
        try:
            return _read(f"{self._path}/wchan").rstrip(b"\0") if self._state() == _SLEEPS else b""
        except OSError:  # not shown; or it has ended, which `runs` will say
            return b""

    def name(self) -> str:
        """Its name."""
        return _read(f"{self._path}/comm").decode(errors="replace").strip()

    def close(self) -> None:
        """Close its files."""
        os.close(self._stat)
        os.close(self._schedstat)


def thread_ids(pid: int) -> list[int]:
    """Ids of all threads of a process and its descendants.

    Raises:
        OSError: there is no such process, or no /proc.
    """
    return [int(path.rpartition("/")[2]) for path in _tasks(pid)]


def names_of_threads(pid: int) -> set[str]:
    """Names of the process's own threads, as far as they can be read."""
    names = set()
    with suppress(OSError):
        for tid in os.listdir(f"{PROC}/{pid}/task"):  # noqa: PTH208 (as below)
            with suppress(OSError):
                names.add(_read(f"{PROC}/{pid}/task/{tid}/comm").decode(errors="replace").strip())
    return names


def _tasks(pid: int) -> Iterator[str]:
    """Paths of all threads of a process and its descendants."""
    folder = f"{PROC}/{pid}/task"
    for tid in os.listdir(folder):  # noqa: PTH208 (the hot path: names are enough)
        yield f"{folder}/{tid}"
    for child in _children(pid):
        yield from _tasks(child)


def _children(pid: int) -> Iterator[int]:
    """Processes that its main thread has started (PX4 runs its script from there)."""
    try:
        text = _read(f"{PROC}/{pid}/task/{pid}/children")
    except OSError:
        return
    yield from map(int, text.split())


def _read(path: str) -> bytes:
    fd = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    try:
        return os.read(fd, 4096)
    finally:
        os.close(fd)
