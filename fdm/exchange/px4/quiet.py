"""Whether a program on this machine has come to rest: each of its threads sleeps, and nothing but us can wake it.

PX4 answers no frame before its modules run, and which module starts in which frame would be the machine's choice if
frames went by wall time. So a frame is done when PX4 has answered it, or when it cannot answer it any more: all its
threads, and those of its start script, sleep.

Proof: the time that the processes have spent on processors is read, then which threads there are, then where each of
them is, then that time again. A thread that ran when the time was first read, and has left its processor when it is
looked at, has made it longer meanwhile. If it is the same, and each thread was seen to sleep, none ran from the first
instant on, so none was there to wake another. One of which only the state is told (S even while it is on its way to
sleep) is asked twice. What may still wake one is from outside, such as a timer of wall time: whether one naps so is
seen in that while, and whether it still does after its runs were counted. One that has run since, and naps again while
all others sleep, waits for what the next frame brings.
"""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import suppress

PROC = "/proc"
_ENDED = (b"Z", b"X")
_DISK = b"D"
_AT_REST = (b"S", *_ENDED)
"""States of proc(5): sleeps, has ended."""
_CPUCLOCK_SCHED = 2
"""Kind of a process's clock in its number (Linux, include/linux/posix-timers_types.h)."""
_NAPS = (b"hrtimer_nanosleep", b"do_nanosleep")
"""Where threads that sleep for a time wait in the kernel (proc(5): wchan)."""
_WAITS = frozenset(
    (
        *_NAPS,
        *(b"futex_do_wait", b"futex_wait_queue", b"futex_wait_queue_me"),
        *(b"poll_schedule_timeout", b"poll_schedule_timeout.constprop.0", b"do_poll", b"do_poll.constprop.0"),
    )
)
"""Where a thread waits that sleeps, whatever its state says: since Linux 5.16 it is told of those only that have left
their processor, and these waits can be interrupted (none is for a disk). Half as dear to ask for as the state."""
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
    """Whether this system has what rest is seen by.

    That is /proc with children, with where a thread waits, and with counts that go up when it runs; and clocks of
    processes that tell a microsecond. Some kernels are built without one or the other, or show zeros. Sleeps for a
    moment.
    """
    own = f"{PROC}/self/task/{threading.get_native_id()}"
    try:
        _read(f"{own}/children")
        _read(f"{own}/wchan")
        before = _read(f"{own}/schedstat").split()
        time.sleep(_MOMENT_S)
        is_fine = spent_ns(os.getpid()) < spent_ns(os.getpid())
        return is_fine and _read(f"{own}/schedstat").split()[2] != before[2]
    except (OSError, IndexError, AttributeError):
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
        self._reader_name, self._reader = reader, ""
        self._files: dict[str, _File] = {}
        """Of the threads that are asked for more than where they are."""
        self._awake: Thread | None = None
        """The one that did not sleep when it was last looked."""
        self._reads_at_send = -1
        self._main = f"{PROC}/{pid}/task/{pid}"
        self._threads: dict[str, Thread] = {}
        self._pids: set[int] = set()
        """Of the processes whose threads these are."""
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
        with suppress(OSError):
            return bool(self._says(f"{self._main}/children"))
        return False

    def _says(self, path: str) -> bytes:
        """What a file says now."""
        if path not in self._files:
            self._files[path] = _File(path)
        return self._files[path].read()

    def is_at_rest(self, naps: int = 0) -> bool:
        """Whether there was an instant since the call at which all its threads slept. False if it has ended.

        Args:
            naps: a thread that naps counts as at rest only when it has run so often since it was first found to, after
                `sent`; 0: at once.
        """
        if self._reader_name and self._reads() in (-1, self._reads_at_send):
            return False
        try:
            if self._awake is not None and not self._awake.sleeps():
                return False
            threads = self._all()
            before_ns = [spent_ns(pid) for pid in self._pids]
            if not threads or not self._are_all(
                threads
            ):  # first: whoever one that has gone has woken is looked at
                return False
            self._awake = next((thread for thread in threads if not thread.sleeps()), None)
            if self._awake is not None:
                return False
            nappers = self._now_nap() if naps else {}
            if nappers is None and not self._outlast():
                return False
            if not all(thread.sleeps() for thread in threads if naps or thread.place == _NOWHERE):
                return False
            if [spent_ns(pid) for pid in self._pids] != before_ns:
                return False
            if not nappers:
                self._nappers = {}
                return True
            return self._have_napped(nappers, naps)
        except OSError:  # a thread has ended meanwhile: look again
            self.close()
            return False

    def _now_nap(self) -> dict[str, int] | None:
        """The threads, but the main one, that sleep for a time, and how often each has run.

        None: of one the system does not say just now where it is.
        """
        places = {path: each.place for path, each in self._threads.items()}
        self._shows_places |= any(place not in (b"", _NOWHERE) for place in places.values())
        places.pop(self._main, None)
        if self._shows_places and any(
            place == _NOWHERE and not self._threads[path].has_ended() for path, place in places.items()
        ):
            return None
        naps = {path for path, place in places.items() if place in _NAPS} - self._lasting
        return {path: self._threads[path].runs() for path in naps}

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
        for file in self._files.values():
            file.close()
        self._threads.clear()
        self._files.clear()
        self._pids.clear()
        self._reader, self._awake, self._is_known = "", None, False

    def _are_all(self, threads: Sequence[Thread]) -> bool:
        """Whether there were no others when these slept."""
        if self.has_children():
            self._is_known = False
            return set(_tasks(self.pid)) == set(self._threads)
        self._is_known = self._count() == len(threads) == self._own
        return self._is_known

    def _count(self) -> int:
        """How many threads the process itself has."""
        return int(_fields(self._says(f"{self._main}/stat"))[_NUM_THREADS])

    def _all(self) -> list[Thread]:
        """All threads that there are now; those that have ended are forgotten."""
        if self._is_known:
            return list(self._threads.values())
        own, paths = f"{PROC}/{self.pid}/task/", list(_tasks(self.pid))
        self._own = sum(path.startswith(own) for path in paths)
        self._pids = {int(path.split("/")[-3]) for path in paths}
        known, self._threads = self._threads, {}
        try:
            for path in paths:
                self._threads[path] = known.pop(path) if path in known else Thread(path)
        finally:
            for thread in known.values():
                thread.close()
                self._awake = None if thread is self._awake else self._awake
        return list(self._threads.values())

    def _reads(self) -> int:
        """How often the reader was given a processor; -1 if there is no such thread."""
        if not self._reader_name:
            return -1
        try:
            if not self._reader:
                self._all()
                named = (path for path in self._threads if thread_name(path) == self._reader_name)
                self._reader = next(named, "")
            return _runs(self._says(f"{self._reader}/schedstat")) if self._reader else -1
        except OSError:  # it has ended, or another thread has just now
            self.close()
            return -1


