import math
import os
import socket
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from fdm.exchange.placement.placement import Placer
from fdm.exchange.placement.shared_core import SharedCore, can_place, process_at

pytestmark = pytest.mark.skipif(not can_place(), reason="this system has no cores to choose from")

CODE = """
import socket, sys, threading
sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
sock.bind(("127.0.0.1", 0))
threading.Thread(target=threading.Event().wait, daemon=True).start()
print(sock.getsockname()[1], flush=True)
sys.stdin.readline()
threading.Thread(target=threading.Event().wait, daemon=True).start()
print("ready", flush=True)
sys.stdin.readline()
"""


@pytest.fixture
def autopilot():
    """A process with a UDP socket and two threads, and with a third one after a line."""
    with subprocess.Popen(
        [sys.executable, "-c", CODE], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:
        process.port = int(process.stdout.readline())
        yield process
        process.kill()


def threads_of(process):
    return {int(path.name) for path in Path(f"/proc/{process.pid}/task").iterdir()}


def cores_of(process):
    return [os.sched_getaffinity(thread) for thread in threads_of(process)]


def seat(port, parallel=False, live=True, host="127.0.0.1"):
    aircraft = SimpleNamespace(parallel=parallel, lockstep=SimpleNamespace(sender=(host, port)))
    return SimpleNamespace(aircraft=aircraft, member=SimpleNamespace(live=live))


def test_both_sides_share_a_core_and_get_back_what_they_had(autopilot):
    own, allowed = os.sched_getaffinity(0), os.sched_getaffinity(autopilot.pid)
    shared = SharedCore([autopilot.pid])
    core = os.sched_getaffinity(0)
    assert len(core) == 1
    assert cores_of(autopilot) == [core] * 2
    autopilot.stdin.write("go on\n")
    autopilot.stdin.flush()
    autopilot.stdout.readline()
    assert cores_of(autopilot) == [core] * 3
    shared.give_back()
    assert os.sched_getaffinity(0) == own
    assert cores_of(autopilot) == [allowed] * 3
    shared.give_back()


def test_a_process_that_has_ended_is_no_error(autopilot):
    own = os.sched_getaffinity(0)
    shared = SharedCore([autopilot.pid])
    autopilot.kill()
    autopilot.wait()
    shared.give_back()
    SharedCore([autopilot.pid]).give_back()
    assert os.sched_getaffinity(0) == own


def test_the_process_behind_a_loopback_address_is_found_and_no_other(autopilot):
    assert process_at(("127.0.0.1", autopilot.port)) == autopilot.pid
    assert process_at(("192.0.2.1", autopilot.port)) is None
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as own:
        own.bind(("127.0.0.1", 0))
        port = own.getsockname()[1]
        assert process_at(("127.0.0.1", port)) is None, "this very process"
    assert process_at(("127.0.0.1", port)) is None


def fly(placer, seats, speed=math.inf, ticks=4000, begin=0, rate=5.0, others=0):
    """Ticks of a run at `rate` of real time; gives on how many cores this thread was at them."""
    seen = []
    for tick in range(begin, begin + ticks):
        placer.at_tick(seats, speed, tick * 50_000_000, int(tick * 50_000_000 / rate), others)
        seen.append(len(os.sched_getaffinity(0)))
    return seen


def test_what_was_asked_for_holds_at_full_speed_only(autopilot):
    placer = Placer("shared", alone=True)
    every = len(os.sched_getaffinity(0))
    seats = [seat(autopilot.port)]
    assert fly(placer, seats, ticks=3) == [1] * 3
    assert fly(placer, seats, speed=1.0, ticks=3) == [every] * 3
    assert fly(placer, seats, ticks=3) == [1] * 3
    assert fly(placer, [seat(autopilot.port, live=False)], ticks=3) == [every] * 3
    assert fly(placer, [seat(autopilot.port, host="192.0.2.1")], ticks=3) == [every] * 3
    assert fly(placer, seats, ticks=3) == [1] * 3
    placer.give_back()
    assert len(os.sched_getaffinity(0)) == every


def test_unasked_both_are_tried_and_what_does_not_pay_is_given_up(autopilot):
    placer = Placer("auto", alone=True)
    every = len(os.sched_getaffinity(0))
    seen = fly(placer, [seat(autopilot.port)])
    assert {1, every} == set(seen)
    assert seen[-1] == every
    assert seen.count(1) < 100 * 2


def test_unasked_nothing_is_tried_beside_a_ua_of_another_kind(autopilot):
    every = len(os.sched_getaffinity(0))
    assert set(fly(Placer("auto", alone=True), [seat(autopilot.port)], others=1)) == {every}


@pytest.mark.parametrize("case", ["two UA", "parallel", "workers", "real time", "spread", "unknown"])
def test_unasked_nothing_is_tried_where_it_is_not_known_to_pay(autopilot, case):
    own = seat(
        autopilot.port, parallel=case == "parallel", host="192.0.2.1" if case == "unknown" else "127.0.0.1"
    )
    seats = [own, seat(autopilot.port)] if case == "two UA" else [own]
    placer = Placer("spread" if case == "spread" else "auto", alone=case != "workers")
    assert set(fly(placer, seats, speed=1.0 if case == "real time" else math.inf)) == {
        len(os.sched_getaffinity(0))
    }


def test_on_one_core_nothing_happens(autopilot, monkeypatch):
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {0})
    monkeypatch.setattr(os, "sched_setaffinity", lambda *_: pytest.fail("it was placed"))
    placer = Placer("shared", alone=True)
    fly(placer, [seat(autopilot.port)], ticks=3)
    placer.give_back()


def test_where_the_system_cannot_nothing_happens(autopilot, monkeypatch):
    monkeypatch.delattr(os, "sched_setaffinity")
    placer = Placer("shared", alone=True)
    fly(placer, [seat(autopilot.port)], ticks=3)
    placer.give_back()
