"""An exchange and an autopilot in a process of its own share a core at full speed, and get back what they had."""

import math
import os
import subprocess
import sys

import pytest

from fdm.exchange.aircraft_spec import AircraftSpec
from fdm.exchange.exchange import Exchange
from fdm.exchange.placement.shared_core import can_place
from fdm.model.airframe import load_airframe
from fdm.model.geodesy import GeodeticPosition, Home
from fdm.workers.fleet_exchange import open_exchange

pytestmark = pytest.mark.skipif(not can_place(), reason="this system has no cores to choose from")

HOME = Home(GeodeticPosition(47.0, 8.0, 400.0), 0.0)
PILOT = """
import itertools, socket, struct, sys
sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
for count in itertools.count():
    sock.sendto(struct.pack("<HHI16H", 18458, 400, count, *(1000,) * 16), ("127.0.0.1", int(sys.argv[1])))
    sock.recv(4096)
"""


@pytest.fixture
def fly():
    """Flies a pilot of its own process up to tick 10; gives it, with the affinities of both sides at each tick."""
    pilots = []

    def fly(at_tick=lambda exchange, tick: None, placement="shared"):
        seen = []

        def on_tick(status):
            tick = status.sim_time_ns // 50_000_000
            seen.append((os.sched_getaffinity(0), os.sched_getaffinity(pilots[0].pid)))
            at_tick(exchange, tick)
            if tick == 10:
                exchange.stop()

        exchange = Exchange(
            [AircraftSpec(0, load_airframe("f450"), HOME, 0)],
            speed=math.inf,
            placement=placement,
            on_tick=on_tick,
        )
        pilots.append(subprocess.Popen([sys.executable, "-c", PILOT, str(exchange.ports[0])]))
        try:
            exchange.run()
        finally:
            after = (os.sched_getaffinity(0), os.sched_getaffinity(pilots[0].pid))
            exchange.close()
            seen.append(after)
            fly.seen = seen
        return seen

    yield fly
    for pilot in pilots:
        pilot.kill()
        pilot.wait()


def test_they_share_a_core_until_the_end(fly):
    every = os.sched_getaffinity(0)
    *flown, after = fly()
    assert len(flown) == 11
    assert all(own == its and len(own) == 1 for own, its in flown)
    assert after == (every, every)


def test_an_error_of_a_callback_gives_the_cores_back(fly):
    every = os.sched_getaffinity(0)

    def at_tick(exchange, tick):
        if tick == 3:
            raise RuntimeError("not me")

    with pytest.raises(RuntimeError, match="not me"):
        fly(at_tick)
    assert len(fly.seen[0][0]) == 1
    assert fly.seen[-1] == (every, every)


def test_a_change_to_real_time_gives_them_back_and_full_speed_takes_them_again(fly):
    every = os.sched_getaffinity(0)
    seen = fly(
        lambda exchange, tick: exchange.set_speed({3: 2.0, 6: math.inf}.get(tick, exchange._clock.pace.speed))
    )
    assert [len(own) for own, _ in seen] == [1] * 4 + [len(every)] * 3 + [1] * 4 + [len(every)]


def test_spread_leaves_them_alone(fly):
    every = os.sched_getaffinity(0)
    assert set(map(str, fly(placement="spread"))) == {str((every, every))}


def test_another_placement_is_refused():
    spec = AircraftSpec(0, load_airframe("f450"), HOME, 0)
    with pytest.raises(ValueError, match="placement = 'here': must be one of auto, spread, shared"):
        Exchange([spec], placement="here")
    with pytest.raises(ValueError, match="placement = 'here'"):
        open_exchange([spec, AircraftSpec(1, spec.airframe, HOME, 0)], workers=2, placement="here")
