"""Rest is looked for in a program of several threads, which does what it is told over a pipe."""

import os
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import pytest

from fdm.exchange.px4.one_core import keep_on_one_core
from fdm.exchange.px4.quiet import Rest, thread_ids

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="/proc is Linux's")

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


def comes_to_rest(rest, within_s=10.0):
    until_s = time.monotonic() + within_s
    while time.monotonic() < until_s:
        if rest.is_at_rest():
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


def test_all_its_threads_are_kept_on_one_core(program):
    assert keep_on_one_core(program.pid, 3)
    cores = [os.sched_getaffinity(tid) for tid in thread_ids(program.pid)]
    assert len(cores) == 2
    assert cores[0] == cores[1]
    assert len(cores[0]) == 1


def test_a_thread_that_naps_is_at_rest_only_when_it_has_for_long(program):
    rest = Rest(program.pid)
    assert comes_to_rest(rest)
    assert not rest.naps
    tell(program, "nap")
    program.stdout.readline()
    begun_s = time.monotonic()
    assert comes_to_rest(rest), "at once, where naps do not matter"
    while not rest.is_at_rest(nap_ns=300_000_000):
        assert time.monotonic() < begun_s + 10.0
    assert time.monotonic() >= begun_s + 0.3
    assert rest.naps
