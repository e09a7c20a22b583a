"""Draw how PX4 and ArduPilot flew the same mission: tracks, heights and speeds from the run's true states.

lostlink run examples/two_autopilots/two_autopilots.yaml --out runs/two
python examples/two_autopilots/figures.py runs/two/* docs/img/two-autopilots.png
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from lostlink.reading.run import Run, load_run

NAMES = {"0": "PX4", "1": "ArduPilot"}
POSITION = ["position_north_m", "position_east_m", "position_down_m"]
VELOCITY = ["velocity_north_mps", "velocity_east_mps"]
Floats = NDArray[np.float64]


def track(run: Run, node: str) -> tuple[Floats, Floats, Floats]:
    """Times since it left the ground, s, from then on places from home (north, east, up), m, and speeds, m/s."""
    truth = run.truth[run.truth["node"] == node]
    places_m = (truth[POSITION].to_numpy() - truth[POSITION].to_numpy()[0]) * (1.0, 1.0, -1.0)
    begin = int(np.argmax(places_m[:, 2] > 0.5))
    times_s = truth["sim_time_ns"].to_numpy()[begin:] / 1e9
    return times_s - times_s[0], places_m[begin:], np.hypot(*truth[VELOCITY].to_numpy()[begin:].T)


def draw(run: Run, path: Path) -> None:
    """Tracks seen from above, heights and ground speeds over time."""
    figure = Figure(figsize=(11, 4.4), layout="constrained")
    axes = figure.subplot_mosaic([["map", "height"], ["map", "speed"]], width_ratios=(1, 1.5))
    for colour, (node, name) in zip(("C0", "C1"), NAMES.items(), strict=True):
        times_s, places_m, speeds_mps = track(run, node)
        axes["map"].plot(places_m[:, 1], places_m[:, 0], color=colour, label=name)
        axes["height"].plot(times_s, places_m[:, 2], color=colour)
        axes["speed"].plot(times_s, speeds_mps, color=colour)
    for north_m, east_m in run.scenario.node("0").agent.options["corners"]:
        axes["map"].plot(east_m, north_m, "k+", markersize=10)
    axes["map"].set(xlabel="east of home, m", ylabel="north of home, m", aspect="equal")
    axes["map"].legend(fontsize=8)
    axes["height"].set(ylabel="height, m")
    axes["speed"].set(xlabel="time since it left the ground, s", ylabel="ground speed, m/s")
    for each in axes.values():
        each.grid(visible=True, alpha=0.3)
    figure.savefig(path, dpi=110)


if __name__ == "__main__":
    draw(load_run(Path(sys.argv[1])), Path(sys.argv[2]))