class _File:
    """A file of /proc that is read again and again: it stays open."""

    __slots__ = ("_fd",)

    def __init__(self, path: str) -> None:
        self._fd = os.open(path, os.O_RDONLY | os.O_CLOEXEC)

    def read(self) -> bytes:
        """What it says now."""
        return os.pread(self._fd, _READ_BYTES, 0)

    def close(self) -> None:
        """Close it."""
        os.close(self._fd)


class Thread:
    """One thread.

    Attributes:
        place: where in the kernel it was when it was last looked at.
    """

    __slots__ = ("_path", "_wchan", "place")

    def __init__(self, path: str) -> None:
        self._path = path
        self._wchan = _File(f"{path}/wchan")
        self.place = b""

    def sleeps(self) -> bool:
        """Whether it sleeps, or has ended."""
        self.place = self._wchan.read()
        return self.place in _WAITS or self._state() in _AT_REST

    def waits_for_disk(self) -> bool:
        """Whether it waits for what ends by itself and cannot be interrupted, such as a disk; False if it has ended."""
        with suppress(OSError):
            return self._wchan.read() not in _WAITS and self._state() == _DISK
        return False

    def has_ended(self) -> bool:
        """Whether it has ended, and is still there."""
        return self._state() in _ENDED

    def _state(self) -> bytes:
        return _fields(_read(f"{self._path}/stat"))[0]

    def runs(self) -> int:
        """How often it was given a processor."""
        return _runs(_read(f"{self._path}/schedstat"))

    def close(self) -> None:
        """Close its file."""
        self._wchan.close()


def _fields(stat: bytes) -> list[bytes]:
    """What /proc/PID/stat says after the name, which may hold anything."""
    return stat[stat.rindex(b")") + 2 :].split()


def _runs(schedstat: bytes) -> int:
    """How often a thread was given a processor."""
    return int(schedstat.split()[2])


def spent_ns(pid: int) -> int:
    """How long a process's threads have run so far, but for what those have that run just now (clock_getcpuclockid(3)).

    Raises:
        OSError: there is no such process.
    """
    return time.clock_gettime_ns(~pid << 3 | _CPUCLOCK_SCHED)


def thread_ids(pid: int) -> list[int]:
    """Ids of all threads of a process and its descendants.

    Raises:
        OSError: there is no such process, or no /proc.
    """
    return [int(path.rpartition("/")[2]) for path in _tasks(pid)]


def thread_name(path: str) -> str:
    """Name of the thread at a path of /proc.

    Raises:
        OSError: it has ended.
    """
    return _read(f"{path}/comm").decode(errors="replace").strip()


def names_of_threads(pid: int) -> set[str]:
    """Names of the process's own threads, as far as they can be read."""
    names = set()
    with suppress(OSError):
        for tid in os.listdir(f"{PROC}/{pid}/task"):  # noqa: PTH208 (as below)
            with suppress(OSError):
                names.add(thread_name(f"{PROC}/{pid}/task/{tid}"))
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
