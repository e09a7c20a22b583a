"""The API of a node in a run refuses what the API of a daemon refuses, in the same way."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from aps.callbacks import Callbacks
from aps.vehicle.commander import Commander
from bridge.host.api import NodeBackend
from tests.unit.aps.vehicle.flight.test_targets import COPTER


@pytest.mark.parametrize(
    ("verb", "arguments", "text"),
    [
        ("goto", {"lat_deg": 100.0, "lon_deg": 8.0, "alt_rel_m": 20.0}, "lat_deg must be in -90..90"),
        ("mode", {"mode": "NO_SUCH"}, "'NO_SUCH' is none of"),
        ("goto", {"lat": 1.0}, "no argument 'lat'"),
        ("dance", {}, "'dance' is none of"),
    ],
)
def test_a_wrong_argument_is_the_callers_mistake_and_no_input(
    verb: str, arguments: dict[str, Any], text: str
) -> None:
    asked: list[str] = []
    commands = Commander(lambda: COPTER, lambda *_: None, lambda: 0, lambda: None, Callbacks())
    node = SimpleNamespace(operator_asked=lambda verb, *_: asked.append(verb))
    backend = NodeBackend(SimpleNamespace(commands=commands), node)  # type: ignore[arg-type]

    def start(verb: str, arguments: dict[str, Any]) -> None:
        backend.start(verb, arguments, lambda _: None, lambda _: None)

    with pytest.raises(ValueError, match=text):
        start(verb, arguments)
    start("goto", {"lat_deg": 47.0, "lon_deg": 8.0, "alt_rel_m": 20.0})
    assert asked == ["goto"]
