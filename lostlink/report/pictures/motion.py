"""Where the nodes were: a map in metres, and heights."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from lostlink.report.pictures.theme import (
    FAINT,
    INK,
    SERIES,
    figure_of,
    legend_above,
    short,
    svg_of,
    themed,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

LEGEND_MAX = 10
NAMES_MAX = 60
"""Of more nodes than this the map has no names."""
MARKERS = {"ua": "o", "ground": "s"}
OTHER_MARKER = "*"


def draw_map(content: dict[str, Any]) -> str:
    """Ways over the ground, north up; a dot where each ends. What stands is a square, or a star if it only radiates."""
    titles = {node["id"]: node["title"] for node in content["nodes"]}
    with themed():
        figure, axes = figure_of(8.0, 6.0)
        flying = 0
        for track in content["tracks"]:
            color = INK
            if track["kind"] == "ua":
                color, flying = SERIES[flying % len(SERIES)], flying + 1
            _draw_way(axes, track, color, titles[track["id"]], is_one_of_many=len(titles) > LEGEND_MAX)
        if len(titles) <= LEGEND_MAX:
            legend_above(axes)
        elif len(titles) <= NAMES_MAX:
            _name_ends(axes, content["tracks"])
        axes.plot(0.0, 0.0, "+", color=FAINT, markersize=10)
        axes.set(xlabel="east of the origin, m", ylabel="north of the origin, m")
        axes.set_aspect("equal", adjustable="datalim")
        axes.margins(0.08)
        return svg_of(figure, "map", f"Map of the ways of {_count(content)}, in metres from the origin.")


def _draw_way(axes: Axes, track: dict[str, Any], color: str, title: str, *, is_one_of_many: bool) -> None:
    line: dict[str, Any] = {"lw": 0.7, "alpha": 0.6} if is_one_of_many else {"lw": 1.2}
    axes.plot(track["east_m"], track["north_m"], color=color, **line)
    marker = MARKERS.get(track["kind"], OTHER_MARKER)
    axes.plot(track["east_m"][-1:], track["north_m"][-1:], marker, color=color, markersize=6, label=title)


def _name_ends(axes: Axes, tracks: list[dict[str, Any]]) -> None:
    for track in tracks:
        end = (track["east_m"][-1], track["north_m"][-1])
        axes.annotate(short(track["id"]), end, xytext=(5, 4), textcoords="offset points", fontsize=9)


def draw_heights(content: dict[str, Any]) -> str:
    """Height above the origin over time."""
    titles = {node["id"]: node["title"] for node in content["nodes"]}
    flying = [track for track in content["tracks"] if track["kind"] == "ua"]
    with themed():
        figure, axes = figure_of()
        for place, track in enumerate(flying):
            line: dict[str, Any] = {"color": SERIES[place % len(SERIES)], "linestyle": ("-", "--")[place % 2]}
            line["marker"] = "o" if len(track["sim_time_s"]) == 1 else None
            axes.plot(track["sim_time_s"], track["height_m"], label=titles[track["id"]], **line)
        axes.set(xlabel="sim time, s", ylabel="height above the origin, m")
        if 1 < len(flying) <= LEGEND_MAX:
            legend_above(axes)
        return svg_of(
            figure, "heights", f"Height over time of {len(flying)} UA; the table has the lowest and highest."
        )


def _count(content: dict[str, Any]) -> str:
    names = [node["title"] for node in content["nodes"]]
    return f"{len(names)} nodes" if len(names) > LEGEND_MAX else ", ".join(names)
