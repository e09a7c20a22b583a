"""Which way packets from outside may go: by which of a node's radios, and to whom."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from bridge.bus.keys import ALL
from bridge.record.inputs.fields import InputError, RecordedInput
from bridge.scenario.model import Scenario


def whom(scenario: Scenario, node: str) -> dict[str, set[str]]:
    """Whom a packet of a node may be for (a node, a group, all), by radio."""
    return {radio: {ALL, *ids} - {node} for radio, ids in scenario.reach_of(node).items()}


def check_ways(scenario: Scenario, inputs: Mapping[str, Sequence[RecordedInput]]) -> None:
    """See that recorded packets can go where they say.

    Raises:
        InputError: one cannot; the text has node, instant, key and what is allowed.
    """
    for node, items in inputs.items():
        packets = [(item.tick_ns, item.way) for item in items if item.way is not None]
        radios = whom(scenario, node) if packets else {}
        for tick_ns, way in packets:
            where = f"inputs/{node}.jsonl, at tick_ns {tick_ns}"
            if way.radio not in radios:
                raise InputError(f"{where}: key 'radio': {way.radio!r}; node {node} has {', '.join(radios)}")
            if way.to not in radios[way.radio]:
                known = ", ".join(sorted(radios[way.radio]))
                raise InputError(f"{where}: key 'to': {way.to!r}; on radio {way.radio} there are {known}")
