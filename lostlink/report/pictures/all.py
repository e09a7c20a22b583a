"""All pictures of a report."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from lostlink.report.pictures.air_use import draw_air_delay, draw_air_use
from lostlink.report.pictures.motion import draw_heights, draw_map
from lostlink.report.pictures.radio import draw_ages, draw_delivery, draw_losses, draw_matrix, draw_powers

Pictures = dict[str, str]


def draw_all(content: dict[str, Any], tell: Callable[[str], object] = lambda _step: None) -> Pictures:
    """Each picture that there is something for, by name, as SVG.

    Args:
        content: of the report.
        tell: called with what is drawn next.
    """
    has_packets, air = bool(content["links"]), content["air"]
    wanted: list[tuple[str, bool, Callable[[], str]]] = [
        ("map", bool(content["tracks"]), lambda: draw_map(content)),
        ("heights", any(t["kind"] == "ua" for t in content["tracks"]), lambda: draw_heights(content)),
        ("delivery", bool(content["bins"]), lambda: draw_delivery(content)),
        (
            "powers",
            any(b["median"] is not None for b in content["powers"]["boxes"]),
            lambda: draw_powers(content),
        ),
        ("matrix", has_packets, lambda: draw_matrix(content, "delivery", "share delivered", share=True)),
        ("losses", has_packets, lambda: draw_losses(content)),
        (
            "age_matrix",
            any(link["age_mean_s"] is not None for link in content["links"]),
            lambda: draw_matrix(content, "age_mean_s", "mean age of information, s", share=False),
        ),
        ("air_use", bool(air), lambda: draw_air_use(air[0])),
        ("air_delay", bool(air) and _came(air[0]), lambda: draw_air_delay(air[0])),
        ("ages", has_packets and bool(content["ages"]["sim_time_s"]), lambda: draw_ages(content)),
    ]
    found = {}
    for name, is_there, draw in wanted:
        if is_there:
            tell(f"draws {name}")
            found[name] = draw()
    return found


def _came(air: dict[str, Any]) -> bool:
    """Whether there are delays to be drawn, above 0 as a logarithm needs it."""
    return any(air["series"]["delay_p95_s"] or ())
