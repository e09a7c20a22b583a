"""A seat of PX4 with a connection whose other end is ours, on which no PX4 is."""

import errno
import os
import socket

import pytest

from fdm.clock.member import Member
from fdm.exchange.ports import bind
from fdm.exchange.px4.peer import Peer
from fdm.exchange.px4.seat import Newcomer, Px4Seat
from tests.px4_exchange import spec
from tests.stepping import SteppingModel


@pytest.fixture
def ends():
    near, far = socket.socketpair()
    for end in (near, far):
        end.setblocking(False)
    with near, far:
        yield near, far


def make_seat(ua_id=0):
    ua = spec(ua_id)
    return Px4Seat(ua, bind(ua, "127.0.0.1"), Member(ua_id), lambda *_: SteppingModel([]), 50_000_000)


@pytest.fixture
def seat():
    seat = make_seat()
    yield seat
    seat.close()


def read_all(end):
    data = b""
    while True:
        try:
            data += end.recv(1 << 16)
        except BlockingIOError:
            return data


def test_a_frame_that_the_system_takes_in_part_is_ended_before_the_next_one(seat, ends):
    near, far = ends
    seat.aircraft.fields = seat.welcome(Newcomer(near, Peer()))
    frames = [bytes((number % 256,)) * 10_007 for number in range(200)]
    for frame in frames:
        seat.send(frame)
    lost = seat.counters()["send_failed"]
    assert 0 < lost < len(frames)
    got = read_all(far)
    seat.send(b"last")
    got += read_all(far)
    assert got == b"".join(frames[: len(frames) - lost]) + b"last"


def test_no_file_descriptor_left_for_a_connection_is_counted(seat):
    class Full:
        def accept(self):
            raise OSError(errno.EMFILE, "Too many open files")

    port, seat.sock = seat.sock, Full()
    assert seat.accept() is None
    seat.sock = port
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
    ends[1].send(b"noise")
    assert seat.receive()
    other, its_end = socket.socketpair()
    with other, its_end:
        seat.welcome(Newcomer(other, Peer()))
        assert seat.counters()["noise_bytes"] == 5
