"""Whatever a view lives by ends it when it dies."""

from __future__ import annotations

import asyncio
import importlib.util
from pathlib import Path

import pytest

from aps.api.guard import ApiConfig
from bridge.run.directory import RunDirectory
from lostlink.view.background import Background, ViewDied
from lostlink.view.picture.frames import PictureFrames
from lostlink.view.sources.record import RecordSource
from tests.unit.lostlink.replay.flown import flown, scenario_of

needs_nicegui = pytest.mark.skipif(importlib.util.find_spec("nicegui") is None, reason="needs lostlink[view]")


async def dies() -> None:
    await asyncio.sleep(0)
    raise KeyError("speed")


async def test_the_death_of_a_task_ends_the_wait_with_its_name_and_error() -> None:
    background = Background()
    background.start(asyncio.Event().wait(), "what lives")
    background.start(dies(), "the map")
    with pytest.raises(ViewDied, match="the map ended: KeyError: 'speed'"):
        await asyncio.wait_for(background.until(asyncio.Event()), 5.0)
    await background.end()


async def test_what_is_waited_for_comes_and_the_end_is_no_death() -> None:
    background, stop = Background(), asyncio.Event()
    background.start(asyncio.Event().wait(), "what lives")
    asyncio.get_running_loop().call_soon(stop.set)
    await asyncio.wait_for(background.until(stop), 5.0)
    await background.end()


@needs_nicegui
@pytest.mark.parametrize(
    ("broken", "method", "what"),
    [(RecordSource, "play", "the record"), (PictureFrames, "begins_anew", "the map")],
)
async def test_a_view_whose_picture_stands_still_ends(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, broken: type, method: str, what: str
) -> None:
    from lostlink.view import process
    from lostlink.view.broadcast import Broadcast, Viewer

    def dies_of_it(*_: object) -> None:
        raise KeyError("speed")

    def with_a_viewer(frames: PictureFrames, on_viewers: object) -> Broadcast:
        made = Broadcast(frames, lambda _: None)
        made._viewers.append(Viewer())  # none is made when nobody looks
        return made

    monkeypatch.setattr(broken, method, dies_of_it)
    monkeypatch.setattr(process, "Broadcast", with_a_viewer)
    run = flown(tmp_path / "made", scenario_of("moon2020", ("0", "1")), 5)
    settings = process.ViewSettings(ApiConfig(port=0), False, lambda _: None)
    with pytest.raises(ViewDied, match=f"{what} ended: KeyError"):
        await asyncio.wait_for(process.view_record(RunDirectory(run), settings, asyncio.Event()), 20.0)
