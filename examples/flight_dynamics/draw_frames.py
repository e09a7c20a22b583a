"""Draw the frames and signs of the flight dynamics, ``docs/img/frames.svg``.

Run from the project's directory: ``python examples/flight_dynamics/draw_frames.py``.
"""

import math
from pathlib import Path
from typing import Any

import matplotlib as mpl

mpl.use("Agg")
from matplotlib import pyplot as plt
from matplotlib.patches import Arc, Circle, Polygon

BODY, EARTH, AIR, WEIGHT = "#1f5fa8", "#444444", "#2b8a3e", "#b03030"
Point = tuple[float, float]


def arrow(axes: Any, start: Point, end: Point, colour: str, text: str = "", at: Point = (0.0, 0.0)) -> None:
    """An arrow with a name near its head; ``at`` shifts the name."""
    axes.annotate("", end, start, arrowprops={"arrowstyle": "-|>", "color": colour, "lw": 1.8})
    if text:
        axes.text(end[0] + at[0], end[1] + at[1], text, color=colour, ha="center", va="center", fontsize=9)


def turn(axes: Any, centre: Point, radius: float, begin_deg: float, sweep_deg: float, colour: str) -> None:
    """An arc with an arrow head at its end; a positive sweep is counter-clockwise."""
    low, high = sorted((begin_deg, begin_deg + sweep_deg))
    axes.add_patch(Arc(centre, 2 * radius, 2 * radius, theta1=low, theta2=high, color=colour, lw=1.5))
    end, side = math.radians(begin_deg + sweep_deg), math.copysign(0.02, sweep_deg)
    tip = (centre[0] + radius * math.cos(end), centre[1] + radius * math.sin(end))
    back = (centre[0] + radius * math.cos(end - side), centre[1] + radius * math.sin(end - side))
    axes.annotate("", tip, back, arrowprops={"arrowstyle": "-|>", "color": colour, "lw": 1.5})


def rotated(point: Point, angle_deg: float) -> Point:
    """A point turned counter-clockwise."""
    c, s = math.cos(math.radians(angle_deg)), math.sin(math.radians(angle_deg))
    return (c * point[0] - s * point[1], s * point[0] + c * point[1])


def frame_of(axes: Any, title: str) -> None:
    """An empty square panel."""
    axes.set(xlim=(-1.5, 1.5), ylim=(-1.5, 1.5), aspect="equal", title=title)
    axes.axis("off")


def from_above(axes: Any) -> None:
    """Yaw, body x and y, and the motors of a quad X."""
    frame_of(axes, "from above: yaw")
    arrow(axes, (-1.3, 0.55), (-1.3, 1.2), EARTH, "north", (0.0, 0.12))
    arrow(axes, (-1.3, 0.55), (-0.75, 0.55), EARTH, "east", (0.0, -0.13))
    axes.text(-1.3, 0.36, "⊗ down", color=EARTH, ha="center", fontsize=9)
    yaw = -30.0
    spins = {1: (45, "CCW"), 2: (225, "CCW"), 3: (135, "CW"), 4: (315, "CW")}
    for number, (place_deg, spin) in spins.items():
        hub = rotated(
            (0.75 * math.cos(math.radians(place_deg)), 0.75 * math.sin(math.radians(place_deg))), yaw
        )
        axes.plot([0.0, hub[0]], [0.0, hub[1]], color="#999999", lw=4, zorder=0)
        axes.add_patch(Circle(hub, 0.24, fill=False, color="#999999"))
        axes.text(*hub, f"{number}\n{spin}", ha="center", va="center", fontsize=8)
        turn(axes, hub, 0.24, 20.0, 320.0 if spin == "CCW" else -320.0, "#999999")
    x, y = rotated((0.0, 1.3), yaw), rotated((1.3, 0.0), yaw)
    arrow(axes, (0.0, 0.0), x, BODY, "x forward", (0.28, 0.1))
    arrow(axes, (0.0, 0.0), y, BODY, "y right", (0.0, -0.14))
    axes.plot([0.0, 0.0], [0.0, 1.3], color=EARTH, lw=0.8, ls="--")
    turn(axes, (0.0, 0.0), 1.1, 90.0, yaw, BODY)
    axes.text(0.22, 1.22, "+ψ", color=BODY, fontsize=10)


