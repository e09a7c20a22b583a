"""A core is asked for rest on which a program with a real-time thread works for a while, when it is told to."""

import os
import signal
import socket
import subprocess
import sys
import time

import pytest

from fdm.exchange.px4 import idle_core_probe
from fdm.exchange.px4.idle_core import IdleCore, IdleCores
from fdm.exchange.px4.one_core import may_run_in_order

pytestmark = pytest.mark.skipif(
    sys.platform != "linux" or not may_run_in_order(), reason="no real-time threads for this user"
)

WORKS_S = 0.2
PROGRAM = f"""
import os, sys, time
os.sched_setaffinity(0, {{int(sys.argv[1])}})
os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(int(sys.argv[2])))
print("ready", flush=True)
for line in sys.stdin:
    until = time.thread_time() + {WORKS_S}
    print("works", flush=True)
    while time.thread_time() < until:
        pass
    print(time.monotonic_ns(), flush=True)
"""


class Program:
    """A real-time thread on a core of its own, but for the probe."""

    def __init__(self, core, priority):
        command = [sys.executable, "-c", PROGRAM, str(core), str(priority)]
        self.process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        assert self.says() == "ready"

    def says(self):
        return self.process.stdout.readline().strip()

    def work(self):
        self.process.stdin.write("\n")
        self.process.stdin.flush()
        assert self.says() == "works"

    def close(self):
        self.process.kill()
        self.process.communicate()


@pytest.fixture
def place():
    return max(os.sched_getaffinity(0))


@pytest.fixture
def core(place):
    core = IdleCore(place)
    assert comes(lambda: (core.hear(), core.is_ready)[1])
    yield core
    core.close()


def comes(about, within_s=20.0):
    until_s = time.monotonic() + within_s
    while not about():
        if time.monotonic() > until_s:
            return False
    return True


def rests_at_ns(core, which):
    assert comes(lambda: core.is_at_rest(which))
    return time.monotonic_ns()


@pytest.mark.parametrize("priority", [50, 1])
def test_it_is_at_rest_when_its_real_time_threads_have_ended_what_they_do(core, place, priority):
    """Also those of the priority that the probe has."""
    program = Program(place, priority)
    try:
        which = core.join(program.process.pid, ())
        assert core.is_at_rest(which), "nobody has asked"
        for _ in range(3):
            program.work()
            core.ask(which)
            rested_ns = rests_at_ns(core, which)
            assert rested_ns > int(program.says())
        core.ask(which)
        begun_ns = time.monotonic_ns()
        assert rests_at_ns(core, which) - begun_ns < WORKS_S * 1e9, "it has nothing to do"
    finally:
        program.close()


def test_it_is_woken_at_rest_and_rests_again(core, place):
    program = Program(place, 50)
    try:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as mavlink:
            mavlink.bind(("127.0.0.1", 0))
            mavlink.settimeout(20.0)
            which = core.join(program.process.pid, (mavlink.getsockname()[1],))
            program.work()
            core.ask(which)
            assert mavlink.recv(1) == b""
            woken_ns = time.monotonic_ns()
            assert woken_ns > int(program.says())
            assert rests_at_ns(core, which) > woken_ns - 1e9
    finally:
        program.close()


def test_who_asks_together_is_answered_together(core, place):
    programs = [Program(place, 50), Program(place, 50)]
    try:
        first, second = (core.join(program.process.pid, ()) for program in programs)
        programs[0].work()
        core.ask(first)
        core.ask(second)
        assert not core.is_at_rest(second), "the other one works, on the same core"
        assert comes(lambda: core.is_at_rest(second))
        assert core.is_at_rest(first)
    finally:
        for program in programs:
            program.close()


def test_a_program_that_has_ended_holds_nobody(core, place):
    program = Program(place, 50)
    which = core.join(program.process.pid, ())
    program.close()
    core.ask(which)
    assert comes(lambda: core.is_at_rest(which))


def test_a_probe_that_is_killed_is_asked_no_more(core):
    which = core.join(os.getpid(), ())
    os.kill(core._process.pid, signal.SIGKILL)
    core._process.wait()
    core.ask(which)
    assert comes(lambda: (core.is_at_rest(which), not core.is_ready)[1])
    assert not core.is_at_rest(which)


def test_the_probe_ends_with_who_asks(core):
    process = core._process
    core.close()
    core.close()
    assert process.returncode == 0


def test_a_thread_that_waits_for_the_disk_is_waited_for():
    class Writer:
        def sleeps(self):
            return next(asleep)

    asleep = iter([False, False, True])
    with subprocess.Popen(["sleep", "100"]) as sleeper:
        px4 = idle_core_probe.FlownPx4(sleeper.pid, ())
        px4._writers = [Writer()]
        idle_core_probe.settle([px4], None)
        sleeper.kill()
    assert next(asleep, None) is None, "it was looked at until it slept"


def test_a_process_on_many_cores_has_no_share():
    cores = IdleCores(lambda fd, callback: None)
    if len(os.sched_getaffinity(0)) > 1:
        assert cores.share(os.getpid(), ()) is None
    cores.close()
