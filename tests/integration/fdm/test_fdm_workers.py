"""What only a fleet spread over worker processes can meet. What it shares is in test_fdm_exchange.py."""

import math
import os
import pickle
import signal
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from fdm.air.wind import load_wind
from fdm.clock.events import EventKind
from fdm.errors import AirframeError, PortInUseError, WorkerError
from fdm.exchange.exchange import AircraftSpec, Exchange
from fdm.model.air_point import AirPoint
from fdm.model.airframe import load_airframe
from fdm.model.geodesy import GeodeticPosition, Home
from fdm.wire.servo_packet import ServoPacket, encode_servo_packet
from fdm.workers.fleet_exchange import FleetExchange, open_exchange, worker_count
from fdm.workers.worker_process import end_all

HOME = Home(GeodeticPosition(47.0, 8.0, 400.0), 0.0)
WAIT_S = 20.0


def fleet(count):
    return [AircraftSpec(ua_id, load_airframe("f450"), HOME, 0) for ua_id in range(count)]


def is_gone(pid):
    """Whether process `pid` has ended, reaped or not."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] == "Z"
    except (FileNotFoundError, ProcessLookupError):
        return True


def test_a_killed_worker_ends_the_run_with_its_name():
    exchange = FleetExchange(fleet(3), workers=2)
    pids = exchange.worker_pids
    assert len(set(pids)) == 2
    killer = threading.Timer(0.0, os.kill, (pids[1], signal.SIGKILL))
    killer.start()
    try:
        with pytest.raises(WorkerError, match=r"worker 1 \(UA 1\) was ended by SIGKILL"):
            exchange.run()
    finally:
        killer.join()
        exchange.close()
    assert all(is_gone(pid) for pid in pids)


@pytest.mark.slow
def test_signals_to_the_whole_process_group_leave_the_end_to_who_started_the_workers():
    events = []
    exchange = FleetExchange(
        fleet(2), workers=2, on_event=lambda event: events.append(event) or exchange.stop()
    )
    try:
        for pid in exchange.worker_pids:
            os.kill(pid, signal.SIGINT)
            os.kill(pid, signal.SIGTERM)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
            packet = ServoPacket(400, 0, (1000,) * 16)
            sock.sendto(encode_servo_packet(packet), ("127.0.0.1", exchange.ports[1]))
            exchange.run()
    finally:
        exchange.close()
    assert [(event.kind, event.ua_id) for event in events] == [(EventKind.JOINED, 1)]
    assert exchange.counters(1) == {"boots": 1, "frames": 0}


def test_a_worker_that_nobody_answers_for_is_not_waited_for():
    ticks, first = [], threading.Event()
    exchange = FleetExchange(
        fleet(2),
        workers=2,
        speed=math.inf,
        start_timeout_s=0.5,
        on_tick=lambda status: (ticks.append(status), first.set()),
    )
    thread = threading.Thread(target=exchange.run)
    thread.start()
    try:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
            sock.settimeout(WAIT_S)
            for count in range(41):
                packet = ServoPacket(400, count, (1000,) * 16)
                sock.sendto(encode_servo_packet(packet), ("127.0.0.1", exchange.ports[1]))
                sock.recv(4096)
        assert first.wait(WAIT_S)
    finally:
        exchange.stop()
        thread.join(WAIT_S)
        exchange.close()
    assert not thread.is_alive()
    assert [tick.sim_time_ns for tick in ticks] == [0, 50_000_000, 100_000_000]
    assert {tick.stalled_ua for tick in ticks} == {(0,)}
    assert exchange.counters(1) == {"boots": 1, "frames": 40}


def test_a_model_that_cannot_be_loaded_is_named_by_the_worker(tmp_path):
    good = load_airframe("f450")
    channel = good.channels[0].model_copy(update={"property": "fcs/no-such-thing"})
    bad = good.model_copy(update={"channels": (channel, *good.channels[1:])})
    with pytest.raises(AirframeError, match="has no property fcs/no-such-thing"):
        FleetExchange([*fleet(1), AircraftSpec(1, bad, HOME, 0)], workers=2)


def test_an_error_of_a_callback_comes_out_and_leaves_nobody_behind():
    def on_tick(status):
        raise RuntimeError("not me")

    exchange = FleetExchange(fleet(2), workers=2, on_tick=on_tick, start_together=False, speed=math.inf)
    pids = exchange.worker_pids
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        for port in exchange.ports.values():
            sock.sendto(encode_servo_packet(ServoPacket(400, 0, (1000,) * 16)), ("127.0.0.1", port))
        with pytest.raises(RuntimeError, match="not me"):
            exchange.run()
    exchange.close()
    assert all(is_gone(pid) for pid in pids)


def test_mistakes_are_refused_before_a_worker_starts():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        port = taken.getsockname()[1]
        with pytest.raises(PortInUseError, match=f"UDP port {port} "):
            FleetExchange([*fleet(1), AircraftSpec(1, load_airframe("f450"), HOME, port)], workers=2)
    with pytest.raises(ValueError, match="twice"):
        FleetExchange(fleet(1) * 2, workers=2)
    with pytest.raises(ValueError, match="workers = 3: must be from 1 to 2"):
        FleetExchange(fleet(2), workers=3)
    with pytest.raises(ValueError, match="speed"):
        FleetExchange(fleet(2), workers=2, speed=0.0)
    with pytest.raises(ValueError, match="stall_timeout_s = inf: must be finite"):
        FleetExchange(fleet(2), workers=2, stall_timeout_s=math.inf)
    with pytest.raises(ValueError, match="auto or at least 1"):
        worker_count(0, 4)


def test_a_ua_that_cannot_be_sent_to_another_process_leaves_none_behind(monkeypatch):
    started = []
    popen = subprocess.Popen

    def note(*args, **kwargs):
        started.append(popen(*args, **kwargs))
        return started[-1]

    monkeypatch.setattr("fdm.workers.worker_process.subprocess.Popen", note)
    stray = AircraftSpec(1, load_airframe("f450"), HOME, 0, disturb=lambda sense: sense)
    with pytest.raises((AttributeError, pickle.PicklingError), match="local object"):
        FleetExchange([*fleet(1), stray], workers=2)
    assert len(started) == 1
    assert started[0].returncode is not None


def test_workers_that_do_not_listen_are_killed_all_at_once():
    class Deaf:
        def tell(self, message):
            assert message == ("stop",)

        def end(self, until_s):
            self.until_s = until_s

    workers = [Deaf(), Deaf(), Deaf()]
    begin_s = time.monotonic()
    assert end_all(workers, 5.0) == {}
    assert workers[0].until_s == workers[1].until_s == workers[2].until_s >= begin_s + 5.0


def test_workers_that_are_stopped_are_killed_before_somebody_kills_this_process():
    exchange = FleetExchange(fleet(2), workers=2)
    pids = exchange.worker_pids
    for pid in pids:
        os.kill(pid, signal.SIGSTOP)
    begin_s = time.monotonic()
    exchange.close()
    assert time.monotonic() - begin_s < 4.0  # bridge kills after less, but a busy machine may take its time
    assert all(is_gone(pid) for pid in pids)


def test_one_worker_is_this_process_and_there_are_never_more_than_ua():
    exchange = open_exchange(fleet(1), workers=4)
    exchange.close()
    assert isinstance(exchange, Exchange)
    assert worker_count(4, 3) == 3
    assert worker_count("auto", 1) == 1
    assert 1 <= worker_count("auto", 500) <= (os.cpu_count() or 1)


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
def test_workers_end_when_the_process_that_started_them_is_killed():
    code = (
        "from fdm.model.airframe import load_airframe\n"
        "from fdm.exchange.exchange import AircraftSpec\n"
        "from fdm.workers.fleet_exchange import FleetExchange\n"
        "from fdm.model.geodesy import GeodeticPosition, Home\n"
        "home = Home(GeodeticPosition(47.0, 8.0, 400.0), 0.0)\n"
        "exchange = FleetExchange([AircraftSpec(i, load_airframe('f450'), home, 0) for i in (0, 1)], workers=2)\n"
        "print(*exchange.worker_pids, flush=True)\n"
        "exchange.run()\n"
    )
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True) as process:
        pids = [int(word) for word in process.stdout.readline().split()]
        assert len(pids) == 2
        process.kill()
    deadline = threading.Event()
    for _ in range(200):
        if all(is_gone(pid) for pid in pids):
            break
        deadline.wait(0.05)
    assert all(is_gone(pid) for pid in pids)


@pytest.mark.parametrize("name", ["breeze", "shear"])
def test_a_wind_goes_to_another_process_as_it_is(name):
    wind = load_wind(name).build(seed=3, ua_id=2)
    sent = pickle.loads(pickle.dumps(wind))
    points = [AirPoint(k * 10_000_000, 47.3977, 8.5456, 500.0, 12.0, (5.0, 0.0, 0.0)) for k in range(50)]
    assert [sent.air_ned_mps(point) for point in points] == [wind.air_ned_mps(point) for point in points]
