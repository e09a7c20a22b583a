"""A run waits for its view before the first tick: however it is joined, and whatever comes meanwhile."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from bridge.fleet.how import How
from bridge.run.directory import RunDirectory
from bridge.scenario.file import parse_scenario
from lostlink.flight.flight import Flight, Silent
from tests.integration.bridge.conftest import STILL

TIMEOUT_S = 60.0


class Errors(Silent):
    """Keeps what goes wrong."""

    def __init__(self) -> None:
        self.texts: list[str] = []

    def on_error(self, text: str) -> None:
        self.texts.append(text)


class Flown(threading.Thread):
    """A flight in a thread of its own, whose view joins as ``view`` has it."""

    def __init__(self, folder: Path, slot: int, how: How, view: Callable[[], Any]) -> None:
        super().__init__(daemon=True)
        text = STILL.format(speed="max", duration_s=1.0, slot=slot)
        text += f"processes: {'many' if how == 'many' else 'one'}\n"
        scenario = parse_scenario(text, "still.yaml", folder)
        self.errors, self.summary = Errors(), {"ending": ""}
        self.flight = Flight(scenario, RunDirectory.create(folder, scenario.name), self.errors, how)
        self.flight.view = view

    def run(self) -> None:
        self.summary = self.flight.fly(takes_signals=False)


@pytest.mark.parametrize("how", ["one", "task", pytest.param("many", marks=pytest.mark.slow)])
def test_a_run_that_is_ended_while_it_waits_has_no_tick(
    how: How, tmp_path: Path, free_slot: Callable[[int], int]
) -> None:
    waits = threading.Event()

    async def view() -> str:
        waits.set()
        await asyncio.Event().wait()
        return ""

    flown = Flown(tmp_path, free_slot(2), how, view)
    flown.start()
    assert waits.wait(TIMEOUT_S)
    flown.flight.interrupt()
    flown.join(TIMEOUT_S)
    assert not flown.is_alive()
    assert (flown.summary["ending"], flown.summary["sim_duration_s"]) == ("interrupted", 0.0)
    assert flown.errors.texts == []


@pytest.mark.parametrize("how", ["one", "task", pytest.param("many", marks=pytest.mark.slow)])
def test_a_run_flies_without_a_view_that_does_not_come_and_says_so(
    how: How, tmp_path: Path, free_slot: Callable[[int], int]
) -> None:
    async def view() -> str:
        return "the view has ended"

    flown = Flown(tmp_path, free_slot(2), how, view)
    flown.start()
    flown.join(TIMEOUT_S)
    assert not flown.is_alive()
    assert flown.errors.texts == ["the view has ended"]
    assert (flown.summary["ending"], flown.summary["sim_duration_s"]) == ("duration", 1.0)
