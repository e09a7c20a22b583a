"""Rest is looked for in a program of several threads, which does what it is told over a pipe."""

import os
import signal
import subprocess
import sys
import threading
import time
from contextlib import suppress
from pathlib import Path

import pytest

from fdm.exchange.px4 import quiet
from fdm.exchange.px4.one_core import keep_on_one_core, may_run_in_order
from fdm.exchange.px4.quiet import Rest, shows_rest, thread_ids

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="/proc is Linux's")

DOZE_S = 0.7
PROGRAM = """
import subprocess, sys, threading, time
waits = threading.Event()
threading.Thread(target=waits.wait, daemon=True).start()
def naps():
    while True: time.sleep(0.005)
print("ready", flush=True)
for line in sys.stdin:
    if line == "spin\\n":
        while True: pass
    if line == "nap\\n":
        threading.Thread(target=naps, daemon=True).start()
    if line == "doze\\n":
        threading.Thread(target=lambda: (time.sleep(0.7), waits.wait()), daemon=True).start()
    if line == "sleep\\n":
        threading.Thread(target=time.sleep, args=(1000,), daemon=True).start()
    if line == "start\\n":
        subprocess.Popen([sys.executable, "-c", "while True: pass"])
    print("done", flush=True)
"""


@pytest.fixture
def program():
    process = subprocess.Popen(
        [sys.executable, "-c", PROGRAM],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        bufsize=1,
        start_new_session=True,
    )
    process.stdout.readline()
    yield process
    with suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    process.stdin.close()
    process.stdout.close()


def tell(program, word):
    program.stdin.write(word + "\n")
    program.stdin.flush()


def comes_to_rest(rest, within_s=10.0, naps=0):
    until_s = time.monotonic() + within_s
    while time.monotonic() < until_s:
        if rest.is_at_rest(naps):
            return True
    return False


def test_a_program_whose_threads_wait_is_at_rest(program):
    assert len(thread_ids(program.pid)) == 2
    assert comes_to_rest(Rest(program.pid))


def test_one_thread_that_works_is_enough_not_to_be(program):
    rest = Rest(program.pid)
    assert comes_to_rest(rest)
    tell(program, "spin")
    assert not comes_to_rest(rest, 0.3)


def test_a_child_that_works_counts_too(program):
    rest = Rest(program.pid)
    assert not rest.has_children()
    tell(program, "start")
    program.stdout.readline()
    assert rest.has_children()
    assert not comes_to_rest(rest, 0.3)


def test_a_stopped_program_is_not_at_rest_and_neither_is_one_that_has_ended(program):
    rest = Rest(program.pid)
    os.kill(program.pid, signal.SIGSTOP)
    assert not comes_to_rest(rest, 0.2)
    program.kill()
    program.wait()
    assert not rest.is_at_rest()


def test_what_was_sent_has_to_be_read_first(program):
    name = Path(f"/proc/{program.pid}/comm").read_text(encoding="ascii").strip()
    rest = Rest(program.pid, reader=name)
    assert comes_to_rest(rest)
    rest.sent()
    assert not comes_to_rest(rest, 0.2), "nothing has come that it could have read"
    tell(program, "go on")
    program.stdout.readline()
    assert comes_to_rest(rest)
    rest.close()


def test_without_its_reader_it_is_never_at_rest(program):
    assert not comes_to_rest(Rest(program.pid, reader="sim_rcv"), 0.2)


def open_files():
    return len(list(Path("/proc/self/fd").iterdir()))


def test_a_thread_that_ends_while_it_is_looked_at_leaves_no_file_open(program, monkeypatch):
    """Whatever its place in the list: here the ended one is the first, so that all others come after it."""
    list_tasks, is_ended = quiet._tasks, [False]

    def tasks(pid):
        if is_ended[0]:
            yield f"/proc/{pid}/task/0"
        yield from list_tasks(pid)

    monkeypatch.setattr(quiet, "_tasks", tasks)
    rest, before = Rest(program.pid), open_files()
    for _ in range(20):
        is_ended[0] = False
        assert comes_to_rest(rest)
        rest._is_known, is_ended[0] = False, True
        assert not rest.is_at_rest()
    assert open_files() <= before + 2 + 2, (
        "where two threads wait, the state of the main one and its children"
    )
    rest.close()
    assert open_files() == before


