"""An exchange with a program that plays PX4's side (tests.px4_played): frames, ends and boots."""

import hashlib
import os
import signal
import socket
import sys
import time
from contextlib import ExitStack, suppress

import pytest

from fdm.clock.events import EventKind
from fdm.errors import AirframeError, PortInUseError
from fdm.exchange.aircraft_spec import AircraftSpec, Px4Peer
from fdm.exchange.exchange import Exchange
from fdm.exchange.px4 import watched
from fdm.exchange.px4.idle_core import AT_ONCE, IdleCores
from fdm.exchange.px4.one_core import may_run_in_order
from fdm.model.airframe import load_airframe
from fdm.model.px4_sensors import Px4Sensors
from tests.px4_exchange import HOME, Flight, play, played, spec

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="whether PX4 is at rest is seen in /proc")


@pytest.mark.slow
def test_frames_go_on_where_nobody_answers_and_how_many_is_no_matter_of_wall_time():
    digests = set()
    for _ in range(3):
        flight = Flight([spec()], until_s=0.2)
        with played(flight.exchange.ports[0], silent=7, answers=1000):
            counters = flight.run()
        assert counters[0]["frames_unanswered"] == 7
        assert flight.events[0].kind is EventKind.JOINED
        assert not counters[0].keys() & {watched.BY_WALL_TIME, watched.THROUGH_ANOTHER, watched.NOT_SHOWN}
        digests.add(hashlib.sha256(repr(flight.driven[:50]).encode()).hexdigest())
    assert len(digests) == 1
    assert [fields[3] for fields in flight.driven[:11]] == [1000] * 8 + [1010, 1020, 1030]


@pytest.mark.slow
def test_a_px4_that_is_killed_is_let_go_and_its_neighbour_flies_on():
    def at_tick(sim_s):
        if sim_s == 0.1:
            first.kill()

    flight = Flight([spec(0), spec(1)], until_s=0.5, at_tick=at_tick, stall_timeout_s=0.5)
    ports = flight.exchange.ports
    with played(ports[0], 3, 10_000) as first, played(ports[1], 3, 10_000):
        flight.run()
    assert [(event.kind, event.ua_id) for event in flight.events if event.kind is EventKind.STALLED] == [
        (EventKind.STALLED, 0)
    ]
    assert flight.ticks[-1].sim_time_ns == 500_000_000
    assert flight.ticks[-1].stalled_ua == (0,)


@pytest.mark.slow
@pytest.mark.parametrize("shows_rest", [True, False])
def test_a_px4_that_is_stopped_for_a_while_is_let_go_and_taken_back(shows_rest, monkeypatch):
    if not shows_rest:
        monkeypatch.setattr(watched, "shows_rest", lambda: False)

    def at_tick(sim_s):
        if sim_s == 0.1:
            os.kill(first.pid, signal.SIGSTOP)
        if sim_s == 0.3:
            os.kill(first.pid, signal.SIGCONT)
        if sim_s >= 0.3 and not any(event.kind is EventKind.RETURNED for event in flight.events):
            flight.until_s = sim_s + 0.5  # a tick takes hardly any wall time: give it some

    flight = Flight([spec(0), spec(1)], until_s=0.8, at_tick=at_tick, stall_timeout_s=0.5)
    ports = flight.exchange.ports
    with played(ports[0], 3, 10**6) as first, played(ports[1], 3, 10**6):
        flight.run()
    kinds = [event.kind for event in flight.events if event.ua_id == 0]
    assert kinds == [EventKind.JOINED, EventKind.STALLED, EventKind.RETURNED]
    assert flight.ticks[-1].stalled_ua == ()


@pytest.mark.slow
def test_a_px4_that_connects_anew_boots_anew():
    def at_tick(sim_s):
        if sim_s == 0.1:
            first.kill()
            first.wait()
            others.append(play(port, 3, 10_000))

    others = []
    flight = Flight([spec()], until_s=0.4, at_tick=at_tick, stall_timeout_s=30.0)
    port = flight.exchange.ports[0]
    try:
        with played(port, 3, 10_000) as first:
            counters = flight.run()
    finally:
        for other in others:
            other.kill()
            other.wait()
    assert [event.kind for event in flight.events] == [EventKind.JOINED, EventKind.RESTARTED]
    assert (counters[0]["boots"], counters[0]["restarts"]) == (1, 1)
    assert counters[0]["frames_unanswered"] == 3 + 3, "of both connections"


def test_a_port_that_is_taken_is_told():
    exchange = Exchange([spec()])
    try:
        with pytest.raises(PortInUseError, match="TCP port"):
            Exchange([spec(1, port=exchange.ports[0])])
    finally:
        exchange.close()


def test_an_airframe_without_parameters_for_px4_is_refused():
    airframe = load_airframe("f450").model_copy(update={"px4": None})
    with pytest.raises(AirframeError, match="no section px4"):
        Exchange([AircraftSpec(0, airframe, HOME, 0, px4=Px4Peer(Px4Sensors(), seed=1))])


def test_a_frame_waits_for_a_thread_that_naps_while_px4_boots():
    flight = Flight([spec()], until_s=0.1)
    with played(flight.exchange.ports[0], 5, 10_000, "naps"):
        counters = flight.run()
    assert counters[0]["frames_unanswered"] == 5
    assert [fields[3] for fields in flight.driven[:8]] == [1000] * 6 + [1010, 1020]


