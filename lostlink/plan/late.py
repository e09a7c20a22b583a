"""What a scenario has for times after its run: outages, partitions, gusts, tracks, expectations."""

from __future__ import annotations

from collections.abc import Iterator

from bridge.scenario.expectations import PositionExpectation
from bridge.scenario.model import Scenario
from bridge.scenario.nodes import Aircraft
from bridge.scenario.resolve.flight import wind_of


def too_late(scenario: Scenario) -> Iterator[str]:
    """Warnings: what begins when the run is over, however long it takes."""
    ends = f"and the run ends at duration_s, {scenario.duration_s:g} s"
    ticks = -(-round(scenario.duration_s * 1e9) // scenario.tick_period_ns)  # it ends with a whole one
    end_s = ticks * scenario.tick_period_ns / 1e9
    for what, begins_s in _events(scenario):
        if begins_s >= end_s:
            yield f"{what} {begins_s:g} s, {ends}"
    for what, begins_s in _expected(scenario):
        if begins_s > end_s:
            yield f"{what} {begins_s:g} s, {ends}: it will not be met"


def _events(scenario: Scenario) -> Iterator[tuple[str, float]]:
    for node in scenario.transceivers:
        for outage in node.radio_off:
            yield f"node {node.node}: its radio goes off at", outage.from_s
    for number, partition in enumerate(scenario.partitions):
        yield f"partitions.{number}: it begins at", partition.from_s
    for other in scenario.nodes:
        if not isinstance(other, Aircraft) and len(other.track) > 1:
            yield (
                f"node {other.node}: its track leads away from its first place at",
                other.track[0].sim_time_s,
            )
    for number, gust in enumerate(wind_of(scenario).gusts):
        yield f"wind.gusts.{number}: it begins at", gust.start_s


def _expected(scenario: Scenario) -> Iterator[tuple[str, float]]:
    for each in scenario.expectations:
        between_s = getattr(each, "between_s", None)
        if between_s is not None:
            yield f"expectation {each.title!r}: its between_s begins at", between_s[0]
        if isinstance(each, PositionExpectation) and not isinstance(each.at, str):
            yield f"expectation {each.title!r}: its at is", each.at
