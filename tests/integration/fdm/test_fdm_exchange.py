"""The exchange over real UDP sockets, with real JSBSim models and a client that is nothing but a socket."""

import contextlib
import math
import selectors
import socket
import subprocess
import sys
import textwrap
import threading
import time
from dataclasses import replace
from functools import partial
from pathlib import Path

import pytest

from fdm.air.wind import WindConfig, load_wind
from fdm.clock.events import EventKind
from fdm.errors import ModelDivergedError, PortInUseError
from fdm.exchange.exchange import AircraftSpec, Exchange, LegacyPeer
from fdm.exchange.hosted_aircraft import BOOT_S
from fdm.model.airframe import load_airframe
from fdm.model.geodesy import GeodeticPosition, Home, geodetic_from_ned
from fdm.model.jsbsim_model import JsbsimModel
from fdm.model.sensor_noise import SensorNoise
from fdm.wire.lockstep import RESEND_SILENCE_NS
from fdm.wire.sensor_frame import decode_sensor_frame
from fdm.wire.servo_packet import ServoPacket, encode_servo_packet
from fdm.workers.fleet_exchange import open_exchange
from tests.unit.fdm.wire.legacy_peer import servos, state_of

HOME = Home(GeodeticPosition(47.0, 8.0, 400.0), 0.0)
STANDING = (1000,) * 16
WAIT_S = 20.0


class Client:
    """A stand-in for SITL's side of the wire."""

    def __init__(self, port, rate_hz=400):
        self.sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.sock.settimeout(WAIT_S)
        self.address = ("127.0.0.1", port)
        self.rate_hz = rate_hz
        self.count = 0
        self.outstanding = False

    def send(self, pwm=STANDING, count=None):
        count = self.count if count is None else count
        self.sock.sendto(encode_servo_packet(ServoPacket(self.rate_hz, count, tuple(pwm))), self.address)

    def receive(self):
        frame = decode_sensor_frame(self.sock.recv(4096))
        assert frame is not None
        return frame

    def exchange(self, pwm=STANDING):
        self.send(pwm)
        frame = self.receive()
        self.count += 1
        return frame

    def silent(self, wait_s=0.05):
        self.sock.settimeout(wait_s)
        try:
            self.sock.recv(4096)
        except TimeoutError:
            return True
        finally:
            self.sock.settimeout(WAIT_S)
        return False


class Running:
    """An exchange in a thread, with what it told."""

    def __init__(self, ids=(0,), specs=None, workers=1, **settings):
        self.truths, self.ticks, self.events = [], [], []
        self.changed = threading.Condition()
        airframe = load_airframe("f450")
        specs = specs or [AircraftSpec(ua_id, airframe, HOME, 0) for ua_id in ids]
        kind = partial(open_exchange, workers=workers) if workers > 1 else Exchange
        self.exchange = kind(
            specs,
            **{"speed": math.inf, **settings},
            on_truth=self.truths.append,
            on_tick=self._note(self.ticks),
            on_event=self._note(self.events),
        )
        self.clients = {ua_id: Client(port) for ua_id, port in self.exchange.ports.items()}
        self.thread = threading.Thread(target=self.exchange.run)
        self.thread.start()

    def _note(self, where):
        def note(item):
            with self.changed:
                where.append(item)
                self.changed.notify_all()

        return note

    def wait_for(self, condition):
        with self.changed:
            assert self.changed.wait_for(condition, WAIT_S)

    def close(self):
        self.exchange.stop()
        self.thread.join(WAIT_S)
        assert not self.thread.is_alive()
        self.exchange.close()
        for client in self.clients.values():
            client.sock.close()


@pytest.fixture
def start():
    with contextlib.ExitStack() as stack:

        def start(*args, **settings):
            running = Running(*args, **settings)
            stack.callback(running.close)
            return running

        yield start


@pytest.fixture(params=[1, 2], ids=["one process", "two workers"])
def start_any(start, request):
    """Starts an exchange in this process, or one that is spread over two workers."""
    return partial(start, workers=request.param)


mostly_in_one = pytest.mark.parametrize(
    "start_any",
    [1, pytest.param(2, marks=pytest.mark.long)],
    ids=["one process", "two workers"],
    indirect=True,
)
"""For what a worker does by itself, as an exchange does."""


