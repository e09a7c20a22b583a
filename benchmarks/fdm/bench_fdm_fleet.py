"""The real-time factor that a fleet reaches, over the number of UA: physics and autopilots alone.

    python -m benchmarks.fdm.bench_fdm_fleet --autopilot arducopter standin --plot docs/img/fdm-fleet.png
    python -m benchmarks.fdm.bench_fdm_fleet --autopilot standin --speed max --hover --coupling serial --sizes 2 8 16 32
    python -m benchmarks.fdm.bench_fdm_fleet --autopilot px4 arducopter --sizes 1 2 4 6 8 --warm-up 12  # PX4 boots

Writes a table in Markdown, and the plot if asked. The figure depends on the machine and on what else it does.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import platform
import socket
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from math import inf
from pathlib import Path
from typing import get_args

from pymavlink.dialects.v20 import ardupilotmega as dialect

from benchmarks.fdm.bench_fdm import load
from benchmarks.fdm.bench_fdm_ardupilot import (
    FIRST_INSTANCE,
    HOME,
    arducopter_command,
    factor_with_physics,
    find_arducopter,
    running,
)
from benchmarks.fdm.bench_fdm_px4 import px4_command
from bridge.run.px4 import find_px4
from fdm.exchange.aircraft_spec import Px4Peer, px4_port
from fdm.exchange.exchange import default_port
from fdm.exchange.settings import Coupling, core_count
from fdm.model.px4_sensors import Px4Sensors

LIMIT = 0.95
Points = dict[int, tuple[float, float]]
"""Per fleet size: real-time factor, cores that the exchange takes."""


HOVER_M = 10.0
HOVERS_FROM_S = 14.0
"""Sim time at which stand-ins that were asked to take off have done so."""
GUIDED = 4


def standin_options(instance: int) -> list[str]:
    """Options of a stand-in on the physics at UDP 9002 + 10 * `instance`."""
    place = HOME.position
    home = f"{place.lat_deg},{place.lon_deg},{place.alt_amsl_m},{HOME.yaw_deg}"
    ports = ["--fdm-port", str(default_port(instance)), "--mavlink-port", str(mavlink_port(instance))]
    return [*ports, "--home", home]


def mavlink_port(instance: int) -> int:
    """TCP port of a stand-in."""
    return 5760 + 10 * instance


def standin_commands(instances: Sequence[int], processes: int) -> list[list[str]]:
    """What starts stand-ins, spread over `processes`."""
    commands = []
    for first in range(min(processes, len(instances))):
        options: list[str] = []
        for instance in instances[first::processes]:
            options += [*(["+"] if options else []), *standin_options(instance)]
        commands.append([sys.executable, "-m", "standin", *options])
    return commands


def take_off(instance: int) -> None:
    """Have a stand-in take off; returns when it has accepted, and leaves it alone then."""
    codec = dialect.MAVLink(None, 255, 190)
    codec.robust_parsing = True
    steps = [(176, (1, GUIDED)), (400, (1,)), (22, (0, 0, 0, 0, 0, 0, HOVER_M))]
    with socket.create_connection(("127.0.0.1", mavlink_port(instance)), timeout=60.0) as client:
        for command, parameters in steps:
            padded = (*parameters, *([0.0] * (7 - len(parameters))))
            accepted = False
            while not accepted:
                client.sendall(dialect.MAVLink_command_long_message(1, 1, command, 0, *padded).pack(codec))
                accepted = any(
                    message.get_type() == "COMMAND_ACK" and message.result == 0
                    for message in codec.parse_buffer(client.recv(65536)) or []
                )


@contextlib.contextmanager
def taking_off(instances: Sequence[int]) -> Iterator[None]:
    """Have all take off in the background."""
    threads = [threading.Thread(target=_take_off_soon, args=(one,), daemon=True) for one in instances]
    for thread in threads:
        thread.start()
    yield
    for thread in threads:
        thread.join(10.0)
        if thread.is_alive():
            raise RuntimeError("a stand-in did not take off")


def _take_off_soon(instance: int) -> None:
    while True:
        try:
            return take_off(instance)
        except ConnectionRefusedError:  # it is not there yet
            time.sleep(0.05)


@dataclass(frozen=True, slots=True)
class How:
    """How to measure: see the options."""

    first: int
    warm_up_s: float
    seconds: float
    workers: int
    coupling: Coupling
    speed: float
    hover: bool
    is_px4: bool


def curve(commands: Callable[[Sequence[int]], list[list[str]]], sizes: Sequence[int], how: How) -> Points:
    """Measure each fleet size."""
    points: Points = {}
    for size in sizes:
        instances = range(how.first, how.first + size)
        started = commands(instances)
        with running(started.__getitem__, range(len(started))), contextlib.ExitStack() as stack:
            if how.hover:
                stack.enter_context(taking_off(instances))
            points[size] = factor_with_physics(
                [(px4_port if how.is_px4 else default_port)(instance) for instance in instances],
                how.warm_up_s,
                how.seconds,
                speed=how.speed,
                workers=min(how.workers, size),
                coupling=how.coupling,
                from_sim_s=HOVERS_FROM_S if how.hover else 0.0,
                px4=Px4Peer(Px4Sensors(), seed=1) if how.is_px4 else None,
            )
        print(
            f"  {size} UA: real-time factor {points[size][0]:.3f}, exchange {points[size][1]:.2f} cores",
            flush=True,
        )
    return points


def table(curves: dict[str, Points]) -> str:
    """The curves as a table in Markdown: real-time factors, and in brackets the cores of the exchange."""
    sizes = sorted({size for points in curves.values() for size in points})
    head = ["UA", *curves]
    lines = ["| " + " | ".join(head) + " |", "|" + "---:|" * len(head)]
    for size in sizes:
        cells = [str(size)]
        for points in curves.values():
            cells.append("{:.2f} ({:.2f})".format(*points[size]) if size in points else "-")
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def plot(curves: dict[str, Points], file: Path, speed: float) -> None:
    """Draw the curves to `file`."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.0, 3.5), layout="constrained")
    axes = figure.add_subplot()
    for name, points in curves.items():
        axes.plot(list(points), [factor for factor, _ in points.values()], marker="o", label=name)
    if speed == 1.0:
        axes.axhline(LIMIT, color="grey", linestyle=":", label=f"{LIMIT}")
    axes.set(xlabel="UA", ylabel=f"real-time factor reached (wanted: {speed:g})")
    axes.set_ylim(bottom=0.0)
    axes.legend()
    figure.savefig(file, dpi=120)


