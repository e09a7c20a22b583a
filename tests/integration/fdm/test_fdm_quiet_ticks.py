"""At a tick every autopilot is blocked, and all that it said is there: peers that talk on the side, as SITL does."""

import contextlib
import math
import socket
import struct
import threading
import time
from functools import partial
from itertools import pairwise

import pytest

from fdm.air.wind import load_wind
from fdm.clock.events import EventKind
from fdm.exchange.aircraft_spec import AircraftSpec, LegacyPeer
from fdm.model.airframe import load_airframe
from fdm.model.geodesy import GeodeticPosition, Home
from fdm.model.sensor_noise import SensorNoise
from fdm.wire.servo_packet import ServoPacket, encode_servo_packet
from fdm.workers.fleet_exchange import open_exchange
from tests.unit.fdm.wire.legacy_peer import servos

HOME = Home(GeodeticPosition(47.0, 8.0, 400.0), 0.0)
MS = 1_000_000
WAIT_S = 20.0
RESEND_S = 1.1
LAST_TICK_NS = 200 * MS
long = partial(pytest.param, marks=pytest.mark.long)
couplings_and_workers = pytest.mark.parametrize(
    ("coupling", "workers"), [("serial", 1), ("parallel", 1), long("serial", 2), ("parallel", 2)]
)
"""Workers have the same exchange, each with its own part of the fleet."""


class Pilot(threading.Thread):
    """SITL's side of the wire: says something on a stream, sends its servos, and blocks until it is answered.

    Args:
        port: where it is served.
        rate_hz: its frame rate.
        legacy: the socket on which the legacy scheme's states come; None = JSON scheme.
        slow_s: how long it computes before its packets, by frame count.
        quits_at: the frame count that it does not send any more.
        loses: the frame count whose answer gets lost.
    """

    def __init__(self, port, rate_hz, *, legacy=None, slow_s=lambda count: 0.0, quits_at=None, loses=None):
        super().__init__(daemon=True)
        self.said, self._say = socket.socketpair()
        self.said.setblocking(False)
        self._servos = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._states = legacy or self._servos
        self._states.settimeout(RESEND_S)
        self._address = ("127.0.0.1", port)
        self.rate_hz, self._slow_s, self._quits_at, self._loses = rate_hz, slow_s, quits_at, loses
        self._legacy = legacy is not None
        self.answers = []
        self.quit = False

    def run(self):
        with contextlib.suppress(OSError):  # the test is over
            count = 0
            while count != self._quits_at:
                self._say.sendall(struct.pack("<I", count))
                time.sleep(self._slow_s(count))
                self._ask(count)
                count += 1

    def _ask(self, count):
        pwm = (1500 + count % 7,) * 4 + (0,) * 12
        packet = ServoPacket(self.rate_hz, count, pwm)
        while not self.quit:
            self._servos.sendto(
                servos(pwm[:11]) if self._legacy else encode_servo_packet(packet), self._address
            )
            with contextlib.suppress(TimeoutError):
                answer = self._states.recv(4096)
                if count == self._loses:
                    answer = self._states.recv(4096)
                self.answers.append(answer)
                return
        raise ConnectionAbortedError

    def heard(self):
        """The counts that it has said since the last call."""
        data = b""
        with contextlib.suppress(BlockingIOError):
            while True:
                data += self.said.recv(65536)
        return [count for (count,) in struct.iter_unpack("<I", data)]

    def close(self):
        self.quit = True
        with contextlib.suppress(OSError):  # wakes it, if it waits for an answer
            self._servos.sendto(b"", ("127.0.0.1", self._states.getsockname()[1]))
        self.join(WAIT_S)
        assert not self.is_alive()
        for sock in (self.said, self._say, self._servos, self._states):
            sock.close()


@pytest.fixture
def fly():
    """Flies pilots on an exchange up to a tick, with `at_tick(status, pilots)` in the callback, and releases there."""
    with contextlib.ExitStack() as stack:

        def fly(
            specs,
            pilots_of,
            *,
            workers=1,
            at_tick=lambda *_: None,
            last_tick_ns=LAST_TICK_NS,
            wait_s=0.0,
            **settings,
        ):
            events, truths = [], []

            def on_tick(status):
                at_tick(status, pilots)
                if status.sim_time_ns >= last_tick_ns:
                    exchange.stop()
                else:
                    exchange.release_tick(status.sim_time_ns)

            exchange = open_exchange(
                specs,
                workers=workers,
                on_tick=on_tick,
                on_truth=truths.append,
                on_event=events.append,
                **{"speed": math.inf, "hold_ticks": True, "tick_period_ns": 10 * MS, **settings},
            )
            stack.callback(exchange.close)
            pilots = pilots_of(exchange.ports)
            for pilot in pilots:
                stack.callback(pilot.close)
                pilot.start()
            time.sleep(wait_s)
            exchange.run()
            counters = [exchange.counters(ua_id) for ua_id in exchange.ports]
            return pilots, events, truths, counters

        yield fly


