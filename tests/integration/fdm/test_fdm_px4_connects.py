"""Who connects to the port at which PX4 finds its simulator: PX4, and whoever else."""

import math
import os
import socket
import struct
import subprocess
import sys
from contextlib import suppress

import pytest

from fdm.clock.events import EventKind
from fdm.exchange.px4 import watched, welcome
from tests.px4_exchange import ROOT, Flight, play, played, spec

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="whether PX4 is at rest is seen in /proc")

FLOOD = """
import socket, sys
client = socket.create_connection(("127.0.0.1", int(sys.argv[1])))
data, sent = bytes((254, *bytes(7))) * (1 << 13), 0
while True:
    client.sendall(data)
    sent += 1
    if sent == 100: print("6 MB", flush=True)
"""
RELAY = """
import select, socket, sys
server = socket.create_server(("127.0.0.1", 0))
print(server.getsockname()[1], flush=True)
near, _ = server.accept()
far = socket.create_connection(("127.0.0.1", int(sys.argv[1])))
while True:
    for end in select.select([near, far], [], [])[0]:
        data = end.recv(65536)
        if not data: sys.exit()
        (far if end is near else near).sendall(data)
"""


def connect(port):
    return socket.create_connection(("127.0.0.1", port), timeout=10.0)


def reset(client):
    """Close without a farewell, as a killed process or a port scanner does."""
    client.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
    client.close()


def test_a_connection_that_is_reset_before_it_is_taken_is_counted_and_px4_flies():
    flight = Flight([spec()], until_s=0.2)
    port = flight.exchange.ports[0]
    reset(connect(port))
    with played(port, 3, 10_000):
        counters = flight.run()
    assert counters[0]["connections_failed"] == 1
    assert [event.kind for event in flight.events] == [EventKind.JOINED]


def test_a_connection_that_ends_in_the_turn_in_which_another_one_comes_ends_nothing():
    """The port is ready before the old connection, which it has closed when that one's turn comes."""
    clients = []

    def at_tick(sim_s):
        if sim_s == 0.0:
            clients.append(connect(port))
            clients[0].sendall(bytes(9))
            clients[0].close()

    flight = Flight([spec()], until_s=0.05, at_tick=at_tick)
    port = flight.exchange.ports[0]
    clients.append(connect(port))
    flight.run()
    clients[1].close()
    assert [event.kind for event in flight.events] == [EventKind.JOINED, EventKind.RESTARTED]


@pytest.mark.slow
def test_one_that_never_stops_writing_holds_nobody():
    """It writes frames of eight bytes, faster than anybody can take them apart."""
    flight = Flight([spec(0), spec(1)], until_s=math.inf)
    ports = flight.exchange.ports
    command = [sys.executable, "-c", FLOOD, str(ports[0])]
    thread = flight.start()
    with played(ports[1], 3, 10**6), subprocess.Popen(command, stdout=subprocess.PIPE) as flood:
        try:
            assert flood.stdout.readline() == b"6 MB\n"
            flight.exchange.stop()
            thread.join(10.0)
            is_stopped = not thread.is_alive()
        finally:
            flood.kill()
            thread.join()
    assert is_stopped
    assert flight.error is None
    flight.exchange.close()


def test_px4_that_flies_stays_and_who_connects_beside_it_is_refused():
    strays = []

    def at_tick(sim_s):
        if sim_s == 0.1:
            strays.append(connect(flight.exchange.ports[0]))

    flight = Flight([spec()], until_s=0.5, at_tick=at_tick)
    with played(flight.exchange.ports[0], 3, 10_000):
        counters = flight.run()
    with strays[0]:
        assert strays[0].recv(1) == b"", "closed"
    assert [event.kind for event in flight.events] == [EventKind.JOINED]
    assert (counters[0]["connections_refused"], counters[0]["frames_unanswered"]) == (1, 3)


@pytest.mark.slow
def test_a_second_px4_is_not_served_and_keeps_its_connection_as_it_would_spin_without():
    others, at_end = [], []

    def at_tick(sim_s):
        if sim_s == 0.1:
            others.append(play(flight.exchange.ports[0], 3, 10_000))
        if flight.exchange.counters(0).get("connections_refused"):
            with suppress(subprocess.TimeoutExpired):
                others[0].wait(0.5)  # it would end within milliseconds
            at_end.append(others[0].poll())
            flight.exchange.stop()

    flight = Flight([spec()], until_s=math.inf, at_tick=at_tick)
    with played(flight.exchange.ports[0], 3, 10**6):
        try:
            flight.run()
            assert others[0].wait(10.0) == 0, "it is closed with the flight"
        finally:
            others[0].kill()
            others[0].wait()
    assert at_end == [None]
    assert [event.kind for event in flight.events] == [EventKind.JOINED]