def speed_of(text: str) -> float:
    """A real-time factor, or inf for `max`."""
    return inf if text == "max" else float(text)


def options_of(arguments: Sequence[str] | None) -> argparse.Namespace:
    """What was asked for."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    choices = ("arducopter", "standin", "px4")
    parser.add_argument("--autopilot", choices=choices, nargs="+", default=list(choices[:2]))
    parser.add_argument("--sizes", type=int, nargs="+", default=[1, 4, 16])
    parser.add_argument("--warm-up", type=float, default=3.0, help="wall time before the measure, s")
    parser.add_argument("--seconds", type=float, default=5.0, help="wall time of each measure")
    parser.add_argument("--instance", type=int, default=FIRST_INSTANCE, help="the first UA's, below 250")
    parser.add_argument("--speed", type=speed_of, default=1.0, help="real-time factor to aim at, or max")
    parser.add_argument("--hover", action="store_true", help="measure stand-ins in hover, not on the ground")
    parser.add_argument(
        "--standin-processes", type=int, default=core_count(), help="processes of the stand-ins (a core each)"
    )
    parser.add_argument("--workers", type=int, default=1, help="processes of the exchange")
    couplings = get_args(Coupling)
    parser.add_argument("--coupling", choices=couplings, nargs="+", default=list(couplings))
    parser.add_argument(
        "--parameters", type=Path, nargs="*", default=[], help="more parameters of arducopter"
    )
    parser.add_argument("--plot", type=Path, help="file of the plot")
    return parser.parse_args(arguments)


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure, print people's lines, the table and one line of JSON."""
    options = options_of(arguments)
    binary, more = find_arducopter(), [path.resolve() for path in options.parameters]
    commands: dict[str, Callable[[Sequence[int]], list[list[str]]]] = {
        "standin": lambda instances: standin_commands(instances, options.standin_processes)
    }
    if binary is not None:
        commands["arducopter"] = lambda instances: [arducopter_command(binary, i, more) for i in instances]
    px4 = find_px4(os.environ)
    if px4 is not None:
        commands["px4"] = lambda instances: [px4_command(px4, i) for i in instances]
    curves: dict[str, Points] = {}
    for name in options.autopilot:
        if name not in commands:
            home = "PX4_HOME" if name == "px4" else "ARDUPILOT_HOME"
            print(f"fdm fleet with {name}: skipped, as neither {home} nor PATH leads to one")
            continue
        print(
            f"fdm fleet with {name}, speed {options.speed:g}, {os.cpu_count()} cores, {options.workers} worker(s), "
            f"load average {load()} before"
        )
        for coupling in options.coupling:
            print(f" {coupling} coupling")
            how = How(
                options.instance,
                options.warm_up,
                options.seconds,
                options.workers,
                coupling,
                options.speed,
                options.hover and name == "standin",
                name == "px4",
            )
            curves[f"{name}, {coupling}"] = curve(commands[name], options.sizes, how)
    print(table(curves))
    if options.plot is not None:
        plot(curves, options.plot, options.speed)
    print(
        json.dumps(
            {
                "bench": "fdm_fleet",
                "cores": os.cpu_count(),
                "python": platform.python_version(),
                "speed": "max" if options.speed == inf else options.speed,
                "curves": curves,
            }
        )
    )


if __name__ == "__main__":
    main()
