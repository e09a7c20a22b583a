"""What a frame of the flight dynamics exchange costs, as a multiple of a bare JSBSim step.

A frame is receiving, decoding, stepping, encoding and sending over real UDP sockets, and what the fleet clock does.
Bare steps of the same airframe in the same state are timed in alternated rounds; the median of the rounds' ratios is
the figure, as ratios within one run are comparable between machines.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import platform
import socket
import statistics
import time
from collections.abc import Sequence

from fdm.exchange.exchange import AircraftSpec, Exchange
from fdm.model.airframe import Airframe, load_airframe
from fdm.model.geodesy import GeodeticPosition, Home
from fdm.model.jsbsim_model import JsbsimModel
from fdm.wire.servo_packet import MAGIC_16, ServoPacket, encode_servo_packet

HOME = Home(GeodeticPosition(47.3977, 8.5456, 488.0), 90.0)
RATE_HZ = 800
LIMIT = 3.5


def pwm_of(count: int) -> tuple[int, ...]:
    """Servo outputs that differ from frame to frame, too small to lift off."""
    return tuple(1000 + (count + channel) % 20 for channel in range(16))


def frame_us(airframe: Airframe, frames: int, fleet: int) -> float:
    """Median time per frame of an exchange with `fleet` UA, us.

    The client's socket is served in the same thread and outside the timed part, so that the cost of switching
    between processes, which is the system's and not the exchange's, stays out.
    """
    exchange = Exchange(
        [AircraftSpec(index, airframe, HOME, 0) for index in range(fleet)],
        speed=math.inf,
        on_truth=lambda _: None,
        on_tick=lambda _: None,
    )
    clients = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(fleet)]
    try:
        for sock, port in zip(clients, exchange.ports.values(), strict=True):
            sock.connect(("127.0.0.1", port))
            sock.settimeout(10.0)
        return _play(exchange, clients, frames)
    finally:
        exchange.close()
        for sock in clients:
            sock.close()


def _play(exchange: Exchange, clients: Sequence[socket.socket], frames: int) -> float:
    # Made before: the client's work is not to push the exchange's out of the processor's caches.
    datagrams = [encode_servo_packet(ServoPacket(RATE_HZ, count, pwm_of(count))) for count in range(frames)]
    spent_us = []
    for datagram in datagrams:
        for sock in clients:
            sock.send(datagram)
        begin_ns = time.perf_counter_ns()
        exchange.turn()
        spent_us.append((time.perf_counter_ns() - begin_ns) / 1e3 / len(clients))
        for sock in clients:
            sock.recv(2048)
    return statistics.median(spent_us)


def bare_step_us(model: JsbsimModel, frames: int) -> float:
    """Median time per JSBSim step, with nothing else, us."""
    run = model._run
    spent_us = []
    for count in range(frames):
        model._drive(pwm_of(count))
        begin_ns = time.perf_counter_ns()
        run()
        spent_us.append((time.perf_counter_ns() - begin_ns) / 1e3)
    return statistics.median(spent_us)


def load() -> float:
    """Processes that ran or wanted to, on average over the last minute; the measure's own is one of them."""
    return round(os.getloadavg()[0], 1)


def measure(airframe_name: str, rounds: int, frames: int, fleet: int) -> dict[str, object]:
    """Alternate both, `rounds` times; medians and the median of the ratios."""
    airframe = load_airframe(airframe_name)
    model = JsbsimModel(airframe, HOME)
    model.step((MAGIC_16, RATE_HZ, 0, *pwm_of(0)), RATE_HZ)
    frame: list[float] = []
    bare: list[float] = []
    for _ in range(rounds):
        bare.append(bare_step_us(model, frames))
        frame.append(frame_us(airframe, frames, fleet))
    return {
        "airframe": airframe_name,
        "fleet": fleet,
        "rounds": rounds,
        "frames": frames,
        "frame_us": round(statistics.median(frame), 2),
        "bare_step_us": round(statistics.median(bare), 2),
        "ratio": round(statistics.median(f / b for f, b in zip(frame, bare, strict=True)), 3),
        "limit": LIMIT,
        "python": platform.python_version(),
    }


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure, print people's lines and one line of JSON."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--airframe", default="f450")
    parser.add_argument("--rounds", type=int, default=15)
    parser.add_argument("--frames", type=int, default=3000, help="per round, all UA together")
    parser.add_argument("--fleet", type=int, nargs="*", default=[1, 4, 16])
    options = parser.parse_args(arguments)
    results = [
        measure(options.airframe, options.rounds, options.frames // fleet, fleet) for fleet in options.fleet
    ]
    print(f"fdm: load average {load()} on {os.cpu_count()} cores; a busy machine spoils the figures")
    for result in results:
        print(
            f"fdm: {result['airframe']}, {result['fleet']} UA: {result['frame_us']} us per frame, "
            f"bare JSBSim step {result['bare_step_us']} us, ratio {result['ratio']} (limit {LIMIT})"
        )
    print(json.dumps({"bench": "fdm_frame", "load": load(), "results": results}))


if __name__ == "__main__":
    main()