@pytest.fixture
def shown(tmp_path, monkeypatch):
    """What the system shows of this thread; gives its folder."""
    monkeypatch.setattr(quiet, "PROC", str(tmp_path))
    own = tmp_path / "self" / "task" / str(threading.get_native_id())
    own.mkdir(parents=True)
    (own / "children").touch()
    (own / "wchan").touch()
    (own / "schedstat").write_text("0 0 0\n", encoding="ascii")
    return own


def test_this_system_shows_rest():
    assert shows_rest() == Path("/proc/thread-self/schedstat").exists()


def test_counts_that_stay_at_zero_show_no_rest(shown):
    assert not shows_rest()


def test_a_clock_that_stands_shows_no_rest(shown, monkeypatch):
    """One of ticks, say: a thread may run between two of them."""
    counts = iter(range(9))
    read = quiet._read
    monkeypatch.setattr(
        quiet, "_read", lambda path: b"0 0 %d" % next(counts) if path.endswith("schedstat") else read(path)
    )
    assert shows_rest()
    monkeypatch.setattr(quiet, "spent_ns", lambda pid: 40_000_000)
    assert not shows_rest()


@pytest.mark.parametrize("name", ["schedstat", "children", "wchan"])
def test_a_system_without_one_of_what_rest_is_seen_by_shows_none(name, shown, monkeypatch):
    """All is there but `name`: the counts go up."""
    counts = iter(range(9))
    read = quiet._read

    def counting(path):
        return read(path) if path.endswith(name) else b"0 0 %d" % next(counts)

    monkeypatch.setattr(quiet, "_read", counting)
    assert shows_rest() == (name != "schedstat")
    (shown / name).unlink()
    assert not shows_rest()


def test_all_its_threads_are_kept_on_one_core(program, monkeypatch):
    """What the system is told, not what it does: that is no matter where there is one core only."""
    placed = {}
    monkeypatch.setattr(os, "sched_setaffinity", placed.__setitem__)
    assert keep_on_one_core(program.pid, 3, (5, 7))
    assert placed == {tid: {7} for tid in thread_ids(program.pid)}
    assert len(placed) == 2


def test_whether_it_may_have_real_time_threads_is_tried_and_changes_nothing_here(monkeypatch):
    set_scheduler, tried = os.sched_setscheduler, []

    def try_it(pid, policy, parameter):
        tried.append((pid, policy, parameter.sched_priority))
        set_scheduler(pid, policy, parameter)

    before = os.sched_getscheduler(0)
    monkeypatch.setattr(os, "sched_setscheduler", try_it)
    try:
        set_scheduler(0, os.SCHED_FIFO, os.sched_param(99))
        set_scheduler(0, before, os.sched_param(0))
        may = True
    except PermissionError:
        may = False
    assert may_run_in_order() == may
    assert tried == [(0, os.SCHED_FIFO, 99)]
    assert os.sched_getscheduler(0) == before


def test_where_the_system_cannot_place_it_says_so(program, monkeypatch):
    assert not keep_on_one_core(program.pid, 0, ())

    def refuse(tid, cores):
        raise PermissionError

    monkeypatch.setattr(os, "sched_setaffinity", refuse)
    assert not keep_on_one_core(program.pid, 0, (0,))


def test_a_thread_that_naps_is_at_rest_only_when_it_has_woken_and_naps_again(program):
    rest = Rest(program.pid)
    assert comes_to_rest(rest)
    assert not rest.naps
    tell(program, "nap")
    program.stdout.readline()
    begun_s = time.monotonic()
    assert comes_to_rest(rest), "at once, where naps do not matter"
    while not (rest.is_at_rest(naps=21) and rest.naps):  # its first look may come before its first nap
        assert time.monotonic() < begun_s + 30.0
    assert time.monotonic() >= begun_s + 0.05, (
        "naps of 5 ms; of its runs up to half may be those of a nap cut short"
    )


