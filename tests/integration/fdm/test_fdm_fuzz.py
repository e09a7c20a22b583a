"""Garbage at the ports: no crash, no reply, all of it counted, and the others fly on."""

import contextlib
import math
import socket
import struct
import threading

import numpy as np
import pytest

from fdm.exchange.exchange import AircraftSpec, Exchange
from fdm.model.airframe import load_airframe
from fdm.model.geodesy import GeodeticPosition, Home
from fdm.wire.lockstep import STEPPING, ServoVerdict
from fdm.wire.servo_packet import DROP_REASONS, ServoPacket, encode_servo_packet, unpack_servo_packet

HOME = Home(GeodeticPosition(47.0, 8.0, 400.0), 0.0)
BATCH = 50
"""Datagrams that a socket's buffer holds for certain."""


@pytest.fixture
def exchange():
    airframe = load_airframe("f450")
    specs = [AircraftSpec(i, airframe, HOME, 0) for i in range(2)]
    exchange = Exchange(specs, speed=math.inf, stall_timeout_s=0.1)
    thread = threading.Thread(target=exchange.run)
    thread.start()
    yield exchange
    exchange.stop()
    thread.join(20.0)
    assert not thread.is_alive()
    exchange.close()


def mutant(rng, count):
    """A servo packet with something broken: a random datagram, a cut or longer one, a wrong magic or rate."""
    good = bytearray(encode_servo_packet(ServoPacket(400, count, tuple(rng.integers(0, 2200, 16).tolist()))))
    kind = rng.integers(4)
    if kind == 0:
        return rng.bytes(rng.integers(200))
    if kind == 1:
        return bytes(good[: rng.integers(40)])
    if kind == 2:
        return bytes(good) + rng.bytes(rng.integers(1, 1400))
    struct.pack_into("<H", good, 2 * int(rng.integers(2)), int(rng.integers(10)))
    return bytes(good)


def test_garbage_is_counted_by_reason_and_never_answered(exchange):
    rng = np.random.default_rng(17)
    pilots = []
    for port in exchange.ports.values():
        pilot = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        pilot.connect(("127.0.0.1", port))
        pilot.settimeout(20.0)
        pilots.append(pilot)
    stranger = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    stranger.settimeout(0.05)
    expected = dict.fromkeys(DROP_REASONS, 0)
    for count in range(60):
        for _ in range(BATCH):
            garbage = mutant(rng, count)
            expected[unpack_servo_packet(garbage)] += 1
            stranger.sendto(garbage, ("127.0.0.1", exchange.ports[0]))
        for pilot in pilots:
            pilot.send(encode_servo_packet(ServoPacket(400, count, (1000,) * 16)))
        for pilot in pilots:
            assert pilot.recv(2048).startswith(b'\n{"timestamp"')
    counters = exchange.counters(0)
    assert {reason: counters[reason] for reason in DROP_REASONS} == expected
    assert sum(expected.values()) == 60 * BATCH
    assert min(expected.values()) > 0
    assert counters["frames"] == exchange.counters(1)["frames"] == 59
    with pytest.raises(TimeoutError):
        stranger.recv(2048)
    for sock in (*pilots, stranger):
        sock.close()


def test_valid_packets_of_any_content_do_not_stop_it(exchange):
    """A stranger that was there first is passed over while the one that came later flies, and harms no neighbour."""
    rng = np.random.default_rng(18)
    with contextlib.ExitStack() as stack:
        stranger, pilot, other = (
            stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) for _ in range(3)
        )
        for sock, ua_id in ((stranger, 0), (pilot, 0), (other, 1)):
            sock.connect(("127.0.0.1", exchange.ports[ua_id]))
            sock.settimeout(20.0)
        for count in range(6):
            for _ in range(BATCH):
                pwm = tuple(rng.integers(0, 65536, rng.choice((16, 32))).tolist())
                rate_hz, any_count = rng.integers(10, (65536, 2**32)).tolist()
                stranger.send(encode_servo_packet(ServoPacket(rate_hz, any_count, pwm)))
            for flies in (pilot, other):
                flies.send(encode_servo_packet(ServoPacket(400, count, (1000,) * 16)))
            for flies in (pilot, other):
                assert flies.recv(2048).startswith(b'\n{"timestamp":%.9f,' % (0.0025 * (count + 1)))
    received = exchange.counters(0)
    assert sum(received[verdict.value] for verdict in STEPPING) == BATCH + 6
    assert received[ServoVerdict.REPLACED.value] == 5 * BATCH
