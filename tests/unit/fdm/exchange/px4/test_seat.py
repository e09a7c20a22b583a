"""A seat of PX4 with a connection whose other end is ours, on which no PX4 is."""

import errno
import os
import socket

import pytest

from fdm.clock.member import Member
from fdm.exchange.ports import bind
from fdm.exchange.px4 import seat as seat_module
from fdm.exchange.px4.callers import Newcomer
from fdm.exchange.px4.idle_core import IdleCores
from fdm.exchange.px4.peer import Peer
from fdm.exchange.px4.seat import Px4Seat
from tests.px4_exchange import spec
from tests.stepping import SteppingModel


@pytest.fixture
def ends():
    with socket.create_server(("127.0.0.1", 0)) as server:
        far = socket.create_connection(server.getsockname())
        near, _ = server.accept()
    with near, far:
        near.setblocking(False)
        far.settimeout(10.0)
        yield near, far


def make_seat(ua_id=0):
    ua = spec(ua_id)
    cores = IdleCores(lambda fd, callback: None, lambda fd: None)
    return Px4Seat(ua, bind(ua, "127.0.0.1"), Member(ua_id), lambda *_: SteppingModel([]), 50_000_000, cores)


@pytest.fixture
def seat():
    seat = make_seat()
    yield seat
    seat.close()


def read(end, size):
    data = b""
    while len(data) < size:
        data += end.recv(size - len(data))
    return data


def test_a_frame_that_the_system_takes_in_part_is_ended_before_the_next_one(seat, ends):
    near, far = ends
    seat.aircraft.fields = seat.welcome(Newcomer(near, Peer()))
    frames = [bytes((number % 256,)) * 100_007 for number in range(200)]
    for frame in frames:
        seat.send(frame)
    taken = len(frames) - seat.counters()["send_failed"]
    assert 0 < taken < len(frames)
    sent = b"".join(frames[:taken])
    got = read(far, len(sent) - len(seat._unsent))
    seat.send(b"last")
    assert got + read(far, len(sent) + 4 - len(got)) == sent + b"last"


def test_no_file_descriptor_left_for_a_connection_is_counted(seat):
    class Full:
        def accept(self):
            raise OSError(errno.EMFILE, "Too many open files")

    port, seat.callers.sock = seat.callers.sock, Full()
    assert seat.accept() is None
    seat.callers.sock = port
    assert seat.counters()["connections_failed"] == 1


def test_nobody_there_is_not_counted(seat):
    assert seat.accept() is None
    assert "connections_failed" not in seat.counters()


def test_cores_are_those_of_the_start(ends, monkeypatch):
    """Later the exchange's thread may be on one of them, with ArduPilot."""
    placed = {}
    monkeypatch.setattr(os, "sched_getaffinity", lambda pid: {3, 5})
    seat = make_seat(ua_id=1)
    monkeypatch.setattr(os, "sched_getaffinity", lambda pid: {3})
    monkeypatch.setattr(os, "sched_setaffinity", placed.__setitem__)
    seat.welcome(Newcomer(ends[0], Peer(os.getpid(), is_px4=True)))
    seat.close()
    assert list(placed.values()) == [{5}] * len(placed)
    assert os.getpid() in placed


def test_the_last_frame_is_what_the_sensors_were_made_of(seat):
    assert seat.last_frame() is None
    seat.aircraft.fields = (0, 250, 0, *(1000,) * 16)
    seat.aircraft.measure()
    last = seat.last_frame()
    assert (last.timestamp_s, last.specific_force_frd_mps2) == (0.004, (0.0, 0.0, -9.8))


def test_another_connection_keeps_what_the_one_before_counted(seat, ends):
    seat.welcome(Newcomer(ends[0], Peer()))
    ends[0].setblocking(True)
    ends[1].send(b"noise")
    ends[1].close()
    assert not seat.receive(), "to its end"
    other, its_end = socket.socketpair()
    with other, its_end:
        seat.welcome(Newcomer(other, Peer()))
        assert seat.counters()["noise_bytes"] == 5


class NeverAtRest:
    """A share of a core whose probe says nothing."""

    is_ready, is_over, has_left = True, False, False

    def may_fly(self):
        return True

    def end_turn(self):
        pass

    def ask(self):
        pass

    def is_at_rest(self):
        return False

    def leave(self):
        self.has_left = True


class LooksAsleep:
    """What would be looked at instead."""

    sleeps = True

    def sent(self):
        pass

    def is_at_rest(self, naps=0):
        return self.sleeps

    def close(self):
        pass


def test_a_frame_that_waits_too_long_for_rest_is_sent_and_counted_and_looks_are_taken_from_then_on(
    seat, ends, monkeypatch
):
    near, far = ends
    seat.aircraft.fields = seat.welcome(Newcomer(near, Peer()))
    seat._rest, seat._core = LooksAsleep(), NeverAtRest()
    core = seat._core
    seat.send(b"first")
    assert seat.wants_look(), "it waits"
    monkeypatch.setattr(seat_module, "SETTLES_NS", 0)
    seat.go_on()
    assert read(far, 5) == b"first"
    assert seat.counters()["frames_sent_before_rest"] == 1
    assert core.has_left
    seat.send(b"second")
    assert read(far, 6) == b"second"
    assert seat.counters()["frames_sent_before_rest"] == 1


@pytest.mark.parametrize("sleeps", [True, False])
def test_a_frame_taken_before_its_probe_has_ended_is_sent_when_px4_looks_asleep(
    seat, ends, monkeypatch, sleeps
):
    near, far = ends
    seat.aircraft.fields = seat.welcome(Newcomer(near, Peer()))
    seat._rest, seat._core = LooksAsleep(), NeverAtRest()
    core = seat._core
    core.is_ready, core.is_over, seat._rest.sleeps = False, True, sleeps
    monkeypatch.setattr(seat_module, "SETTLES_NS", 0)
    seat.send(b"first")
    assert read(far, 5) == b"first"
    assert seat.counters().get("frames_sent_before_rest", 0) == (not sleeps)
    assert core.has_left
