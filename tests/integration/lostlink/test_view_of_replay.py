"""What a view shows of a running simulation: of one that is played again, which any test can hold and move."""

from __future__ import annotations

import asyncio
import subprocess
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import asynccontextmanager, contextmanager
from pathlib import Path

import pytest

from bridge.bus.identity.roster import OBSERVER
from bridge.run.access import access_of
from lostlink.view.page.tables import losses_words
from lostlink.view.picture.fleet_view import FleetView, view_of
from lostlink.view.sources.live import LiveSource
from tests.unit.lostlink.replay.flown import everybody, flown, scenario_of
from tests.warm import Command

NODES = ("0", "1", "gcs")
TIMEOUT_S = 60.0


@pytest.fixture(scope="module")
def record(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("records") / "made"
    return flown(path, scenario_of("moon2020", NODES), 600, everybody(NODES))


@contextmanager
def replayed(record: Path, out: Path, *options: str) -> Iterator[Path]:
    """Where a replay of ``record`` is found while it is played."""
    words = ("replay", record, "--out", out, "--zenoh-port", "0", *options)
    process = Command(*words, stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        assert process.stdout.readline().startswith("plays ")
        yield out / f"replay-{record.name}"
    finally:
        process.terminate()
        process.communicate(timeout=20)


@asynccontextmanager
async def looked_at(place: Path) -> AsyncIterator[tuple[LiveSource, FleetView]]:
    view = view_of(scenario_of("moon2020", NODES))
    source = LiveSource(access_of(place, OBSERVER), view)
    await source.open()
    try:
        yield source, view
    finally:
        await source.close()


async def until(is_so: Callable[[], bool]) -> None:
    async with asyncio.timeout(TIMEOUT_S):
        while not is_so():  # noqa: ASYNC110 - what came is told by nothing else
            await asyncio.sleep(0.01)


@pytest.mark.slow
async def test_what_came_while_nobody_looked_is_not_counted_as_seen(record: Path, tmp_path: Path) -> None:
    with replayed(record, tmp_path) as place:
        async with looked_at(place) as (source, view):
            await source.look(closely=True)
            await until(lambda: bool(view.losses["main"].total))
            await source.look(closely=False)
            left_s = view.sim_time_ns / 1e9
            await until(lambda: view.sim_time_ns / 1e9 > left_s + 2.0)
            await source.look(closely=True)
            await until(lambda: bool(view.losses["main"].total))
            since_s = view.losses["main"].since_s
            assert since_s is not None
            assert since_s > left_s + 2.0
            assert (
                losses_words(view.losses["main"])
                == f"since {since_s:.1f} s of sim time, when a page was opened"
            )
            ticks = round((view.sim_time_ns / 1e9 - since_s) / 0.05) + 1
            assert view.losses["main"].total.total() <= 6 * (ticks + 1), "six fates a tick"


@pytest.mark.slow
async def test_a_replay_that_begins_anew_is_shown_anew(record: Path, tmp_path: Path) -> None:
    with replayed(record, tmp_path, "--from", "5", "--to", "7", "--loop") as place:
        async with looked_at(place) as (source, view):
            await source.look(closely=True)
            await until(lambda: view.sim_time_ns > 6.5e9)
            await until(lambda: view.sim_time_ns < 6e9)
            assert view.times_forgotten == 1
            await until(lambda: view.sim_time_ns > 6.5e9)
            assert view.losses["main"].total.total() <= 6 * 41
            assert len(view.trail) <= 5