def from_the_right(axes: Any) -> None:
    """Pitch, angle of attack, weight and specific force."""
    frame_of(axes, "from the right: pitch, angle of attack")
    pitch, path = 20.0, 8.0
    axes.plot([-1.4, 1.4], [0.0, 0.0], color=EARTH, lw=0.8, ls="--")
    axes.text(-1.02, -0.12, "horizon", color=EARTH, ha="center", fontsize=9)
    shape = [(-0.8, 0.05), (-0.85, 0.3), (-0.65, 0.08), (0.6, 0.1), (0.75, 0.0), (0.6, -0.08), (-0.7, -0.04)]
    axes.add_patch(Polygon([rotated(p, pitch) for p in shape], fill=True, color="#dddddd", zorder=0))
    arrow(axes, (0.0, 0.0), rotated((1.4, 0.0), pitch), BODY, "x", (0.1, 0.05))
    arrow(axes, (0.0, 0.0), rotated((0.0, -1.2), pitch), BODY, "z down", (0.22, -0.06))
    arrow(axes, (0.0, 0.0), rotated((1.4, 0.0), path), AIR, "velocity through the air", (-0.45, -0.32))
    turn(axes, (0.0, 0.0), 1.1, 0.0, pitch, BODY)
    axes.text(1.12, 0.24, "+θ", color=BODY, fontsize=10)
    turn(axes, (0.0, 0.0), 0.85, path, pitch - path, AIR)
    axes.text(0.62, 0.11, "+α", color=AIR, fontsize=10)
    arrow(axes, (-0.1, 0.0), (-0.1, -0.9), WEIGHT, "m g", (-0.17, 0.05))
    arrow(
        axes,
        (0.0, 0.0),
        (0.0, 1.0),
        WEIGHT,
        "specific force at rest: (0, 0, −9.8)\non level axes",
        (0.0, 0.2),
    )


def from_behind(axes: Any) -> None:
    """Roll."""
    frame_of(axes, "from behind: roll")
    roll = -25.0
    axes.plot([-1.4, 1.4], [0.0, 0.0], color=EARTH, lw=0.8, ls="--")
    wing = [(-1.1, 0.04), (1.1, 0.04), (1.1, -0.04), (-1.1, -0.04)]
    axes.add_patch(Polygon([rotated(p, roll) for p in wing], color="#dddddd", zorder=0))
    axes.add_patch(Circle((0.0, 0.0), 0.16, color="#cccccc", zorder=0))
    arrow(axes, (0.0, 0.0), rotated((1.35, 0.0), roll), BODY, "y right", (0.1, -0.12))
    arrow(axes, (0.0, 0.0), rotated((0.0, -1.2), roll), BODY, "z down", (-0.1, -0.12))
    axes.text(0.0, 0.0, "⊗", color=BODY, ha="center", va="center", fontsize=12)
    axes.text(0.05, 0.24, "x forward, into the page", color=BODY, ha="center", fontsize=9)
    turn(axes, (0.0, 0.0), 0.95, 0.0, roll, BODY)
    axes.text(1.02, -0.22, "+φ", color=BODY, fontsize=10)


def wind_triangle(axes: Any) -> None:
    """Air vector, wind and ground velocity."""
    frame_of(axes, "wind triangle, from above")
    arrow(axes, (-1.3, 0.55), (-1.3, 1.2), EARTH, "north", (0.0, 0.12))
    arrow(axes, (-1.3, 0.55), (-0.75, 0.55), EARTH, "east", (0.0, -0.13))
    start, air = (-0.6, -1.2), (-0.2, 0.9)
    ground = (air[0] + 0.9, air[1])
    arrow(axes, start, air, BODY)
    axes.text(-0.62, -0.1, "airspeed,\nwhere it\npoints", color=BODY, ha="center", fontsize=9)
    arrow(axes, air, ground, AIR)
    axes.text(0.28, 1.02, "wind_ned_mps = (0, 8, 0)", color=AIR, ha="center", fontsize=9)
    arrow(axes, start, ground, EARTH)
    axes.text(0.62, -0.25, "velocity_ned_mps\n= air + wind", color=EARTH, ha="center", fontsize=9)
    axes.text(0.1, -1.42, "a wind from 270° (west) moves the air east", color=AIR, ha="center", fontsize=9)


def draw(path: Path) -> None:
    """Write the drawing."""
    mpl.rcParams["svg.hashsalt"] = "lostlink"
    figure, panels = plt.subplots(2, 2, figsize=(9, 9), constrained_layout=True)
    for axes, panel in zip(
        panels.flat, (from_above, from_the_right, from_behind, wind_triangle), strict=True
    ):
        panel(axes)
    figure.savefig(path, metadata={"Date": None})
    plt.close(figure)


if __name__ == "__main__":
    draw(Path("docs/img/frames.svg"))
