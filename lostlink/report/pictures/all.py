"""All pictures of a report."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

from lostlink.report.pictures.air_use import draw_air_delay, draw_air_use
from lostlink.report.pictures.motion import draw_heights, draw_map
from lostlink.report.pictures.radio import draw_ages, draw_delivery, draw_losses, draw_matrix, draw_powers

Pictures = dict[str, str]
Wanted = tuple[str, bool, Callable[[], str]]
"""The picture's name, whether there is something for it, and what draws it."""


def draw_all(content: dict[str, Any], tell: Callable[[str], object] = lambda _step: None) -> Pictures:
    """Each picture that there is something for, by name, as SVG.

    Args:
        content: of the report.
        tell: called with what is drawn next.
    """
    networks = content["networks"]
    wanted: list[Wanted] = [
        ("map", bool(content["tracks"]), partial(draw_map, content)),
        ("heights", any(t["kind"] == "ua" for t in content["tracks"]), partial(draw_heights, content)),
        ("delivery", bool(content["bins"]), partial(draw_delivery, content)),
        *(each for network in networks for each in _of_network(content, network)),
        ("ages", bool(networks) and bool(content["ages"]["sim_time_s"]), partial(draw_ages, content)),
    ]
    found = {}
    for name, is_there, draw in wanted:
        if is_there:
            tell(f"draws {name}")
            found[name] = draw()
    return found


def _of_network(content: dict[str, Any], network: dict[str, Any]) -> Iterator[Wanted]:
    """Pictures of which each radio network that carried a packet has its own."""
    radio, key = network["radio"], key_of(content, network["radio"])
    links = [link for link in content["links"] if link["radio"] == radio]
    air = next(each for each in content["air"] if each["radio"] == radio)
    has_powers = any(box["median"] is not None for box in network["powers"]["boxes"])
    has_ages = any(link["age_mean_s"] is not None for link in links)
    share = partial(draw_matrix, content, radio, "delivery", "share delivered", key=key, share=True)
    age = partial(
        draw_matrix, content, radio, "age_mean_s", "mean age of information, s", key=key, share=False
    )
    yield f"powers{key}", has_powers, partial(draw_powers, network, key)
    yield f"matrix{key}", True, share
    yield f"age_matrix{key}", has_ages, age
    yield f"losses{key}", True, partial(draw_losses, network, key)
    yield f"air_use{key}", True, partial(draw_air_use, air, key)
    yield f"air_delay{key}", _came(air), partial(draw_air_delay, air, key)


def key_of(content: dict[str, Any], radio: str) -> str:
    """What names of a radio network's pictures end with."""
    return f"-{radio}" if len(content["networks"]) > 1 else ""


def _came(air: dict[str, Any]) -> bool:
    """Whether there are delays to be drawn, above 0 as a logarithm needs it."""
    return any(air["series"]["delay_p95_s"] or ())
