"""How fast a real arducopter flies on this physics, as a share of its speed against a responder with no physics.

All run at full speed, 800 Hz, in alternated rounds; the median of the rounds' ratios is the figure, for both couplings.
How fast the responder with no physics is depends on where the system puts the two processes: it is measured as the
system likes and with both on one core, and the faster one counts. The binary is found through ARDUPILOT_HOME or PATH;
without one this says so and measures nothing.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import math
import os
import socket
import statistics
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import get_args

import psutil

from benchmarks.fdm.bench_fdm import load
from bridge.fleet.autopilots.ardupilot import ArduPilot
from bridge.fleet.autopilots.launcher import AutopilotError
from fdm.clock.fleet_clock import ClockStatus
from fdm.exchange.aircraft_spec import Px4Peer
from fdm.exchange.exchange import AircraftSpec, Exchange, default_port
from fdm.exchange.settings import Coupling, Placement
from fdm.model.airframe import load_airframe
from fdm.model.geodesy import GeodeticPosition, Home
from fdm.wire.servo_packet import unpack_servo_packet
from fdm.workers.fleet_exchange import FleetExchange, open_exchange

HOME = Home(GeodeticPosition(47.3977, 8.5456, 488.0), 0.0)
ROOT = Path(__file__).parents[2]
PARAMETERS = ROOT / "sitl_configs" / "params" / "copter.parm"
LIMIT = 0.75
FIRST_INSTANCE = 150
AT_REST = (
    b'\n{"timestamp":%.9f,"imu":{"gyro":[0.0, 0.0, 0.0],"accel_body":[0.0, 0.0, -9.8]},'
    b'"position":[0.0, 0.0, 0.0],"attitude":[0.0, 0.0, 0.0],"velocity":[0.0, 0.0, 0.0],'
    b'"airspeed":0.0,"no_time_sync":1}\n'
)


def find_arducopter() -> Path | None:
    """A real arducopter, or None."""
    try:
        return ArduPilot(os.environ).binary("arducopter")
    except AutopilotError:
        return None


@contextlib.contextmanager
def running(command: Callable[[int], Sequence[str]], instances: Sequence[int]) -> Iterator[None]:
    """Run one process per instance, each in a directory of its own; killed at the end, as SITL ignores SIGTERM.

    All are killed before one is waited for: a PX4 whose simulator has gone spins as a real-time thread, and no other on
    its core gets to its own end.
    """
    with (
        tempfile.TemporaryDirectory(prefix="bench-fdm-") as root,
        contextlib.ExitStack() as waits,
        contextlib.ExitStack() as kills,
    ):
        for instance in instances:
            directory = Path(root) / str(instance)
            directory.mkdir()
            process = subprocess.Popen(
                command(instance),
                cwd=directory,
                env={**os.environ, "PYTHONPATH": str(ROOT)},  # this checkout's stand-ins
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
            )
            waits.callback(process.wait)
            kills.callback(process.kill)
        yield


def arducopter_command(binary: Path, instance: int, more: Sequence[Path] = ()) -> list[str]:
    """What starts an arducopter on the physics at UDP 9002 + 10 * `instance`; `more` are files of parameters."""
    place = HOME.position
    home = f"{place.lat_deg},{place.lon_deg},{place.alt_amsl_m},{HOME.yaw_deg}"
    command = [str(binary), "-w", "--model", "JSON:127.0.0.1", f"-I{instance}", "--home", home]
    return [
        *command,
        "--defaults",
        ",".join(map(str, (PARAMETERS, *more))),
        "--serial0",
        "tcp:0",
        "--speedup",
        "20",
    ]


def factor_without_physics(port: int, warm_up_s: float, duration_s: float) -> float:
    """Real-time factor of the autopilot that comes to UDP `port` if each frame is answered at once with rest."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.bind(("127.0.0.1", port))
        sock.settimeout(20.0)
        sock.recvfrom(128)  # SITL sends it again
        sock.settimeout(None)
        time_s = begin_s = 0.0
        from_s = time.perf_counter() + warm_up_s
        until_s = from_s + duration_s
        while (wall_s := time.perf_counter()) < until_s:
            if wall_s < from_s:
                begin_s = time_s
            datagram, sender = sock.recvfrom(128)
            fields = unpack_servo_packet(datagram)
            if not isinstance(fields, str):
                time_s += 1.0 / fields[1]
                sock.sendto(AT_REST % time_s, sender)
    return (time_s - begin_s) / duration_s


