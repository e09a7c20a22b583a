"""A run waits for its view before the first tick: however it is joined, and whatever comes meanwhile."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import AsyncIterator, Callable
from pathlib import Path

import pytest

from bridge.fleet.how import How
from bridge.run.directory import RunDirectory
from bridge.scenario.file import parse_scenario
from lostlink.flight.flight import Flight, Watcher
from tests.integration.bridge.conftest import STILL

TIMEOUT_S = 60.0


class Errors(Watcher):
    """Keeps what goes wrong."""

    def __init__(self) -> None:
        self.texts: list[str] = []
        self.told = threading.Event()

    def on_error(self, text: str) -> None:
        self.texts.append(text)
        self.told.set()


class Flown(threading.Thread):
    """A flight in a thread of its own, whose view joins as ``view`` has it."""

    def __init__(
        self, folder: Path, slot: int, how: How, view: AsyncIterator[str], duration_s: float = 1.0
    ) -> None:
        super().__init__(daemon=True)
        text = STILL.format(speed="max", duration_s=duration_s, slot=slot)
        text += f"processes: {'many' if how == 'many' else 'one'}\n"
        scenario = parse_scenario(text, "still.yaml", folder)
        self.errors = Errors()
        self.summary: dict[str, object] = {"ending": ""}
        self.flight = Flight(scenario, RunDirectory.create(folder, scenario.name), self.errors, how)
        self.flight.view = view

    def run(self) -> None:
        self.summary = self.flight.fly(takes_signals=False)


@pytest.mark.slow
@pytest.mark.parametrize("how", ["one", "task", pytest.param("many", marks=pytest.mark.slow)])
def test_a_run_that_is_ended_while_it_waits_has_no_tick(
    how: How, tmp_path: Path, free_slot: Callable[[int], int]
) -> None:
    waits = threading.Event()

    async def view() -> AsyncIterator[str]:
        waits.set()
        await asyncio.Event().wait()
        yield ""

    flown = Flown(tmp_path, free_slot(2), how, view())
    flown.start()
    assert waits.wait(TIMEOUT_S)
    flown.flight.interrupt()
    flown.join(TIMEOUT_S)
    assert not flown.is_alive()
    assert (flown.summary["ending"], flown.summary["sim_duration_s"]) == ("interrupted", 0.0)
    assert flown.errors.texts == []


@pytest.mark.parametrize(
    "how", ["task", *(pytest.param(how, marks=pytest.mark.slow) for how in ("one", "many"))]
)
def test_a_run_flies_without_a_view_that_does_not_come_and_says_so(
    how: How, tmp_path: Path, free_slot: Callable[[int], int]
) -> None:
    async def view() -> AsyncIterator[str]:
        yield "the view has ended"

    flown = Flown(tmp_path, free_slot(2), how, view())
    flown.start()
    flown.join(TIMEOUT_S)
    assert not flown.is_alive()
    assert flown.errors.texts == ["the view has ended"]
    assert (flown.summary["ending"], flown.summary["sim_duration_s"]) == ("duration", 1.0)


@pytest.mark.slow
def test_a_view_that_ends_before_the_run_is_told_while_it_flies(
    tmp_path: Path, free_slot: Callable[[int], int]
) -> None:
    ends = threading.Event()

    async def view() -> AsyncIterator[str]:
        yield ""
        await asyncio.to_thread(ends.wait, TIMEOUT_S)
        yield "the view ended before the run"

    flown = Flown(tmp_path, free_slot(2), "one", view(), duration_s=10_000.0)
    flown.start()
    ends.set()
    assert flown.errors.told.wait(TIMEOUT_S)
    assert flown.is_alive()
    flown.flight.interrupt()
    flown.join(TIMEOUT_S)
    assert flown.errors.texts == ["the view ended before the run"]
