"""Modems that dropped much of what came to them, as a buffer was full."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from typing import Final, NamedTuple

from bridge.record.events import Reports
from bridge.scenario.model import Scenario

DROPPED_FROM: Final = 0.01
"""A smaller share of its bytes is dropped now and then, as where a list of parameters begins."""


class _Buffer(NamedTuple):
    """One of a modem's buffers: names of its counters, which of them add up to what came, and what helps."""

    dropped: str
    came: tuple[str, ...]
    who: str
    helps: str


BUFFERS: Final = (
    _Buffer("dropped_bytes", ("bytes_in",), "its host gave it", "ask for less, or take a faster radio"),
    _Buffer("cut_bytes", ("bytes_out", "cut_bytes"), "came for its host", "give its line more baud"),
)


def full_modems(scenario: Scenario, reports: Reports) -> Iterator[str]:
    """A warning for each buffer of a modem that was full for much of what came to it."""
    counts = Counter[str]()
    for counters in reports.counters.values():
        counts.update(counters)
    for network in scenario.network_names:
        for node in scenario.modems_on(network):
            head = f"modem.{network}.{node}."
            for buffer in BUFFERS:
                dropped, came = (
                    counts[head + buffer.dropped],
                    sum(counts[head + what] for what in buffer.came),
                )
                if came and dropped >= DROPPED_FROM * came:
                    yield (
                        f"{network}: the modem of node {node} dropped {dropped} of the {came} bytes that "
                        f"{buffer.who} ({dropped / came:.1%}), as its buffer was full: {buffer.helps}"
                    )
