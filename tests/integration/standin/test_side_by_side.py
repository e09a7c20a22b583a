"""The stand-in beside what is recorded of ArduCopter: it does the same, or refuses."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.interop.ardupilot.side_by_side import DATA, PAGE, PARTS, flown, table

ROWS = json.loads(DATA.read_text())
ITS_OWN = {"ready to arm after", "take-off takes"}
"""It has no estimator to wait for."""


def outcome(answer: str) -> str:
    """An answer without the autopilot's words."""
    return answer if answer.startswith("reached") else re.split("[:(]", answer)[0].strip()


@pytest.mark.parametrize("asked", sorted(ROWS["stand-in"].keys() - ITS_OWN))
def test_it_does_as_arducopter_or_refuses(asked: str) -> None:
    own, real = outcome(ROWS["stand-in"][asked]), outcome(ROWS["ArduCopter"][asked])
    assert own in (real, "refused")


def test_the_page_has_the_table_that_was_recorded() -> None:
    assert PAGE.read_text().endswith(table(ROWS))


@pytest.mark.parametrize(
    "parts",
    [
        pytest.param(("on_the_ground",), id="short", marks=pytest.mark.slow),
        pytest.param(PARTS, id="whole", marks=[pytest.mark.slow, pytest.mark.long, pytest.mark.timeout(300)]),
    ],
)
def test_the_stand_in_does_what_is_recorded_of_it(
    parts: tuple[str, ...], tmp_path: Path, free_slot: Callable[[int], int]
) -> None:
    found = flown("stand-in", tmp_path, free_slot(1), parts)
    assert found.items() <= ROWS["stand-in"].items()
    assert len(found) == (len(ROWS["stand-in"]) if parts == PARTS else 15)
