"""What the probe does with what it sees, without its priority."""

import os
import socket
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from fdm.exchange.px4 import idle_core_probe
from fdm.exchange.px4.idle_core_probe import FlownPx4, Probe, at_rest

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="/proc is Linux's")


class Writer:
    """A thread that waits for the disk for some looks."""

    def __init__(self, looks):
        self.looks = looks

    def waits_for_disk(self):
        self.looks -= 1
        return self.looks >= 0


@pytest.fixture
def sleeper():
    with subprocess.Popen(["sleep", "100"]) as process:
        yield process
        process.kill()


@pytest.fixture
def sender():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        yield sender


def flown(sleeper, looks=0, ports=()):
    px4 = FlownPx4(sleeper.pid, ports)
    px4._writers = [Writer(looks)]
    return px4


def test_one_that_waits_for_the_disk_is_not_at_rest_and_holds_nobody(sleeper, sender):
    writes, rests = flown(sleeper, 2), flown(sleeper)
    assert at_rest([writes, rests], sender) == [rests]
    assert at_rest([writes], sender) == []
    assert at_rest([writes], sender) == [writes]


def test_one_that_waits_for_the_disk_when_it_was_woken_is_not_at_rest(sleeper, sender):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as mavlink:
        mavlink.bind(("127.0.0.1", 0))
        mavlink.settimeout(20.0)
        px4 = flown(sleeper, ports=(mavlink.getsockname()[1],))
        px4._writers = [Writer(0), Writer(0)]
        px4._writers[1].waits_for_disk = iter([False, True, False, False]).__next__
        assert at_rest([px4], sender) == []
        assert at_rest([px4], sender) == [px4]
        assert [mavlink.recv(1), mavlink.recv(1)] == [b"", b""]


def test_its_writers_are_found_by_their_names():
    waits = threading.Event()
    named = threading.Event()

    def wait():
        Path("/proc/thread-self/comm").write_text("mavlink_rcv_if0", encoding="ascii")
        named.set()
        waits.wait()

    thread = threading.Thread(target=wait)
    thread.start()
    named.wait()
    px4 = FlownPx4(os.getpid(), ())
    assert len(px4._writers) == 1
    assert not px4.waits_for_disk(), "it sleeps"
    waits.set()
    thread.join()
    assert not px4.waits_for_disk(), "it has ended"
    px4.close()


def test_what_is_said_and_asked_for(sleeper, sender):
    probe = Probe()
    probe.hear([b"join 3 %d" % sleeper.pid, b"join 7 %d" % sleeper.pid, b"ask 7", b"ask 3"])
    assert probe.answers(sender) == bytes((3, 7))
    assert not probe.is_asked
    probe.hear([b"ask 3", b"leave 3", b"ask 7"])
    assert probe.answers(sender) == bytes((7,))


def test_without_the_right_to_its_priority_it_ends_without_a_word(monkeypatch):
    def refuse(*_):
        raise PermissionError

    monkeypatch.setattr(os, "sched_setscheduler", refuse)
    monkeypatch.setattr(os, "sched_setaffinity", lambda *_: None)
    read, write = os.pipe()
    idle_core_probe.main([str(read), str(write), "0"])
    os.close(write)
    assert os.read(read, 1) == b""
    os.close(read)