def fly_together(running, frames):
    """Send and receive for every client in turn: nobody is answered before the others have asked."""
    last = {}
    for _ in range(frames):
        for client in running.clients.values():
            client.send()
        for ua_id, client in running.clients.items():
            last[ua_id] = client.receive()
            client.count += 1
    return last


def test_the_page_makes_an_exchange_of_eight():
    page = (Path(__file__).parents[3] / "docs" / "reference" / "fdm.md").read_text(encoding="utf-8")
    block = page.split("In Python, for a fleet:")[1].split("## The wire")[0]
    made = (
        textwrap.dedent(block)
        .replace("9002 + 10 * i", "0")
        .replace("exchange.run()", "ports = exchange.ports")
    )
    names = {}
    exec(made, names)
    names["exchange"].close()
    assert len(set(names["ports"].values())) == 8


def test_a_ua_at_rest_feels_the_ground_from_the_first_frame_on(start):
    client = start().clients[0]
    for number in range(1, 401):
        frame = client.exchange()
        assert frame.timestamp_s == pytest.approx(number * 0.0025, abs=1e-9)
        assert frame.specific_force_frd_mps2 == pytest.approx((0, 0, -9.81), abs=0.08)
        assert frame.gyro_frd_radps == pytest.approx((0, 0, 0), abs=1e-3)
        assert frame.position_ned_m == pytest.approx((0, 0, -0.15), abs=0.01)


def test_it_takes_off_when_the_motors_say_so(start):
    running = start()
    client = running.clients[0]
    for _ in range(400):
        frame = client.exchange((1600,) * 4 + (0,) * 12)
    assert frame.position_ned_m[2] < -2.0
    client.send()
    running.wait_for(lambda: len(running.ticks) == 21)
    assert running.truths[-1].sim_time_ns == running.ticks[-1].sim_time_ns == 10**9
    assert running.truths[-1].position_ned_m == pytest.approx(frame.position_ned_m, abs=1e-4)


def test_two_ua_go_in_lockstep(start_any):
    running = start_any(ids=(4, 7))
    first, second = running.clients[4], running.clients[7]
    first.send()
    assert first.silent()
    second.send()
    assert first.receive().timestamp_s == second.receive().timestamp_s
    first.count = second.count = 1
    first.exchange()
    first.send()
    assert first.silent()  # one frame ahead: it waits for the other
    second.exchange()
    first.receive()


def test_truth_of_every_ua_comes_before_the_tick_and_at_its_instant(start_any):
    running = start_any(ids=(0, 1, 2), tick_period_ns=25_000_000)
    fly_together(running, 101)
    running.wait_for(lambda: len(running.ticks) == 11)
    assert [tick.sim_time_ns for tick in running.ticks] == [k * 25_000_000 for k in range(11)]
    assert [(t.sim_time_ns, t.ua_id) for t in running.truths] == [
        (k * 25_000_000, ua_id) for k in range(11) for ua_id in (0, 1, 2)
    ]


def watch_the_window(exchange):
    """How far apart the fleet's sim times are after every step; grows with the run."""
    apart_ns = []
    clock = exchange._clock
    stepped = clock.stepped

    def watched(member):
        stepped(member)
        times = [other.sim_time_ns for other in clock.members.values()]
        apart_ns.append(max(times) - min(times))

    clock.stepped = watched
    return apart_ns