def test_a_nap_that_ends_is_waited_for(program):
    """However long it has napped: it has not woken yet."""
    rest = Rest(program.pid)
    assert comes_to_rest(rest)
    begun_s = time.monotonic()
    tell(program, "doze")
    program.stdout.readline()
    while not rest.naps:
        assert not rest.is_at_rest(naps=1)
        assert time.monotonic() < begun_s + 10.0
    while not rest.is_at_rest(naps=1):
        assert time.monotonic() < begun_s + 10.0
    assert time.monotonic() >= begun_s + DOZE_S
    assert not rest.naps


def test_a_nap_without_an_end_is_not_waited_for(program, monkeypatch):
    monkeypatch.setattr(quiet, "_LONGEST_NAP_NS", 200_000_000)
    rest = Rest(program.pid)
    tell(program, "sleep")
    program.stdout.readline()
    begun_s = time.monotonic()
    while not (rest.is_at_rest(naps=1) and rest.naps):
        assert time.monotonic() < begun_s + 10.0
    assert time.monotonic() >= begun_s + 0.2
    rest.sent()
    assert comes_to_rest(rest, naps=1)
    assert not rest.naps, "nor ever again"


@pytest.mark.parametrize(("shows_others", "is_at_rest"), [(True, False), (False, True)])
def test_a_thread_of_which_is_not_said_where_it_waits_may_nap(program, monkeypatch, shows_others, is_at_rest):
    """So Linux says of one that is still in its processor's queue; where nothing is ever said, nothing is known."""
    rest, sleeps = Rest(program.pid), quiet.Thread.sleeps
    main = f"/proc/{program.pid}/task/{program.pid}"

    def tells_nothing(thread):
        is_asleep = sleeps(thread)
        thread.place = b"pipe_read" if thread._path == main and shows_others else b"0"
        return is_asleep

    assert comes_to_rest(rest)
    monkeypatch.setattr(quiet.Thread, "sleeps", tells_nothing)
    until_s = time.monotonic() + (10.0 if is_at_rest else 0.2)
    found = False
    while not found and time.monotonic() < until_s:
        found = rest.is_at_rest(naps=1)
    assert found == is_at_rest
    assert not rest.naps
    monkeypatch.undo()
    if not is_at_rest:
        while not rest.is_at_rest(naps=1):
            assert time.monotonic() < until_s + 10.0


def test_who_has_run_while_threads_were_counted_was_not_at_rest(program, monkeypatch):
    """Another thread may have come, woken it, and gone."""
    count = Rest._count

    def wakes_it(rest):
        tell(program, "go on")
        program.stdout.readline()
        return count(rest)

    rest = Rest(program.pid)
    assert comes_to_rest(rest)
    monkeypatch.setattr(Rest, "_count", wakes_it)
    assert not comes_to_rest(rest, 0.2)
    monkeypatch.undo()
    assert comes_to_rest(rest)


def test_one_that_wakes_after_its_runs_were_counted_does_not_nap(program, monkeypatch):
    """It may have found what it napped for; on its processor still, it has not been counted."""
    nap = Rest._now_nap

    def wakes_it(rest):
        found = nap(rest)
        tell(program, "spin")
        while Path(f"/proc/{program.pid}/stat").read_bytes().split()[2] != b"R":
            assert time.monotonic() < until_s
        return found

    rest, until_s = Rest(program.pid), time.monotonic() + 10.0
    assert comes_to_rest(rest)
    monkeypatch.setattr(Rest, "_now_nap", wakes_it)
    assert not rest.is_at_rest(naps=1)
    assert Path(f"/proc/{program.pid}/stat").read_bytes().split()[2] == b"R"


def test_a_child_that_has_ended_and_was_not_waited_for_is_nowhere(program):
    rest = Rest(program.pid)
    assert comes_to_rest(rest, naps=1)
    tell(program, "start")
    program.stdout.readline()
    (child,) = Path(f"/proc/{program.pid}/task/{program.pid}/children").read_text(encoding="ascii").split()
    os.kill(int(child), signal.SIGKILL)
    assert comes_to_rest(rest, naps=1)
    assert rest.has_children()
