"""Frames go to everybody, and a slow viewer holds up nobody."""

from __future__ import annotations

import asyncio

from lostlink.view.broadcast import Viewer


async def test_a_frame_that_waits_is_sent_once() -> None:
    viewer = Viewer()
    assert viewer.put("a")
    assert await viewer.next() == "a"
    waiting = asyncio.create_task(viewer.next())
    await asyncio.sleep(0)
    assert not waiting.done()
    viewer.put("b")
    assert await waiting == "b"


def test_a_slow_viewer_is_told_to_begin_anew() -> None:
    viewer = Viewer()
    assert viewer.put("a")
    assert not viewer.put("b")
    assert viewer.missed == 1
    assert viewer.put("snapshot")