@pytest.mark.slow
def test_its_mavlink_is_woken_in_each_frame():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as mavlink:
        mavlink.bind(("127.0.0.1", 0))
        flight = Flight([spec(wakes=(mavlink.getsockname()[1],))], until_s=0.2)
        with played(flight.exchange.ports[0], 3, 10_000):
            flight.run()
        mavlink.setblocking(False)
        for _ in range(50):  # 250 Hz for 0.2 s
            assert mavlink.recv(1) == b""


def test_its_threads_are_kept_on_one_core(monkeypatch):
    """What the system is told, not what it does: that is no matter where there is one core only."""
    placed, place = {}, os.sched_setaffinity
    monkeypatch.setattr(
        os, "sched_setaffinity", lambda tid, core: (placed.update({tid: core}), place(tid, core))
    )
    cores = sorted(os.sched_getaffinity(0))
    theirs = cores[1:] or cores
    flight = Flight([spec(ua_id=1)], until_s=0.1)
    with played(flight.exchange.ports[1], 3, 10_000) as px4:
        counters = flight.run()
        assert placed.keys() >= {px4.pid}
    assert set(map(tuple, placed.values())) == {(theirs[1 % len(theirs)],)}
    assert len(placed) == 2, "the reader, and the one that waits for it"
    assert watched.ON_MANY_CORES not in counters[1]


@pytest.mark.slow
@pytest.mark.skipif(not may_run_in_order(), reason="no real-time threads for this user")
def test_those_who_are_stopped_in_their_turn_on_a_core_hold_nobody(monkeypatch):
    def at_tick(sim_s):
        if sim_s == 0.1:
            wait_for_probes(flight)
        if sim_s == 0.2:
            for px4 in px4s[:AT_ONCE]:
                os.kill(px4.pid, signal.SIGSTOP)

    monkeypatch.setattr(watched, "their_cores", lambda cores: cores[-1:])
    ua = range(AT_ONCE + 2)
    flight = Flight([spec(ua_id) for ua_id in ua], until_s=0.5, at_tick=at_tick, stall_timeout_s=2.0)
    with ExitStack() as stack:
        ports = flight.exchange.ports
        px4s = [stack.enter_context(played(ports[ua_id], 3, 10_000, "real-time")) for ua_id in ua]
        flight.run()
    stalled = {event.ua_id for event in flight.events if event.kind is EventKind.STALLED}
    assert stalled == set(range(AT_ONCE))
    assert flight.ticks[-1].sim_time_ns == 500_000_000


def wait_for_probes(flight):
    """Until those are ready who tell whether PX4 is at rest."""
    for core in flight.exchange._px4.cores._cores.values():
        until_s = time.monotonic() + 20.0
        while not core.is_ready:
            assert time.monotonic() < until_s
            core.hear()


def flown_in_order(at_tick, until_s=1.0, **settings):
    """What a flight was driven by whose PX4 has a real-time thread, and how often its MAVLink was woken."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as mavlink:
        mavlink.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 22)
        mavlink.bind(("127.0.0.1", 0))
        ua = spec(wakes=(mavlink.getsockname()[1],))
        flight = Flight([ua], until_s, at_tick=lambda sim_s: at_tick(flight, sim_s), **settings)
        with played(flight.exchange.ports[0], 3, 10_000, "real-time"):
            counters = flight.run()
        assert watched.OUT_OF_ORDER not in counters[0]
        mavlink.setblocking(False)
        wakes = 0
        with suppress(BlockingIOError):
            while mavlink.recv(1) == b"":
                wakes += 1
    return flight.driven[:240], wakes


@pytest.mark.slow
@pytest.mark.skipif(not may_run_in_order(), reason="no real-time threads for this user")
@pytest.mark.parametrize("killed_at_s", [9.0, 0.5], ids=["to the end", "the probe is killed"])
def test_frames_of_real_time_threads_are_those_that_looks_give(killed_at_s, monkeypatch):
    """However it is seen that PX4 is at rest, it is driven alike, and woken in each frame."""

    def at_tick(flight, sim_s):
        if sim_s == 0.1:
            wait_for_probes(flight)
        for core in flight.exchange._px4.cores._cores.values():
            if sim_s == 0.4:
                asked.append(core.is_ready)
            if sim_s == killed_at_s:
                core._process.kill()

    asked = []
    driven, wakes = flown_in_order(at_tick)
    assert asked == [True]
    monkeypatch.setattr(IdleCores, "share", lambda *_: None)
    by_looks, _ = flown_in_order(lambda flight, sim_s: None)
    assert driven == by_looks
    assert len(driven) == 240
    assert wakes >= 240


@pytest.mark.slow
@pytest.mark.skipif(not may_run_in_order(), reason="no real-time threads for this user")
def test_a_px4_that_waits_for_its_next_frame_is_woken_anew_before_it():
    """At a fifth of real time a frame comes every 20 ms; its MAVLink threads would wake by themselves after 10."""

    def at_tick(flight, sim_s):
        if sim_s == 0.1:
            wait_for_probes(flight)

    _, wakes = flown_in_order(at_tick, until_s=0.6, speed=0.2)
    assert wakes >= 2 * 125