@pytest.mark.parametrize(
    ("speed", "workers"),
    [(math.inf, 1), (1.0, 1), pytest.param(math.inf, 2, marks=pytest.mark.long), (1.0, 2)],
)
def test_eight_ua_of_mixed_types_and_rates_stay_within_the_window(start, workers, speed):
    names, rates = ("f450", "hexa550", "aerosonde", "f450"), (400, 800, 1200, 400, 50, 300, 800, 400)
    specs = [AircraftSpec(i, load_airframe(names[i % 4]), HOME, 0) for i in range(8)]
    running = start(specs=specs, workers=workers, speed=speed, tick_period_ns=20_000_000)
    apart_ns = watch_the_window(running.exchange) if workers == 1 else []

    def fly(client, rate_hz):
        client.rate_hz = rate_hz
        for _ in range(rate_hz // 2):
            client.exchange()
        client.send()

    threads = [
        threading.Thread(target=fly, args=(client, rate))
        for client, rate in zip(running.clients.values(), rates, strict=True)
    ]
    begin_ns = time.monotonic_ns()
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(WAIT_S)
        assert not thread.is_alive()
    assert max(apart_ns, default=0) <= 20_000_000  # one frame at the slowest rate, 50 Hz
    running.wait_for(lambda: running.ticks[-1].sim_time_ns == 500_000_000)
    for tick in running.ticks:
        truths = [t for t in running.truths if 0 <= t.sim_time_ns - tick.sim_time_ns < 20_000_000]
        assert {t.ua_id for t in truths} == set(range(8))
    if speed == 1.0:
        assert (time.monotonic_ns() - begin_ns) / 1e9 >= 0.45


def test_held_ticks_wait_for_their_release(start):
    running = start(hold_ticks=True, tick_period_ns=5_000_000)
    client = running.clients[0]
    client.send()
    running.wait_for(lambda: running.ticks)
    assert client.silent()
    running.exchange.release_tick(0)
    client.receive()
    client.count = 1
    client.exchange()
    client.send()
    assert client.silent()
    running.exchange.release_tick(5_000_000)
    client.receive()
    assert [tick.sim_time_ns for tick in running.ticks] == [0, 5_000_000]


def test_a_release_from_within_on_tick_is_enough(start):
    running = start(hold_ticks=True, tick_period_ns=2_500_000)
    exchange = running.exchange
    note = exchange._on_tick
    exchange._on_tick = lambda s: (note(s), exchange.release_tick(s.sim_time_ns))
    for _ in range(20):
        running.clients[0].exchange()
    assert len(running.ticks) >= 20


def test_in_parallel_coupling_sensor_errors_and_wind_are_those_of_serial_coupling(start):
    disturb = SensorNoise(gyro_sigma_radps=0.01, position_sigma_m=0.5).disturb(seed=3, ua_id=0)
    frames = {}
    for coupling in ("serial", "parallel"):
        spec = AircraftSpec(
            0, load_airframe("f450"), HOME, 0, load_wind("breeze").build(seed=3, ua_id=0), disturb
        )
        client = start(specs=[spec], coupling=coupling).clients[0]
        frames[coupling] = [client.exchange() for _ in range(30)]
    assert frames["parallel"][1:] == frames["serial"][:-1]


def test_a_model_that_diverges_at_boot_ends_its_ua_once_and_is_not_stepped(start):
    class Broken(JsbsimModel):
        steps = 0

        def __init__(self, airframe, home):
            super().__init__(airframe, home)
            exact = self.sense
            self.sense = lambda: (math.nan, *exact()[1:])

        def step(self, fields, rate_hz):
            Broken.steps += 1
            super().step(fields, rate_hz)

    running = start(ids=(0, 1), coupling="parallel", build_model=Broken)
    for client in running.clients.values():
        client.send()
    running.wait_for(lambda: len(running.events) >= 4)
    assert all(client.silent() for client in running.clients.values())
    kinds = [event.kind for event in running.events]
    assert kinds == [EventKind.JOINED, EventKind.JOINED, EventKind.DIVERGED, EventKind.DIVERGED]
    assert Broken.steps == 0


@pytest.mark.parametrize("coupling", ["serial", "parallel"])
def test_the_example_client_takes_off(start, coupling):
    port = start(coupling=coupling).exchange.ports[0]
    client = Path(__file__).parents[3] / "examples" / "flight_dynamics" / "json_client.py"
    done = subprocess.run(
        [sys.executable, client, f"--port={port}"], capture_output=True, text=True, timeout=WAIT_S
    )
    assert done.returncode == 0, done.stderr
    heights = [float(line.split()[2]) for line in done.stdout.splitlines()]
    assert len(heights) == 2
    assert 2.0 < heights[0] < heights[1]


def rising(count):
    """Servo outputs that take a copter off: each differs from the ones before."""
    return (1500 + 5 * count,) * 4 + (0,) * 12


@mostly_in_one
def test_in_parallel_coupling_the_autopilot_gets_the_state_at_boot_and_then_what_it_gets_serially(start_any):
    frames = {}
    for coupling in ("serial", "parallel"):
        client = start_any(ids=(0, 1), coupling=coupling).clients
        frames[coupling] = []
        for count in range(60):
            for pilot in client.values():
                pilot.send(rising(count), count)
            frames[coupling].append([pilot.receive() for pilot in client.values()])
    at_boot, *flown = frames["parallel"]
    assert [frame.timestamp_s for frame in at_boot] == [BOOT_S, BOOT_S]
    assert flown == frames["serial"][:-1]
    assert flown[-1][0].position_ned_m[2] < -0.16, "it did not take off, so that this shows nothing"


def test_in_parallel_coupling_a_tick_waits_for_the_packet_that_follows_the_last_answer(start_any):
    running = start_any(ids=(0, 1), coupling="parallel", hold_ticks=True, tick_period_ns=5_000_000)
    both = running.clients.values()

    def tick_times():
        return [tick.sim_time_ns for tick in running.ticks]

    for client in both:
        client.send(count=0)
    running.wait_for(lambda: tick_times() == [0])
    assert all(client.silent() for client in both), "an answer before the first tick was released"
    running.exchange.release_tick(0)
    for client in both:
        assert [client.receive().timestamp_s for _ in range(2)] == [BOOT_S, 0.0025]
        client.send(count=1)
        client.send(count=2)  # asks for the frame after 5 ms, and has not read the answer for 5 ms
    for client in both:
        assert client.receive().timestamp_s == 0.005
        assert client.silent(0.2)
    assert tick_times() == [0]
    for client in both:
        client.send(count=3)
        client.send(count=3)
    running.wait_for(lambda: tick_times() == [0, 5_000_000])
    assert all(client.silent() for client in both)
    running.exchange.release_tick(5_000_000)
    for client in both:
        assert [client.receive().timestamp_s for _ in range(2)] == [0.0075, 0.01]
        assert client.silent()
    running.close()
    assert running.exchange.counters(0) == {"boots": 1, "frames": 3, "repeats_while_waiting": 1}


def test_in_parallel_coupling_a_peer_that_does_not_wait_for_answers_loses_the_oldest(start):
    running = start(coupling="parallel", hold_ticks=True)
    client = running.clients[0]
    for count in range(4):
        client.send(rising(count), count)
    deadline = time.monotonic() + WAIT_S
    while running.exchange.counters(0).get("overruns") != 2:
        assert time.monotonic() < deadline
    assert client.silent()
    running.exchange.release_tick(0)
    assert [client.receive().timestamp_s for _ in range(3)] == [BOOT_S, 0.0025, 0.005]
    assert client.silent()
    assert running.exchange.counters(0) == {"boots": 1, "frames": 3, "overruns": 2}


def test_in_parallel_coupling_a_lost_answer_takes_the_lead_with_it(start):
    client = start(coupling="parallel").clients[0]
    before = [client.exchange().timestamp_s for _ in range(4)]
    client.receive()  # as if it were lost: the autopilot does not see it
    after = [client.exchange().timestamp_s for _ in range(4)]
    assert before + after == pytest.approx([BOOT_S, *(0.0025 * k for k in (1, 2, 3, 5, 6, 7, 8))])
    assert client.silent()


@mostly_in_one
def test_in_parallel_coupling_an_autopilot_that_boots_anew_starts_in_the_same_way(start_any):
    running = start_any(coupling="parallel")
    old = running.clients[0]
    first = [old.exchange() for _ in range(30)]
    running.clients[0] = Client(running.exchange.ports[0])
    assert [running.clients[0].exchange() for _ in range(30)] == first
    old.sock.close()


@mostly_in_one
@pytest.mark.slow
def test_in_parallel_coupling_a_mute_autopilot_is_let_go_and_flies_on_one_frame_behind(start_any):
    running = start_any(ids=(0, 1), coupling="parallel", stall_timeout_s=0.2)
    fly_together(running, 10)
    for _ in range(100):
        running.clients[0].exchange()
    running.wait_for(lambda: EventKind.STALLED in [event.kind for event in running.events])
    assert fly_together(running, 1)[1].timestamp_s == pytest.approx(10 / 400)
    running.wait_for(lambda: EventKind.RETURNED in [event.kind for event in running.events])
    assert fly_together(running, 60)[1].timestamp_s == pytest.approx(70 / 400)


def test_a_frame_count_is_answered_once_and_again_only_after_silence(start, monkeypatch):
    running = start()
    client = running.clients[0]
    frame = client.exchange()
    client.send(count=0)
    client.send(count=0)
    assert client.silent()
    # Age the reply instead of waiting for a second.
    lockstep = next(iter(running.exchange._seats.values())).aircraft.lockstep
    lockstep._answered_at_ns -= RESEND_SILENCE_NS
    client.send(count=0)
    assert client.receive() == frame
    client.send(count=0)
    assert client.silent()
    assert client.exchange().timestamp_s == pytest.approx(0.005)
    counters = running.exchange.counters(0)
    assert (counters["duplicates"], counters["replies_sent_again"]) == (3, 1)


def test_garbage_gets_no_reply_and_is_counted_by_reason(start):
    running = start()
    client = running.clients[0]
    client.exchange()
    good = encode_servo_packet(ServoPacket(400, 1, STANDING))
    for bad in (b"", b"x" * 5000, good[:-1], b"\0" + good[1:], good[:2] + b"\0\0" + good[4:]):
        client.sock.sendto(bad, client.address)
    assert client.silent()
    client.exchange()
    counters = running.exchange.counters(0)
    assert {k: v for k, v in counters.items() if k.startswith("bad")} == {
        "bad_length": 3,
        "bad_magic": 1,
        "bad_frame_rate": 1,
    }


def test_a_change_to_thirty_two_channels_is_followed(start):
    client = start().clients[0]
    for channels in (16, 32, 16):
        for _ in range(10):
            assert math.isfinite(client.exchange((1000,) * channels).timestamp_s)


def test_an_autopilot_that_boots_anew_starts_from_zero_at_home(start_any):
    running = start_any(ids=(0, 1))
    fly_together(running, 50)
    for _ in range(100):
        for client in running.clients.values():
            client.send((1700,) * 4 + (0,) * 12)
        for client in running.clients.values():
            airborne = client.receive()
            client.count += 1
    assert airborne.position_ned_m[2] < -0.3
    old, running.clients[1] = running.clients[1], Client(running.exchange.ports[1])
    old.sock.close()
    running.clients[1].send()
    running.clients[0].send()
    assert running.clients[0].receive().timestamp_s == pytest.approx(151 / 400)
    running.clients[0].count += 1
    # The new one joins at the next tick (0.4 s): UA 0 gets there first.
    for _ in range(9):
        running.clients[0].exchange()
    running.clients[0].send()
    frame = running.clients[1].receive()
    assert frame.timestamp_s == pytest.approx(1 / 400)
    assert frame.position_ned_m[2] == pytest.approx(-0.15, abs=0.01)
    running.clients[0].receive()
    running.clients[0].count += 1
    running.clients[1].count += 1
    last = fly_together(running, 40)
    assert last[1].timestamp_s == pytest.approx(41 / 400)
    running.wait_for(lambda: running.ticks[-1].sim_time_ns >= 500_000_000)
    assert running.ticks[-1].restarts == {0: 0, 1: 1}
    assert EventKind.RESTARTED in [event.kind for event in running.events]
    restarted = [t for t in running.truths if t.ua_id == 1 and t.sim_time_ns >= 450_000_000]
    assert {t.sim_time_ns for t in restarted} == {450_000_000, 500_000_000}


def test_of_two_autopilots_at_one_port_the_later_one_flies_and_it_is_told(start_any):
    running = start_any(ids=(0,))
    first = running.clients[0]
    for _ in range(50):
        first.exchange()
    second = running.clients[1] = Client(running.exchange.ports[0])  # closed with the others
    for number in range(1, 21):
        assert second.exchange().timestamp_s == pytest.approx(number / 400)
        first.send()
    assert first.silent()
    running.wait_for(lambda: running.events[-1].kind is EventKind.REPLACED)
    kinds = [event.kind for event in running.events]
    assert kinds == [EventKind.JOINED, EventKind.RESTARTED, EventKind.REPLACED]


def test_a_mute_autopilot_is_let_go_and_taken_back(start_any):
    running = start_any(ids=(0, 1), stall_timeout_s=1.0)
    fly_together(running, 10)
    for _ in range(30):
        running.clients[0].exchange()
    assert [(e.kind, e.ua_id) for e in running.events if e.kind is EventKind.STALLED] == [
        (EventKind.STALLED, 1)
    ]
    running.wait_for(lambda: running.ticks[-1].stalled_ua == (1,))
    running.clients[1].send()
    running.wait_for(lambda: running.events[-1].kind is EventKind.RETURNED)
    for _ in range(20):
        running.clients[0].exchange()
        if running.clients[0].count * 2_500_000 > running.events[-1].sim_time_ns:
            break
    assert running.clients[1].receive().timestamp_s == pytest.approx(11 / 400)
    running.clients[1].count += 1
    fly_together(running, 40)
    assert 1 not in running.ticks[-1].stalled_ua


def test_a_diverged_model_ends_its_ua_and_no_other(start):
    class Fragile(JsbsimModel):
        steps = 0

        def step(self, fields, rate_hz):
            super().step(fields, rate_hz)
            self.steps += 1
            if self.steps == 5 and fields[3] == 1999:
                raise ModelDivergedError("it broke")

    running = start(ids=(0, 1), build_model=Fragile)
    weak, strong = running.clients[0], running.clients[1]
    for _ in range(4):
        weak.send((1999,) * 16)
        strong.send()
        last = weak.receive()
        strong.receive()
        weak.count += 1
        strong.count += 1
    weak.send((1999,) * 16)
    for _ in range(30):
        strong.exchange()
    assert weak.silent()
    event = running.events[-1]
    assert (event.kind, event.ua_id, event.last_frame) == (EventKind.DIVERGED, 0, last)
    running.wait_for(lambda: running.ticks[-1].ended_ua == (0,))
    reborn = Client(running.exchange.ports[0])
    reborn.send()
    for _ in range(30):
        strong.exchange()
        if strong.count * 2_500_000 >= 100_000_000:
            break
    reborn.send((1000,) * 16)
    strong.send()
    assert reborn.receive().timestamp_s == pytest.approx(1 / 400)
    reborn.sock.close()


def test_two_ua_300_m_apart_in_a_sheared_map_feel_different_winds_and_drift_apart(start):
    airframe, config = load_airframe("f450"), load_wind("shear")
    origin = GeodeticPosition(47.3977, 8.5456, 488.0)
    homes = [Home(geodetic_from_ned(origin, (north, 500.0, 0.0)), 0.0) for north in (-150.0, 150.0)]
    running = start(
        specs=[
            AircraftSpec(ua_id, airframe, home, 0, config.build(seed=1, ua_id=ua_id))
            for ua_id, home in enumerate(homes)
        ]
    )
    for _ in range(800):
        for client in running.clients.values():
            client.send((1600,) * 4 + (0,) * 12)
        for client in running.clients.values():
            client.receive()
            client.count += 1
    for client in running.clients.values():
        client.send()
    running.wait_for(lambda: running.ticks[-1].sim_time_ns == 2 * 10**9)
    south, north = (truth for truth in running.truths[-2:])
    # At y = -150 m the map's wind is 7.5 % below, at +150 m 7.5 % above that of its middle.
    assert south.wind_ned_mps[1] > 3.0
    assert north.wind_ned_mps[1] / south.wind_ned_mps[1] == pytest.approx(1.075 / 0.925, rel=0.02)
    assert north.velocity_ned_mps[1] > south.velocity_ned_mps[1] + 0.01


def test_a_ua_that_leaves_a_strict_map_ends_with_the_reason(start_any):
    path = load_wind("shear").map.file
    config = WindConfig.model_validate({"map": {"file": str(path), "outside": "error"}})
    wind = config.build(seed=1, ua_id=0)
    spec = AircraftSpec(0, load_airframe("f450"), HOME, 0)
    running = start_any(specs=[replace(spec, wind=wind), replace(spec, ua_id=1)])
    for client in running.clients.values():
        client.send()
    running.wait_for(lambda: running.events[-1:] and running.events[-1].kind is EventKind.DIVERGED)
    assert "outside the map" in running.events[-1].detail
    running.clients[1].receive()
    running.clients[1].count += 1
    for _ in range(30):
        running.clients[1].exchange()
    assert running.ticks[-1].ended_ua == (0,)


def test_a_legacy_peer_gets_its_state_on_its_own_port(start):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as inbox:
        inbox.bind(("127.0.0.1", 0))
        inbox.settimeout(WAIT_S)
        legacy = LegacyPeer(state_port=inbox.getsockname()[1], rate_hz=200)
        running = start(specs=[AircraftSpec(0, load_airframe("f450"), HOME, 0, legacy=legacy)])
        sender = running.clients[0]
        for number in range(1, 201):
            sender.sock.sendto(servos((1600,) * 4 + (0,) * 7), sender.address)
            state = state_of(inbox.recv(1024))
            assert state.time_us == number * 5000
        assert state.alt_amsl_m > 402.0
        assert running.exchange.counters(0) == {"boots": 1, "frames": 199}


def test_sensor_errors_reach_the_autopilot_but_not_the_truth(start):
    noise = SensorNoise(accel_bias_frd_mps2=(0.0, 1.0, 0.0))
    spec = AircraftSpec(0, load_airframe("f450"), HOME, 0, disturb=noise.disturb(seed=1, ua_id=0))
    running = start(specs=[spec])
    frame = running.clients[0].exchange()
    assert frame.specific_force_frd_mps2[1] == pytest.approx(1.0, abs=0.01)
    assert running.truths[0].specific_force_frd_mps2[1] == pytest.approx(0.0, abs=0.01)


def test_no_number_that_is_not_finite_is_ever_sent(start):
    running = start()
    client = running.clients[0]
    client.exchange()
    seat = next(iter(running.exchange._seats.values()))
    measure = seat.aircraft._measure
    seat.aircraft._measure = lambda: (math.nan, *measure()[1:])
    client.send()
    running.wait_for(lambda: running.events[-1].kind is EventKind.DIVERGED)
    assert client.silent()


def test_real_time_is_kept(start):
    running = start(speed=2.0)
    begin_ns = time.monotonic_ns()
    for _ in range(400):
        running.clients[0].exchange()
    assert (time.monotonic_ns() - begin_ns) / 1e9 >= 0.49


def fly_until_held(running, wait_s=0.2):
    """Let every client fly on until it is not answered any more; gives how many answers each got."""
    answers = dict.fromkeys(running.clients, 0)
    for client in running.clients.values():
        if not client.outstanding:
            client.send()
            client.outstanding = True
    while True:
        heard = [(ua_id, client) for ua_id, client in running.clients.items() if not client.silent(wait_s)]
        if not heard:
            return answers
        for ua_id, client in heard:
            answers[ua_id] += 1
            client.count += 1
            client.send()


def fly_apart(running, frames):
    """Let every client, outstanding, fly on at its own pace as autopilots do, until each got `frames` answers.

    One that is a frame ahead waits at a tick for the other, which may not wait for it in turn.
    """
    answers = dict.fromkeys(running.clients, 0)
    with selectors.DefaultSelector() as selector:
        for ua_id, client in running.clients.items():
            selector.register(client.sock, selectors.EVENT_READ, ua_id)
        while min(answers.values()) < frames:
            ready = selector.select(WAIT_S)
            assert ready
            for key, _ in ready:
                client = running.clients[key.data]
                client.receive()
                client.count += 1
                client.send()
                answers[key.data] += 1


def test_a_lone_ua_is_not_answered_once_paused(start):
    running = start()
    client = running.clients[0]
    for _ in range(5):
        client.exchange()
        running.exchange.pause()
        client.send()
        assert client.silent()
        running.exchange.resume()
        client.receive()
        client.count += 1


def test_who_answers_all_the_time_does_not_stall_between_far_ticks(start):
    running = start(stall_timeout_s=0.1, tick_period_ns=3600 * 10**9)
    until = time.monotonic() + 0.5
    while time.monotonic() < until:
        running.clients[0].exchange()
    assert running.clients[0].silent(0.05)
    running.clients[0].exchange()
    assert [event.kind for event in running.events] == [EventKind.JOINED]


def test_pause_step_and_resume_from_another_thread(start_any):
    running = start_any(ids=(0, 1))
    fly_together(running, 10)
    running.exchange.pause()
    fly_until_held(running)
    running.exchange.step(25_000_000)
    answers = fly_until_held(running)
    # Workers hear of a pause one after the other: they stop within a frame of each other.
    slack = 0 if isinstance(running.exchange, Exchange) else 1
    assert all(abs(count - 10) <= slack for count in answers.values())
    running.exchange.set_speed(0.5)
    running.exchange.resume()
    begin_ns = time.monotonic_ns()
    fly_apart(running, 80)
    elapsed_s = (time.monotonic_ns() - begin_ns) / 1e9
    assert elapsed_s >= 0.3  # 0.2 s of sim time; the first frames may come before
    assert [event.kind for event in running.events] == [EventKind.JOINED] * 2


@mostly_in_one
def test_held_ticks_of_several_ua_wait_for_their_release(start_any):
    running = start_any(ids=(0, 1), hold_ticks=True, tick_period_ns=5_000_000)
    for client in running.clients.values():
        client.send()
    running.wait_for(lambda: running.ticks)
    assert running.clients[1].silent()
    running.exchange.release_tick(5_000_000)
    for client in running.clients.values():
        client.receive()
        client.count += 1
    fly_together(running, 3)
    for client in running.clients.values():
        client.send()
    assert running.clients[0].silent()
    assert [tick.sim_time_ns for tick in running.ticks] == [0, 5_000_000, 10_000_000]


def test_a_port_in_use_is_named():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        port = taken.getsockname()[1]
        spec = AircraftSpec(0, load_airframe("f450"), HOME, port)
        with pytest.raises(PortInUseError, match=f"UDP port {port} .*in use") as caught:
            Exchange([spec, replace(spec, ua_id=1)])
        assert caught.value.port == port


@pytest.mark.parametrize("workers", [1, 2])
def test_a_command_that_comes_after_the_end_has_no_effect(workers):
    specs = [AircraftSpec(ua_id, load_airframe("f450"), HOME, 0) for ua_id in (0, 1)]
    exchange = open_exchange(specs, workers=workers)
    exchange.close()
    exchange.release_tick(0)  # from another thread, after an error has ended run
    exchange.stop()
    exchange.close()


def test_mistakes_of_the_caller_are_refused():
    spec = AircraftSpec(0, load_airframe("f450"), HOME, 0)
    with pytest.raises(ValueError, match="twice"):
        Exchange([spec, spec])
    with pytest.raises(ValueError, match="at least one"):
        Exchange([])
    with pytest.raises(ValueError, match="speed"):
        Exchange([spec], speed=0.0)
    with pytest.raises(ValueError, match="coupling = 'both': must be one of serial, parallel"):
        Exchange([spec], coupling="both")
    with pytest.raises(ValueError, match="coupling = 'both': must be one of serial, parallel"):
        open_exchange([spec, replace(spec, ua_id=1)], workers=2, coupling="both")
    with pytest.raises(ValueError, match="start_timeout_s = nan: must be finite"):
        Exchange([spec], start_timeout_s=math.nan)


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux tells what a socket dropped")
def test_what_the_system_drops_from_a_full_buffer_is_counted_too():
    exchange = Exchange([AircraftSpec(0, load_airframe("f450"), HOME, 0)])
    seat = next(iter(exchange._seats.values()))
    seat.sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 50_000)
    try:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
            for _ in range(2000):
                sock.sendto(b"garbage", ("127.0.0.1", exchange.ports[0]))
        while exchange.counters(0).get("bad_length", 0) + exchange.counters(0)["dropped_by_system"] < 2000:
            exchange.turn()
        assert exchange.counters(0).keys() == {"frames", "bad_length", "dropped_by_system"}
    finally:
        exchange.close()