@pytest.mark.slow
def test_what_is_no_px4_and_says_nothing_gives_way_to_px4():
    flight = Flight([spec()], until_s=math.inf)

    def at_tick(sim_s):
        if any(event.kind is EventKind.RESTARTED for event in flight.events):
            flight.until_s = min(flight.until_s, sim_s + 0.2)

    flight.at_tick = at_tick
    with connect(flight.exchange.ports[0]), played(flight.exchange.ports[0], 3, 10_000):
        flight.run()
    assert [event.kind for event in flight.events][:2] == [EventKind.JOINED, EventKind.RESTARTED]
    assert max(fields[3] for fields in flight.driven) > 1000, "PX4's controls"


def test_only_a_px4_is_placed_and_watched_and_never_ourselves(monkeypatch):
    placed = []
    monkeypatch.setattr(os, "sched_setaffinity", lambda tid, cores: placed.append(tid))
    flight = Flight([spec()], until_s=0.05)
    with connect(flight.exchange.ports[0]):
        counters = flight.run()
    assert counters[0][watched.THROUGH_ANOTHER] == 1
    assert not placed


@pytest.mark.slow
def test_px4_behind_a_relay_is_waited_for_though_the_relay_sleeps():
    flight = Flight([spec()], until_s=2.0)
    command = [sys.executable, "-c", RELAY, str(flight.exchange.ports[0])]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=ROOT) as relay:
        try:
            with played(int(relay.stdout.readline()), 3, 10_000):
                counters = flight.run()
        finally:
            relay.kill()
    assert counters[0][watched.THROUGH_ANOTHER] == 1
    pulses = [fields[3] for fields in flight.driven]
    first = pulses.index(1010)
    assert [(then - now) % 100 for now, then in zip(pulses[first:], pulses[first + 1 :], strict=False)] == [
        10
    ] * (len(pulses) - first - 1), "each frame has the answer to the one before"


def test_where_the_system_does_not_show_when_threads_run_px4_is_flown_and_that_is_counted(monkeypatch):
    monkeypatch.setattr(watched, "shows_rest", lambda: False)
    flight = Flight([spec()], until_s=0.2)
    with played(flight.exchange.ports[0], 3, 10_000):
        counters = flight.run()
    assert counters[0][watched.NOT_SHOWN] == 1
    assert max(fields[3] for fields in flight.driven) > 1000


@pytest.mark.parametrize("is_read_at_rest_alone", [False, True])
def test_a_px4_that_is_not_in_lockstep_is_refused_and_its_neighbour_flies_on(
    is_read_at_rest_alone, monkeypatch
):
    if is_read_at_rest_alone:  # whatever comes first sees its answer
        monkeypatch.setattr(welcome.Px4Seats, "_says", lambda seats, seat: None)
    ended = {}

    def at_tick(sim_s):
        ended[sim_s] = unlocked.poll()

    flight = Flight([spec(0), spec(1)], until_s=0.5, stall_timeout_s=0.5, at_tick=at_tick)
    ports = flight.exchange.ports
    with played(ports[0], 3, 10_000, "unlocked") as unlocked, played(ports[1], 3, 10_000):
        counters = flight.run()
        assert unlocked.wait(10.0) == 0, "its connection is closed with the flight"
    assert ended[0.5] is None, "not before: a PX4 would spin"
    kinds = [event.kind for event in flight.events if event.ua_id == 0]
    assert kinds == [EventKind.JOINED, EventKind.REFUSED, EventKind.STALLED]
    assert counters[0]["answers_not_in_lockstep"] == 1
    assert counters[0]["frames_unanswered"] == 3, "no frame is sent once it has said so"
    assert flight.ticks[-1].sim_time_ns == 500_000_000


@pytest.mark.slow
def test_a_px4_that_was_refused_is_closed_when_another_comes():
    ended, both = [], []

    def at_tick(sim_s):
        refused = any(event.kind is EventKind.REFUSED for event in flight.events)
        if refused and len(both) == 1:
            ended.append(both[0].poll())
            both.append(play(port, 3, 10_000))
        if any(event.kind is EventKind.RESTARTED for event in flight.events):
            both[0].wait(10.0)
            flight.exchange.stop()

    flight = Flight([spec(0), spec(1)], until_s=math.inf, stall_timeout_s=0.2, at_tick=at_tick)
    port = flight.exchange.ports[0]
    both.append(play(port, 3, 10_000, "unlocked"))
    try:
        with played(flight.exchange.ports[1], 3, 10**6):
            flight.run()
    finally:
        for each in both:
            each.kill()
            each.wait()
    assert ended == [None]
    assert both[0].returncode == 0


@pytest.mark.slow
def test_a_px4_that_never_answers_is_told_once():
    flight = Flight([spec()], until_s=9.0)
    with played(flight.exchange.ports[0], 0, 0):
        flight.run()
    assert [(event.kind, event.sim_time_ns) for event in flight.events] == [
        (EventKind.JOINED, 0),
        (EventKind.SILENT, 4_000_000_000),
    ]
