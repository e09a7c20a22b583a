"""A core is asked for rest on which a program with a real-time thread works for a while, when it is told to."""

import os
import signal
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from fdm.exchange.px4.idle_core import IdleCore, IdleCores
from fdm.exchange.px4.one_core import core_in_order, may_run_in_order

pytestmark = pytest.mark.skipif(
    sys.platform != "linux" or not may_run_in_order(), reason="no real-time threads for this user"
)

WORKS_S = 0.2
PROGRAM = f"""
import os, socket, sys, time
os.sched_setaffinity(0, {{int(sys.argv[1])}})
os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(int(sys.argv[2])))
told = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
told.bind(("127.0.0.1", 0))
print(told.getsockname()[1], flush=True)
while True:
    word = told.recv(9)
    print("works", flush=True)
    until = time.thread_time() + {WORKS_S}
    while time.thread_time() < until:
        pass
    print(time.monotonic_ns(), flush=True)
"""


class Program:
    """A real-time thread that works when it gets a datagram, and then says when it has ended that."""

    def __init__(self, core, priority):
        command = [sys.executable, "-c", PROGRAM, str(core), str(priority)]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        self.pid, self.port = self.process.pid, int(self.process.stdout.readline())

    def work(self):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            sender.sendto(b"work", ("127.0.0.1", self.port))
        assert self.process.stdout.readline() == "works\n"

    def ended_ns(self):
        return int(self.process.stdout.readline())

    def close(self):
        self.process.kill()
        self.process.wait()
        self.process.stdout.close()


@pytest.fixture
def place():
    return max(os.sched_getaffinity(0))


@pytest.fixture
def core(place):
    core = IdleCore(place)
    assert comes(lambda: (core.hear(), core.is_ready)[1])
    yield core
    core.close()


@pytest.fixture
def start(place):
    programs = []

    def start(priority=50):
        programs.append(Program(place, priority))
        return programs[-1]

    yield start
    for program in programs:
        program.close()


def comes(about, within_s=20.0):
    until_s = time.monotonic() + within_s
    while not about():
        if time.monotonic() > until_s:
            return False
        time.sleep(0.001)  # on one core the others are to run
    return True


def rests_at_ns(share):
    assert comes(share.is_at_rest)
    return time.monotonic_ns()


@pytest.mark.slow
@pytest.mark.parametrize("priority", [50, 1])
def test_it_is_at_rest_when_its_real_time_threads_have_ended_what_they_do(core, start, priority):
    """Also those of the priority that the probe has."""
    program = start(priority)
    share = core.join(program.pid, ())
    assert share.is_at_rest(), "nobody has asked"
    for _ in range(3):
        program.work()
        share.ask()
        assert rests_at_ns(share) > program.ended_ns()
    share.ask()
    assert rests_at_ns(share)


@pytest.mark.slow
def test_it_is_woken_at_rest_and_rests_again(core, start):
    """The wake has it work anew."""
    program = start()
    share = core.join(program.pid, (program.port,))
    program.work()
    share.ask()
    rested_ns = rests_at_ns(share)
    first_ns = program.ended_ns()
    assert program.process.stdout.readline() == "works\n"
    assert first_ns + WORKS_S * 1e9 <= program.ended_ns() < rested_ns


@pytest.mark.slow
def test_who_is_asked_about_beside_one_that_works_waits_for_it(core, start):
    first, second = start(), start()
    shares = [core.join(program.pid, ()) for program in (first, second)]
    first.work()
    for share in shares:
        share.ask()
    assert rests_at_ns(shares[1]) > first.ended_ns()
    assert rests_at_ns(shares[0])


def test_a_stopped_program_is_at_rest_and_holds_nobody(core, start):
    stopped, other = start(), start()
    shares = [core.join(program.pid, ()) for program in (stopped, other)]
    os.kill(stopped.pid, signal.SIGSTOP)
    for share in shares:
        share.ask()
    assert all(rests_at_ns(share) for share in shares)


def test_a_program_that_has_ended_or_left_holds_nobody(core, start):
    ended, left, other = start(), start(), start()
    shares = [core.join(program.pid, ()) for program in (ended, left, other)]
    ended.close()
    shares[1].ask()
    shares[1].leave()
    shares[0].ask()
    shares[2].ask()
    assert rests_at_ns(shares[0])
    assert rests_at_ns(shares[2])


def test_a_probe_that_is_killed_is_asked_no_more(core):
    share = core.join(os.getpid(), ())
    os.kill(core._process.pid, signal.SIGKILL)
    core._process.wait()
    share.ask()
    core.hear()
    assert core.is_over
    assert not core.is_ready
    assert not share.is_at_rest()


def test_the_probe_ends_with_who_asks(core):
    process = core._process
    core.close()
    core.close()
    assert process.returncode == 0


def test_a_share_is_of_a_process_whose_threads_are_real_time_ones_on_one_core(start, place):
    """But for those that have its own name."""

    def wait():
        Path("/proc/thread-self/comm").write_text("module", encoding="ascii")
        named.set()
        waits.wait()

    assert core_in_order(start().pid) == place
    named, waits = threading.Event(), threading.Event()
    thread = threading.Thread(target=wait)
    thread.start()
    named.wait()
    assert core_in_order(os.getpid()) is None
    waits.set()
    thread.join()


def test_a_probe_that_ends_is_forgotten_by_the_loop(start):
    heard, forgotten = {}, []
    cores = IdleCores(heard.__setitem__, forgotten.append)
    program = start()
    try:
        assert cores.share(program.pid, ()) is not None
        ((fd, callback),) = heard.items()
        (core,) = cores._cores.values()
        assert comes(lambda: (callback(), core.is_ready)[1])
        core._process.kill()
        core._process.wait()
        callback()
        assert forgotten == [fd]
        assert cores.share(program.pid, ()) is None, "looks are left"
    finally:
        cores.close()