def specs_of(count, **more):
    airframe = load_airframe("f450")
    return [AircraftSpec(ua_id, airframe, HOME, 0, **more) for ua_id in range(count)]


def dawdle(count):
    return 0.002 if count % 3 == 0 else 0.0


@couplings_and_workers
@pytest.mark.parametrize("rates_hz", [(400,), (400, 800, 500)], ids=["one UA", "three UA"])
def test_a_tick_finds_all_that_was_said_up_to_it_and_nothing_comes_while_it_is_held(
    fly, coupling, workers, rates_hz
):
    ticks = []

    def at_tick(status, pilots):
        ticks.append(status.sim_time_ns)
        heard = [pilot.heard() for pilot in pilots]
        for pilot, counts in zip(pilots, heard, strict=True):
            frames = status.sim_time_ns * pilot.rate_hz // 10**9
            ahead = 1 if coupling == "parallel" and status.sim_time_ns else 0
            assert counts[-1] == frames + ahead
        time.sleep(0.003)
        assert [pilot.heard() for pilot in pilots] == [[]] * len(pilots)

    def pilots_of(ports):
        return [Pilot(port, rate, slow_s=dawdle) for port, rate in zip(ports.values(), rates_hz, strict=True)]

    _, events, truths, _ = fly(
        specs_of(len(rates_hz)), pilots_of, workers=workers, at_tick=at_tick, coupling=coupling
    )
    assert ticks == list(range(0, LAST_TICK_NS + 1, 10 * MS))
    assert {event.kind for event in events} == {EventKind.JOINED}
    assert [(t.sim_time_ns, t.ua_id) for t in truths] == [(t, i) for t in ticks for i in range(len(rates_hz))]


def test_a_legacy_peer_is_quiet_at_a_tick_too(fly):
    inbox = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    inbox.bind(("127.0.0.1", 0))
    last = []

    def at_tick(status, pilots):
        last[:] = pilots[0].heard()
        assert last[-1] == status.sim_time_ns * 200 // 10**9
        time.sleep(0.003)
        assert pilots[0].heard() == []

    specs = specs_of(1, legacy=LegacyPeer(inbox.getsockname()[1], 200))
    fly(
        specs,
        lambda ports: [Pilot(ports[0], 200, legacy=inbox, slow_s=dawdle)],
        at_tick=at_tick,
        coupling="parallel",
    )
    assert last == [39, 40]


@pytest.mark.parametrize("coupling", ["serial", pytest.param("parallel", marks=pytest.mark.slow)])
def test_a_tick_that_is_held_for_long_answers_no_repeat_and_stalls_nobody(fly, coupling):
    """The loop cannot read while it is in the callback: what SITL sends again lies in the socket when it goes on."""
    held_at = (0, 50 * MS)

    def at_tick(status, pilots):
        if status.sim_time_ns in held_at:
            time.sleep(1.5 * RESEND_S)

    pilots, events, _, counters = fly(
        specs_of(2),
        lambda ports: [Pilot(port, 400) for port in ports.values()],
        at_tick=at_tick,
        coupling=coupling,
        stall_timeout_s=0.15,
    )
    assert {event.kind for event in events} == {EventKind.JOINED}
    for counts, pilot in zip(counters, pilots, strict=True):
        assert "replies_sent_again" not in counts
        assert counts.keys() <= {"boots", "frames", "duplicates", "repeats_while_waiting"}
        assert counts.get("duplicates", 0) + counts.get("repeats_while_waiting", 0) >= len(held_at)
        assert all(before != after for before, after in pairwise(pilot.answers)), "an answer came twice"
        assert len(pilot.answers) in (80, 81)  # of 0.2 s, and the one at boot


@pytest.mark.parametrize(
    ("coupling", "last_packet", "workers"),
    [
        ("serial", 19, 1),
        ("parallel", 20, 1),
        ("parallel", 21, 1),
        long("serial", 19, 2),
        ("parallel", 20, 2),
        long("parallel", 21, 2),
    ],
)
def test_an_autopilot_that_hangs_just_before_a_tick_is_let_go(fly, coupling, workers, last_packet):
    """Its frame for 50 ms is answered, but the packet after that never comes."""
    ticks = []

    def pilots_of(ports):
        return [Pilot(ports[0], 400), Pilot(ports[1], 400, quits_at=last_packet + 1)]

    def at_tick(status, pilots):
        ticks.append((status.sim_time_ns, status.stalled_ua))

    _, events, truths, _ = fly(
        specs_of(2),
        pilots_of,
        workers=workers,
        at_tick=at_tick,
        coupling=coupling,
        stall_timeout_s=0.3,
        last_tick_ns=100 * MS,
    )
    assert [(e.kind, e.ua_id) for e in events if e.kind is not EventKind.JOINED] == [(EventKind.STALLED, 1)]
    let_go = 60 * MS if last_packet == 21 else 50 * MS
    assert ticks == [(t, (1,) if t >= let_go else ()) for t in range(0, 100 * MS + 1, 10 * MS)]
    assert {t.sim_time_ns for t in truths if t.ua_id == 1} == set(range(0, let_go, 10 * MS))


