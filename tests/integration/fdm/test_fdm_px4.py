"""An exchange with a program that plays PX4's side (tests.px4_played): real TCP, real threads at rest."""

import hashlib
import os
import signal
import subprocess
import sys
import threading
from contextlib import contextmanager
from pathlib import Path

import pytest

from fdm.clock.events import EventKind
from fdm.errors import AirframeError, PortInUseError
from fdm.exchange.aircraft_spec import AircraftSpec, Px4Peer
from fdm.exchange.exchange import Exchange
from fdm.model.airframe import load_airframe
from fdm.model.geodesy import GeodeticPosition, Home
from fdm.model.px4_sensors import Px4Sensors
from tests.stepping import SteppingModel

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="whether PX4 is at rest is seen in /proc")
ROOT = Path(__file__).parents[3]
HOME = Home(GeodeticPosition(47.3977, 8.5456, 488.0))


def spec(ua_id=0, port=0, airframe="f450"):
    return AircraftSpec(ua_id, load_airframe(airframe), HOME, port, px4=Px4Peer(Px4Sensors(), seed=1))


@contextmanager
def played(port, silent, answers):
    command = [sys.executable, "-m", "tests.px4_played", *map(str, (port, silent, answers))]
    with subprocess.Popen(command, cwd=ROOT) as process:
        try:
            yield process
        finally:
            process.kill()


class Flight:
    """Runs an exchange in a thread up to a tick; `at_tick` may do something on the way."""

    def __init__(self, specs, until_s, at_tick=lambda sim_s: None, **settings):
        self.events, self.ticks, self.driven = [], [], []
        self.until_s, self.at_tick = until_s, at_tick
        self.exchange = Exchange(
            specs,
            speed=float("inf"),
            on_tick=self._tick,
            on_event=self.events.append,
            build_model=lambda airframe, home: SteppingModel(self.driven),
            **settings,
        )

    def _tick(self, status):
        self.ticks.append(status)
        self.at_tick(status.sim_time_ns / 1e9)
        if status.sim_time_ns >= self.until_s * 1e9:
            self.exchange.stop()

    def run(self, timeout_s=60.0):
        thread = threading.Thread(target=self.exchange.run)
        thread.start()
        thread.join(timeout_s)
        self.exchange.stop()
        thread.join()
        counters = {ua_id: self.exchange.counters(ua_id) for ua_id in self.exchange.ports}
        self.exchange.close()
        return counters


def test_frames_go_on_where_nobody_answers_and_how_many_is_no_matter_of_wall_time():
    digests = set()
    for _ in range(3):
        flight = Flight([spec()], until_s=0.2)
        with played(flight.exchange.ports[0], silent=7, answers=1000):
            counters = flight.run()
        assert counters[0]["frames_unanswered"] == 7
        assert flight.events[0].kind is EventKind.JOINED
        digests.add(hashlib.sha256(repr(flight.driven[:50]).encode()).hexdigest())
    assert len(digests) == 1
    assert [fields[3] for fields in flight.driven[:11]] == [1000] * 8 + [1010, 1020, 1030]


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


def test_a_px4_that_is_stopped_for_a_while_is_let_go_and_taken_back():
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


def test_a_px4_that_connects_anew_boots_anew():
    def at_tick(sim_s):
        if sim_s == 0.1:
            first.kill()
            first.wait()
            others.append(subprocess.Popen(command, cwd=ROOT))

    others = []
    flight = Flight([spec()], until_s=0.4, at_tick=at_tick, stall_timeout_s=30.0)
    port = flight.exchange.ports[0]
    command = [sys.executable, "-m", "tests.px4_played", str(port), "3", "10000"]
    try:
        with played(port, 3, 10_000) as first:
            counters = flight.run()
    finally:
        for other in others:
            other.kill()
            other.wait()
    assert [event.kind for event in flight.events] == [EventKind.JOINED, EventKind.RESTARTED]
    assert (counters[0]["boots"], counters[0]["restarts"]) == (1, 1)


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
