"""How fast a real PX4 runs on this physics, as a share of its speed against a responder with no physics.

Both at full speed, 250 Hz, with the same number of PX4s, each on one core and on the ground, in alternated rounds; the
median of the rounds' ratios is the figure. The responder sends all of them the same frame of sensors as soon as they
have answered the one before; the exchange also waits until each PX4 is at rest. The binary is found through PX4_HOME or
PATH; without one this says so and measures nothing.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import socket
import statistics
import time
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from benchmarks.fdm.bench_fdm import load
from benchmarks.fdm.bench_fdm_ardupilot import factor_with_physics, running
from bridge.run.px4 import etc_of, find_px4
from fdm.exchange.aircraft_spec import Px4Peer, px4_port
from fdm.exchange.px4.one_core import keep_on_one_core, our_cores
from fdm.exchange.px4.peer import process_at_end
from fdm.model.airframe import load_airframe
from fdm.model.px4_sensors import Px4Sensors
from fdm.wire.px4 import hil
from fdm.wire.px4.mavlink import FrameReader, FrameWriter

LIMIT = 0.75
FIRST_INSTANCE = 150
RATE_HZ = 250
UNANSWERED_S = 0.02
"""Wall time for the frames before PX4's modules run, none of which is answered."""


def px4_command(binary: Path, instance: int) -> list[str]:
    """What starts a PX4 that looks for its simulator at TCP 4560 + `instance`, in the working directory."""
    airframe = load_airframe("f450").px4
    assert airframe is not None
    start = ["env", f"PX4_SYS_AUTOSTART={airframe.autostart}", str(binary), "-i", str(instance)]
    return [*start, "-d", str(etc_of(binary)), "-w", ".", "-s", "etc/init.d-posix/rcS"]


class Responder:
    """Answers one PX4 with sensors at rest."""

    def __init__(self, connection: socket.socket) -> None:
        self._connection = connection
        self._reader, self._writer = FrameReader(hil.FROM_PX4), FrameWriter(0, 200)
        self.frames = 0
        self._has_answered = False

    def send(self) -> None:
        """Send the next frame."""
        self.frames += 1
        sensors = hil.ACCEL | hil.GYRO | hil.MAG | hil.BARO
        time_us = self.frames * 1_000_000 // RATE_HZ
        sensor = hil.HilSensor(
            time_us, (0.0, 0.0, -9.8), (0.0, 0.0, 0.0), (0.2, 0.0, 0.4), 956.0, 0.0, 488.0, 15.0, sensors
        )
        self._connection.sendall(hil.sensor_frame(self._writer, sensor))

    def wait(self) -> None:
        """Until the frame is answered; one before PX4's modules run is not."""
        while not self._answered(self.frames * 1_000_000 // RATE_HZ):
            if not self._has_answered:
                return

    def _answered(self, time_us: int) -> bool:
        try:
            data = self._connection.recv(1 << 16)
        except TimeoutError:
            return False
        if not data:
            raise RuntimeError("PX4 has ended")
        answers = [hil.read_actuators(payload) for _, payload in self._reader.feed(data)]
        if answers and not self._has_answered:
            self._has_answered = True
            self._connection.settimeout(20.0)
        return any(answer is not None and answer.time_us >= time_us for answer in answers)


def factor_without_physics(ports: Sequence[int], warm_up_s: float, duration_s: float) -> float:
    """Real-time factor of the PX4s that come to the TCP `ports` if each frame is answered at once with rest."""
    with contextlib.ExitStack() as stack:
        servers = [stack.enter_context(socket.create_server(("127.0.0.1", port))) for port in ports]
        responders = []
        for place, server in enumerate(servers):
            server.settimeout(20.0)
            connection = stack.enter_context(server.accept()[0])
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            connection.settimeout(UNANSWERED_S)
            pid = process_at_end(connection)
            if pid is not None:
                keep_on_one_core(pid, place, our_cores())
            responders.append(Responder(connection))
        _run(responders, warm_up_s)
        begun = responders[0].frames
        spent_s = _run(responders, duration_s)
    return (responders[0].frames - begun) / RATE_HZ / spent_s


def _run(responders: Sequence[Responder], duration_s: float) -> float:
    """Answer for some wall time; returns how much it was."""
    begin_s = time.perf_counter()
    while (spent_s := time.perf_counter() - begin_s) < duration_s:
        for responder in responders:
            responder.send()
        for responder in responders:
            responder.wait()
    return spent_s


def measure_round(
    binary: Path, instances: Sequence[int], warm_up_s: float, seconds: float
) -> dict[str, float]:
    """Real-time factors of one round: of the PX4s on the responder, and of as many on the physics."""
    ports, command = [px4_port(instance) for instance in instances], partial(px4_command, binary)
    with running(command, instances):
        responder = factor_without_physics(ports, warm_up_s, seconds)
    with running(command, instances):
        exchange, _ = factor_with_physics(ports, warm_up_s, seconds, px4=Px4Peer(Px4Sensors(), seed=1))
    return {"responder": responder, "physics": exchange}


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure, print people's lines and one line of JSON."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--seconds", type=float, default=5.0, help="wall time of each measure")
    parser.add_argument("--warm-up", type=float, default=5.0, help="wall time before it: PX4 boots")
    parser.add_argument("--ua", type=int, default=1, help="PX4s")
    parser.add_argument("--instance", type=int, default=FIRST_INSTANCE, help="of the first PX4, below 250")
    options = parser.parse_args(arguments)
    binary = find_px4(os.environ)
    if binary is None:
        print("fdm with px4: skipped, as neither PX4_HOME nor PATH leads to one")
        return
    instances = range(options.instance, options.instance + options.ua)
    rounds = []
    for _ in range(options.rounds):
        rounds.append(measure_round(binary, instances, options.warm_up, options.seconds))
        factors = ", ".join(f"{what} {factor:.2f}" for what, factor in rounds[-1].items())
        print(f"round {len(rounds)}: {factors}")
    factor = statistics.median(r["physics"] for r in rounds)
    ratio = statistics.median(r["physics"] / r["responder"] for r in rounds)
    print(f"fdm with px4: load average {load()} on {os.cpu_count()} cores; wanted: {LIMIT}")
    print(f"fdm with px4: {options.ua} UA: real-time factor {factor:.2f}, ratio {ratio:.2f}")
    result = {"ua": options.ua, "limit": LIMIT, "rounds": rounds, "real_time_factor": factor, "ratio": ratio}
    print(json.dumps({"bench": "fdm_px4", "load": load(), **result}))


if __name__ == "__main__":
    main()
