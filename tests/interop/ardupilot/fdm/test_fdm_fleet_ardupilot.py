"""Two real ArduCopters in one fleet: one is stopped, goes on, is killed, boots anew; the other never minds."""

import contextlib
import math
import os
import signal
import subprocess
import threading
import time
from itertools import pairwise
from pathlib import Path

import pytest

from fdm.clock.events import EventKind
from fdm.exchange.exchange import AircraftSpec, Exchange, default_port
from fdm.model.airframe import load_airframe
from fdm.model.geodesy import GeodeticPosition, Home

pytestmark = pytest.mark.ardupilot

HOME = Home(GeodeticPosition(47.3977, 8.5456, 488.0), 0.0)
PARAMETERS = Path(__file__).parents[4] / "sitl_configs" / "params" / "copter.parm"
WAIT_S = 40.0
STALL_S = 1.0


class Fleet:
    """An exchange in a thread, with what it told and when."""

    def __init__(self, slot, coupling):
        self.events, self.tick_walls, self.ticks = [], [], []
        self.changed = threading.Condition()
        airframe = load_airframe("f450")
        self.exchange = Exchange(
            [AircraftSpec(i, airframe, HOME, default_port(slot + i)) for i in range(2)],
            speed=math.inf,
            coupling=coupling,
            stall_timeout_s=STALL_S,
            on_tick=self.note_tick,
            on_event=self.note_event,
        )
        self.thread = threading.Thread(target=self.exchange.run)
        self.thread.start()

    def note_tick(self, status):
        with self.changed:
            self.ticks.append(status)
            self.tick_walls.append(time.monotonic())
            self.changed.notify_all()

    def note_event(self, event):
        with self.changed:
            self.events.append(event)
            self.changed.notify_all()

    def wait_for(self, condition):
        with self.changed:
            assert self.changed.wait_for(condition, WAIT_S), (self.events, self.ticks[-1:])

    def heard(self, kind):
        return [event.ua_id for event in self.events if event.kind is kind]

    def goes_on(self, seconds):
        """Wait until the fleet's sim time has grown by `seconds`."""
        then_ns = self.ticks[-1].sim_time_ns + round(seconds * 1e9)
        self.wait_for(lambda: self.ticks[-1].sim_time_ns >= then_ns)

    def close(self):
        self.exchange.stop()
        self.thread.join(WAIT_S)
        self.exchange.close()


@contextlib.contextmanager
def copter(binary, instance, directory):
    directory.mkdir(exist_ok=True)
    home = f"{HOME.position.lat_deg},{HOME.position.lon_deg},{HOME.position.alt_amsl_m},0"
    arguments = ["-w", "--model", "JSON:127.0.0.1", f"-I{instance}", "--home", home]
    arguments += ["--defaults", str(PARAMETERS), "--serial0", "tcp:0", "--speedup", "20"]
    with subprocess.Popen(
        [str(binary), *arguments], cwd=directory, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    ) as process:
        try:
            yield process
        finally:
            process.kill()


@pytest.mark.parametrize("coupling", ["serial", "parallel"])
def test_a_stopped_and_a_killed_autopilot_do_not_hold_the_other(arducopter, free_slot, tmp_path, coupling):
    slot = free_slot(2)
    with contextlib.closing(Fleet(slot, coupling)) as fleet, copter(arducopter, slot, tmp_path / "0"):
        with copter(arducopter, slot + 1, tmp_path / "1") as second:
            fleet.wait_for(lambda: len(fleet.ticks) > 40)
            assert fleet.heard(EventKind.STALLED) == []
            os.kill(second.pid, signal.SIGSTOP)
            fleet.wait_for(lambda: fleet.heard(EventKind.STALLED) == [1])
            fleet.goes_on(2.0)
            assert fleet.ticks[-1].stalled_ua == (1,)
            os.kill(second.pid, signal.SIGCONT)
            fleet.wait_for(lambda: fleet.heard(EventKind.RETURNED) == [1])
            fleet.goes_on(2.0)
            assert fleet.ticks[-1].stalled_ua == ()
        fleet.goes_on(2.0)
        with copter(arducopter, slot + 1, tmp_path / "1"):
            fleet.wait_for(lambda: fleet.heard(EventKind.RESTARTED) == [1])
            fleet.goes_on(2.0)
    assert fleet.ticks[-1].stalled_ua == ()
    assert fleet.ticks[-1].restarts == {0: 0, 1: 1}
    steps_ns = {b.sim_time_ns - a.sim_time_ns for a, b in pairwise(fleet.ticks)}
    assert steps_ns == {50_000_000}
    pauses_s = [b - a for a, b in pairwise(fleet.tick_walls)]
    assert max(pauses_s) < STALL_S + 0.5
    assert fleet.exchange.counters(0)["boots"] == 1
    assert "restarts" not in fleet.exchange.counters(0)
