"""A million random and mutated datagrams at the ports of an exchange: counted, unanswered, and who flies beside them.

Two pilots in lockstep are served at `--speed`, first in peace and then while a flood comes to both their ports, in
bursts that a socket's buffer holds, so that what is lost is the exchange's fault and not the system's. The figure is
the pilots' frame rate in the flood over that in peace; it is to be 0.8 or more.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import socket
import struct
import threading
import time
from collections import Counter
from collections.abc import Sequence
from multiprocessing.connection import Connection
from multiprocessing.sharedctypes import Synchronized
from typing import Any

import numpy as np

from fdm.exchange.exchange import AircraftSpec, Exchange
from fdm.exchange.seat import DROPPED_BY_SYSTEM
from fdm.model.airframe import load_airframe
from fdm.model.geodesy import GeodeticPosition, Home
from fdm.wire.lockstep import ServoVerdict
from fdm.wire.servo_packet import DROP_REASONS, ServoPacket, encode_servo_packet, unpack_servo_packet

HOME = Home(GeodeticPosition(47.3977, 8.5456, 488.0), 0.0)
RATE_HZ = 800
BURST = 64
FLEET = 2
POOL = 4096
LIMIT = 0.8


def garbage_pool(seed: int) -> list[bytes]:
    """Datagrams that are no servo packets: random ones, and servo packets cut, lengthened or with bytes changed."""
    rng = np.random.default_rng(seed)
    pool: list[bytes] = []
    while len(pool) < POOL:
        pwm = tuple(rng.integers(0, 2200, rng.choice((16, 32))).tolist())
        datagram = bytearray(encode_servo_packet(ServoPacket(RATE_HZ, len(pool), pwm)))
        kind = rng.integers(4)
        if kind == 0:
            datagram = bytearray(rng.bytes(int(rng.integers(200))))
        elif kind == 1:
            datagram = datagram[: rng.integers(len(datagram))]
        elif kind == 2:
            datagram += rng.bytes(int(rng.integers(1, 1400)))
        else:
            struct.pack_into("<H", datagram, 2 * int(rng.integers(2)), int(rng.integers(10)))
        if isinstance(unpack_servo_packet(bytes(datagram)), str):
            pool.append(bytes(datagram))
    return pool


def fly(ports: Sequence[int], sent: Synchronized[int]) -> None:
    """Pilots in lockstep, one per port, until killed; keeps count of what they send."""
    pilots = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in ports]
    for sock, port in zip(pilots, ports, strict=True):
        sock.connect(("127.0.0.1", port))
        sock.settimeout(1.1)
    count = 0
    while True:
        datagram = encode_servo_packet(ServoPacket(RATE_HZ, count, (1000 + count % 20,) * 16))
        for sock in pilots:
            sent.value += 1
            sock.send(datagram)
        for sock in pilots:
            receive_or_repeat(sock, datagram, sent)
        count += 1


def receive_or_repeat(sock: socket.socket, datagram: bytes, sent: Synchronized[int]) -> None:
    """Wait for the answer as SITL does, which sends its packet again after 1.1 s."""
    while True:
        try:
            sock.recv(2048)
            return
        except TimeoutError:
            sent.value += 1
            sock.send(datagram)


def flood(ports: Sequence[int], total: int, pause_s: float, result: Connection) -> None:
    """Send `total` datagrams in bursts; returns how many of each reason there were, and how many answers came."""
    pool = garbage_pool(seed=17)
    reasons = [str(unpack_servo_packet(datagram)) for datagram in pool]
    sent: Counter[str] = Counter()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        for begin in range(0, total, BURST):
            for index in range(begin, min(begin + BURST, total)):
                sock.sendto(pool[index % POOL], ("127.0.0.1", ports[index % len(ports)]))
                sent[reasons[index % POOL]] += 1
            time.sleep(pause_s)
        sock.settimeout(1.0)
        try:
            sock.recv(2048)
            answers = 1
        except TimeoutError:
            answers = 0
    result.send((dict(sent), answers))


def counted(exchange: Exchange, name: str) -> int:
    """A counter, summed over the UA."""
    return sum(exchange.counters(ua_id).get(name, 0) for ua_id in range(FLEET))


def frame_rate_hz(
    exchange: Exchange, wait: threading.Event | multiprocessing.Process, limit_s: float
) -> float:
    """Frames per second of wall time, all UA together, while waiting for the end of `wait`, at most `limit_s`."""
    begin_s, begin = time.perf_counter(), counted(exchange, "frames")
    wait.wait(limit_s) if isinstance(wait, threading.Event) else wait.join(limit_s)
    return (counted(exchange, "frames") - begin) / (time.perf_counter() - begin_s)


def measure(total: int, speed: float, peace_s: float, pause_s: float) -> dict[str, Any]:
    """Fly in peace, then in the flood."""
    airframe = load_airframe("f450")
    exchange = Exchange([AircraftSpec(index, airframe, HOME, 0) for index in range(FLEET)], speed=speed)
    ports = list(exchange.ports.values())
    context = multiprocessing.get_context("spawn")
    receiver, sender = context.Pipe(duplex=False)
    by_pilots = context.Value("q", 0)
    pilots = context.Process(target=fly, args=(ports, by_pilots), daemon=True)
    storm = context.Process(target=flood, args=(ports, total, pause_s, sender), daemon=True)
    thread = threading.Thread(target=exchange.run)
    thread.start()
    never = threading.Event()
    try:
        pilots.start()
        while counted(exchange, "frames") < RATE_HZ:
            never.wait(0.05)
        peace_hz = frame_rate_hz(exchange, never, peace_s)
        begin_s = time.perf_counter()
        storm.start()
        flood_hz = frame_rate_hz(exchange, storm, 600.0)  # type: ignore[arg-type]
        flood_s = time.perf_counter() - begin_s
        sent, answers = receiver.recv()
        pilots.kill()
        pilots.join()
        never.wait(0.5)  # the last packets of the pilots are heard
    finally:
        pilots.kill()
        storm.kill()
        exchange.stop()
        thread.join()
        dropped = counted(exchange, DROPPED_BY_SYSTEM)
        exchange.close()
    got = {reason: counted(exchange, reason) for reason in DROP_REASONS}
    valid = sum(counted(exchange, verdict.value) for verdict in ServoVerdict)
    return {
        "sent": sent,
        "sent_by_pilots": by_pilots.value,
        "counted": got,
        "counted_of_pilots": valid,
        "dropped_by_system": dropped,
        "answers": answers,
        "datagrams_per_s": round(total / flood_s),
        "peace_frames_per_s": round(peace_hz),
        "flood_frames_per_s": round(flood_hz),
        "ratio": round(flood_hz / peace_hz, 3),
        "limit": LIMIT,
    }


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure, print people's lines and one line of JSON."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--datagrams", type=int, default=1_000_000)
    parser.add_argument(
        "--speed", type=float, default=1.0, help="real-time factor; inf = as fast as possible"
    )
    parser.add_argument(
        "--peace", type=float, default=5.0, help="wall time of the measure without a flood, s"
    )
    parser.add_argument("--pause", type=float, default=1e-3, help=f"between bursts of {BURST} datagrams, s")
    options = parser.parse_args(arguments)
    result = measure(options.datagrams, options.speed, options.peace, options.pause)
    all_sent = options.datagrams + result["sent_by_pilots"]
    heard = sum(result["counted"].values()) + result["counted_of_pilots"]
    missing = all_sent - heard - result["dropped_by_system"]
    print(
        f"fdm fuzz: {options.datagrams} datagrams at {result['datagrams_per_s']}/s, speed {options.speed:g}: "
        f"{missing} of them and of {result['sent_by_pilots']} valid ones not counted, "
        f"{result['dropped_by_system']} counted as dropped by the system, {result['answers']} answered; "
        f"frames per second {result['flood_frames_per_s']}, in peace {result['peace_frames_per_s']}: "
        f"ratio {result['ratio']} (wanted: {LIMIT})"
    )
    print(json.dumps({"bench": "fdm_fuzz", **result}))


if __name__ == "__main__":
    main()
