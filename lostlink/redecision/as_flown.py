"""What stays as recorded where packets are decided anew: whatever made the flight, and what was transmitted."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Final

from pydantic import BaseModel

from bridge.scenario.model import Scenario

OF_THE_RADIO: Final = frozenset(("seed", "radio", "networks", "partitions", "nodes"))
OF_NO_RESULT: Final = frozenset(
    (
        "name",
        "description",
        "speed",
        "processes",
        "zenoh",
        "hosts",
        "api",
        "figure",
        "ports",
        "mcap",
        "expectations",
    )
)
OF_A_NODES_RADIO: Final = frozenset(("radio", "networks", "groups", "radio_off", "modems"))
OF_AN_EMISSION: Final = frozenset(("frequency_hz", "power_dbm", "bandwidth_hz", "duty", "slot_s", "antenna"))


def refuse_another_flight(run: Path, recorded: Scenario, asked: Scenario) -> None:
    """See that a scenario differs from that of a run by radios, emissions and seed alone.

    Raises:
        ValueError: it has another value of what stays as recorded; the text has its key.
    """
    if recorded.tick_rate_hz != asked.tick_rate_hz:
        raise ValueError(
            f"tick_rate_hz: {run} has {recorded.tick_rate_hz} ticks a second; its packets cannot be decided at another "
            "rate"
        )
    if key := next(_changed(recorded, asked), ""):
        raise ValueError(
            f"{key}: {run} was flown with another value, and flight and transmissions stay as recorded: "
            f"`lostlink run {run / 'scenario.yaml'} --set {key}=...` flies anew"
        )


def _changed(recorded: Scenario, asked: Scenario) -> Iterator[str]:
    yield from _differing(recorded, asked, OF_THE_RADIO | OF_NO_RESULT)
    if len(recorded.nodes) != len(asked.nodes):
        yield "nodes"
        return
    for before, after in zip(recorded.nodes, asked.nodes, strict=True):
        free = OF_AN_EMISSION if before.kind == "emitter" else OF_A_NODES_RADIO
        yield from (f"nodes.{before.id}.{key}" for key in _differing(before, after, free))


def _differing(before: BaseModel, after: BaseModel, free: frozenset[str]) -> Iterator[str]:
    """Keys with another value, but for those that may."""
    for name in sorted(set(type(before).model_fields) - free):
        if getattr(before, name) != getattr(after, name, None):
            yield name