@contextlib.contextmanager
def on_one_core() -> Iterator[None]:
    """Keep this process and those that it starts on one core."""
    before = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {min(before)})
    try:
        yield
    finally:
        os.sched_setaffinity(0, before)


def factor_with_physics(
    ports: Sequence[int],
    warm_up_s: float,
    duration_s: float,
    speed: float = math.inf,
    workers: int = 1,
    coupling: Coupling = "serial",
    placement: Placement = "auto",
    from_sim_s: float = 0.0,
    px4: Px4Peer | None = None,
) -> tuple[float, float]:
    """Real-time factor of the fleet that comes to the `ports`, UDP (`px4`: TCP), and the cores that the exchange takes.

    It is measured for `duration_s` of wall time, after `warm_up_s` of wall time and `from_sim_s` of sim time.
    """
    airframe = load_airframe("f450")
    marks: list[tuple[float, float, float]] = []

    def on_tick(status: ClockStatus) -> None:
        now_s = time.perf_counter()
        if status.stalled_ua:
            raise RuntimeError(f"UA {status.stalled_ua} do not answer")
        is_warm = len(marks) == 1 and now_s - marks[0][0] >= warm_up_s
        if not marks or (is_warm and status.sim_time_ns >= from_sim_s * 1e9):
            marks.append((now_s, status.sim_time_ns / 1e9, cpu_s(exchange)))
        elif len(marks) == 2 and now_s - marks[1][0] >= duration_s:
            marks.append((now_s, status.sim_time_ns / 1e9, cpu_s(exchange)))
            exchange.stop()

    exchange = open_exchange(
        [AircraftSpec(index, airframe, HOME, port, px4=px4) for index, port in enumerate(ports)],
        workers=workers,
        coupling=coupling,
        placement=placement,
        speed=speed,
        stall_timeout_s=10.0,
        on_truth=lambda _: None,
        on_tick=on_tick,
    )
    try:
        exchange.run()
    finally:
        exchange.close()
    wall_s, sim_s, spent_s = (end - begin for begin, end in zip(marks[1], marks[2], strict=True))
    return sim_s / wall_s, spent_s / wall_s


def cpu_s(exchange: Exchange | FleetExchange) -> float:
    """CPU time that this process and the exchange's workers have taken."""
    spent_s = time.process_time()
    if isinstance(exchange, FleetExchange):
        for pid in exchange.worker_pids:
            times = psutil.Process(pid).cpu_times()
            spent_s += times.user + times.system
    return spent_s


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure, print people's lines and one line of JSON."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--seconds", type=float, default=3.0, help="wall time of each measure")
    parser.add_argument("--instance", type=int, default=FIRST_INSTANCE, help="of ArduPilot, below 250")
    options = parser.parse_args(arguments)
    binary = find_arducopter()
    if binary is None:
        print("fdm with arducopter: skipped, as neither ARDUPILOT_HOME nor PATH leads to one")
        return
    rounds = []
    for _ in range(options.rounds):
        rounds.append(measure_round(binary, options.instance, options.seconds))
        print(
            f"round {len(rounds)}: {', '.join(f'{what} {factor:.2f}' for what, factor in rounds[-1].items())}"
        )
    reference = [max(r["responder"], r["responder, one core"]) for r in rounds]
    result: dict[str, object] = {"load": load(), "limit": LIMIT, "rounds": rounds}
    print(f"fdm with arducopter: load average {load()} on {os.cpu_count()} cores; wanted: {LIMIT}")
    for coupling in get_args(Coupling):
        factor = statistics.median(r[coupling] for r in rounds)
        ratio = statistics.median(r[coupling] / bare for r, bare in zip(rounds, reference, strict=True))
        print(f"fdm with arducopter: {coupling}: real-time factor {factor:.2f}, ratio {ratio:.2f}")
        result[coupling] = {"real_time_factor": round(factor, 2), "ratio": round(ratio, 3)}
    print(json.dumps({"bench": "fdm_ardupilot", **result}))


def measure_round(binary: Path, instance: int, seconds: float) -> dict[str, float]:
    """Real-time factors of one round, by what answers the autopilot."""
    port, factors = default_port(instance), {}
    for name, place in (("responder", contextlib.nullcontext), ("responder, one core", on_one_core)):
        with place(), running(lambda i: arducopter_command(binary, i), [instance]):
            factors[name] = factor_without_physics(port, 1.0, seconds)
    for coupling in get_args(Coupling):
        with running(lambda i: arducopter_command(binary, i), [instance]):
            factors[coupling], _ = factor_with_physics([port], 1.0, seconds, coupling=coupling)
    return factors


if __name__ == "__main__":
    main()