@pytest.mark.parametrize("stall_timeout_s", [0.3, 5.0])
def test_in_parallel_coupling_a_lost_answer_costs_one_wait_at_the_next_tick(fly, stall_timeout_s):
    """The lead is gone with it, which only the repeat of the autopilot's packet tells."""
    _, events, truths, counters = fly(
        specs_of(2),
        lambda ports: [Pilot(ports[0], 400), Pilot(ports[1], 400, loses=30)],
        at_tick=lambda status, _: time.sleep(0.2 if status.stalled_ua else 0.0),
        coupling="parallel",
        stall_timeout_s=stall_timeout_s,
    )
    told = [(e.kind, e.ua_id) for e in events if e.kind is not EventKind.JOINED]
    assert told == ([(EventKind.STALLED, 1), (EventKind.RETURNED, 1)] if stall_timeout_s < RESEND_S else [])
    assert len([t for t in truths if t.ua_id == 0]) == 21
    assert counters[1].get("repeats_while_waiting") == 1
    assert "replies_sent_again" not in counters[1]


@pytest.mark.slow
@pytest.mark.parametrize("coupling", ["serial", "parallel"])
def test_what_a_ua_gets_depends_on_no_other_and_on_no_order(fly, coupling):
    noise = SensorNoise(gyro_sigma_radps=0.01, position_sigma_m=0.5)
    wind = load_wind("breeze")
    flights = []
    for workers, slow in ((1, lambda i, c: 0.0), (1, lambda i, c: 0.001 * ((c + i) % 3)), (2, dawdle_by)):
        specs = [
            AircraftSpec(
                i,
                load_airframe(name),
                HOME,
                0,
                wind.build(seed=5, ua_id=i),
                noise.disturb(seed=5, ua_id=i),
            )
            for i, name in enumerate(("f450", "hexa550", "f450"))
        ]
        pilots, _, truths, _ = fly(
            specs,
            lambda ports, slow=slow: [
                Pilot(port, 400 + 400 * (i % 2), slow_s=lambda c, i=i: slow(i, c))
                for i, port in ports.items()
            ],
            workers=workers,
            coupling=coupling,
            last_tick_ns=100 * MS,
        )
        # Of the 40 answers to the slowest the last may still be on its way.
        flights.append(([pilot.answers[:39] for pilot in pilots], truths))
    assert flights[0] == flights[1] == flights[2]
    answers = flights[0][0]
    assert [len(each) for each in answers] == [39] * 3
    assert answers[0] != answers[2], "two UA of the same kind met the same errors"


def dawdle_by(ua_id, count):
    return 0.003 if (count + ua_id) % 5 == 0 else 0.0


@pytest.mark.parametrize("workers", [1, 2])
def test_a_start_without_somebody_is_told_before_the_first_tick(fly, workers):
    order = []

    def at_tick(status, pilots):
        order.append(status.sim_time_ns)

    _, events, _, _ = fly(
        specs_of(2),
        lambda ports: [Pilot(ports[1], 400)],
        workers=workers,
        at_tick=at_tick,
        start_timeout_s=2.0,
        last_tick_ns=20 * MS,
    )
    assert [(event.kind, event.ua_id, event.sim_time_ns) for event in events] == [
        (EventKind.JOINED, 1, 0),
        (EventKind.ABSENT, 0, 0),
    ]
    assert order == [0, 10 * MS, 20 * MS]


@pytest.mark.parametrize("workers", [1, long(2)])
def test_time_in_which_the_exchange_did_not_run_yet_makes_nobody_absent(fly, workers):
    def late(ports):
        time.sleep(1.2)  # longer than the start timeout
        return [Pilot(port, 400) for port in ports.values()]

    _, events, _, _ = fly(specs_of(2), late, workers=workers, start_timeout_s=1.0, last_tick_ns=20 * MS)
    assert_both_joined_at_0(events)


@couplings_and_workers
def test_whose_packet_is_there_when_the_start_timeout_passes_is_not_absent(fly, workers, coupling):
    _, events, _, _ = fly(
        specs_of(2),
        lambda ports: [Pilot(port, 400) for port in ports.values()],
        workers=workers,
        coupling=coupling,
        wait_s=0.3,
        start_timeout_s=1e-9,
        last_tick_ns=20 * MS,
    )
    assert_both_joined_at_0(events)


def assert_both_joined_at_0(events):
    assert len(events) == 2
    joined = {(ua_id, EventKind.JOINED, 0) for ua_id in (0, 1)}
    assert {(event.ua_id, event.kind, event.sim_time_ns) for event in events} == joined
