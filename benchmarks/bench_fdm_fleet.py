"""The real-time factor that a fleet reaches when it aims at 1, over the number of UA: physics and autopilots alone.

    python -m benchmarks.bench_fdm_fleet --autopilot arducopter standin --plot docs/img/fdm-fleet.png

Writes a table in Markdown, and the plot if asked. The figure depends on the machine and on what else it does.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import get_args

from benchmarks.bench_fdm import load
from benchmarks.bench_fdm_ardupilot import (
    FIRST_INSTANCE,
    HOME,
    arducopter_command,
    factor_with_physics,
    find_arducopter,
    running,
)
from fdm.exchange.exchange import default_port
from fdm.exchange.settings import Coupling

LIMIT = 0.95
Points = dict[int, tuple[float, float]]
"""Per fleet size: real-time factor, cores that the exchange takes."""


def standin_command(instance: int) -> list[str]:
    """What starts a stand-in on the physics at UDP 9002 + 10 * `instance`."""
    place = HOME.position
    home = f"{place.lat_deg},{place.lon_deg},{place.alt_amsl_m},{HOME.yaw_deg}"
    command = [sys.executable, "-m", "bridge.standin", "--fdm-port", str(default_port(instance))]
    return [*command, "--mavlink-port", "0", "--home", home]


def curve(
    command: Callable[[int], Sequence[str]],
    sizes: Sequence[int],
    first: int,
    warm_up_s: float,
    seconds: float,
    workers: int,
    coupling: Coupling,
) -> Points:
    """Measure each fleet size."""
    points: Points = {}
    for size in sizes:
        instances = range(first, first + size)
        with running(command, instances):
            ports = [default_port(instance) for instance in instances]
            points[size] = factor_with_physics(
                ports, warm_up_s, seconds, speed=1.0, workers=min(workers, size), coupling=coupling
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


def plot(curves: dict[str, Points], file: Path) -> None:
    """Draw the curves to `file`."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.0, 3.5), layout="constrained")
    axes = figure.add_subplot()
    for name, points in curves.items():
        axes.plot(list(points), [factor for factor, _ in points.values()], marker="o", label=name)
    axes.axhline(LIMIT, color="grey", linestyle=":", label=f"{LIMIT}")
    axes.set(xlabel="UA", ylabel="real-time factor reached (1 wanted)", ylim=(0, 1.05))
    axes.legend()
    figure.savefig(file, dpi=120)


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure, print people's lines, the table and one line of JSON."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    choices = ("arducopter", "standin")
    parser.add_argument("--autopilot", choices=choices, nargs="+", default=list(choices))
    parser.add_argument("--sizes", type=int, nargs="+", default=[1, 4, 16])
    parser.add_argument("--warm-up", type=float, default=3.0, help="wall time before the measure, s")
    parser.add_argument("--seconds", type=float, default=5.0, help="wall time of each measure")
    parser.add_argument("--instance", type=int, default=FIRST_INSTANCE, help="the first UA's, below 250")
    parser.add_argument("--workers", type=int, default=1, help="processes of the exchange")
    couplings = get_args(Coupling)
    parser.add_argument("--coupling", choices=couplings, nargs="+", default=list(couplings))
    parser.add_argument(
        "--parameters", type=Path, nargs="*", default=[], help="more parameters of arducopter"
    )
    parser.add_argument("--plot", type=Path, help="file of the plot")
    options = parser.parse_args(arguments)
    binary, more = find_arducopter(), [path.resolve() for path in options.parameters]
    commands: dict[str, Callable[[int], Sequence[str]]] = {"standin": standin_command}
    if binary is not None:
        commands["arducopter"] = lambda instance: arducopter_command(binary, instance, more)
    curves: dict[str, Points] = {}
    for name in options.autopilot:
        if name not in commands:
            print("fdm fleet with arducopter: skipped, as neither ARDUPILOT_HOME nor PATH leads to one")
            continue
        print(
            f"fdm fleet with {name}, speed 1, {os.cpu_count()} cores, {options.workers} worker(s), "
            f"load average {load()} before"
        )
        for coupling in options.coupling:
            print(f" {coupling} coupling")
            curves[f"{name}, {coupling}"] = curve(
                commands[name],
                options.sizes,
                options.instance,
                options.warm_up,
                options.seconds,
                options.workers,
                coupling,
            )
    print(table(curves))
    if options.plot is not None:
        plot(curves, options.plot)
    print(
        json.dumps(
            {
                "bench": "fdm_fleet",
                "cores": os.cpu_count(),
                "python": platform.python_version(),
                "curves": curves,
            }
        )
    )


if __name__ == "__main__":
    main()
