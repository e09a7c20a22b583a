"""ArduCopter and ArduPlane do what is recorded of them beside the stand-in."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.interop.ardupilot.side_by_side import DATA, flown

pytestmark = [pytest.mark.ardupilot, pytest.mark.slow, pytest.mark.timeout(600)]


@pytest.mark.parametrize("kind", ["ArduCopter", "ArduPlane"])
def test_real_autopilots_do_what_is_recorded_of_them(
    kind: str, request: pytest.FixtureRequest, tmp_path: Path, free_slot: Callable[[int], int]
) -> None:
    request.getfixturevalue(kind.lower())
    assert flown(kind, tmp_path, free_slot(1)) == json.loads(DATA.read_text())[kind]
