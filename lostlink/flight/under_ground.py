"""UA that flew into the ground of their radio's terrain, against which no flight model flies."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress

import numpy as np

from bridge.record.tables.schema import TableError
from bridge.run.directory import RunDirectory
from bridge.scenario.model import Scenario
from bridge.scenario.resolve.radio import radios_of
from channel.propagation.terrain import Terrain
from channel.validity import OutsideValidityError
from lostlink.plan.below_ground import BELOW_M
from lostlink.reading.air.use import NS_PER_S
from lostlink.reading.named import named
from lostlink.reading.positions import Floats, places_of


def under_ground(scenario: Scenario, run: RunDirectory) -> Iterator[str]:
    """A warning for each network with UA that were below the terrain of its radio, the deepest first."""
    laws = list(_terrains(scenario))
    if not laws:
        return
    try:
        ticks_ns, places = places_of(run.path, scenario.stations)
    except (OSError, TableError):
        return  # why it cannot be read is reported where it should have become Parquet
    told: dict[str, list[tuple[float, str]]] = {}
    for network, node, law in laws:
        below_m = _below_m(law, places[node])
        found = np.flatnonzero(below_m > BELOW_M)
        if found.size:
            deepest_m, first_s = float(below_m[found].max()), ticks_ns[found[0]] / NS_PER_S
            words = f"{node} by up to {deepest_m:.0f} m, first at {first_s:g} s"
            told.setdefault(network, []).append((deepest_m, words))
    for network, deep in told.items():
        deep.sort(key=lambda one: -one[0])
        yield (
            f"below the terrain of the radio of network {network}: UA {named([words for _, words in deep], '; ')}: "
            "nothing of it stops an aircraft, and antennas there counted as just above the ground"
        )


def _terrains(scenario: Scenario) -> Iterator[tuple[str, str, Terrain]]:
    """The terrain under each UA on each network: its name, the UA's, and the law."""
    uas = {ua.node for ua in scenario.ua}
    for network in scenario.network_names:
        for node, radio in radios_of(scenario, network=network).items():
            if node in uas and isinstance(radio.config.propagation, Terrain):
                yield network, node, radio.config.propagation


def _below_m(law: Terrain, track: Floats) -> Floats:
    """How far below the ground a UA was, m, less than nothing above it; nan where it has no place, or law no ground."""
    below_m = np.full(len(track), np.nan)
    there = np.isfinite(track[:, 0])
    with suppress(OutsideValidityError):  # it ended the run
        below_m[there] = law.height_m(track[there, 0], track[there, 1]) + track[there, 2]
    return below_m
